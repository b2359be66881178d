"""The equations of motion as C and CasADi code, against flexlink's solver."""

import importlib.util
import math
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate

import flexlink as fl
from flexlink.cli.main import main
from flexlink.dynamics import rounding
from flexlink.errors import ArgumentError
from flexlink.formats.code.equations import Model, model_of, slopes_of
from flexlink.formats.code.tape import Number, Tape
from tests.conftest import flexible, make_scene
from tests.dynamics.test_strain_modes import random_shaped, with_modes
from tests.support.words import refused
from validation.random_arms import random_arm, random_tree

RULES = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
    "neg": lambda a: -a, "sin": math.sin, "cos": math.cos, "tanh": math.tanh,
}  # fmt: skip


def computed(tape: Tape, inputs: np.ndarray, results: list[Any]) -> np.ndarray:
    """Values of results on a tape."""
    values: dict[int, float] = {}
    given = iter(inputs.tolist())
    for line, (name, operands) in enumerate(tape.operations):
        terms = [values[a] if isinstance(a, int) else a for a in operands]
        values[line] = next(given) if name == "input" else RULES[name](*terms)
    return np.array([values[each.line] if isinstance(each, Number) else each for each in results])


def point(chain: fl.Chain, seed: int) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Inputs of the tape, and the same state with torques for flexlink."""
    rng = np.random.default_rng(seed)
    Φ = np.eye(chain.n) if chain.shapes is None else chain.shapes.matrix
    z = 0.2 * rng.normal(size=chain.freedoms) / np.maximum(1.0, np.abs(Φ).sum(axis=0))
    zd, u, tau = rng.normal(size=chain.freedoms), rng.normal(size=len(chain.active)), np.zeros(chain.n)
    tau[chain.active] = u
    rest = 0.0 if chain.shapes is None else chain.rest
    return np.concatenate([z, zd, u]), (rest + Φ @ z, Φ @ zd, tau)


def code_of(chain: fl.Chain) -> Model:
    try:
        return model_of(chain)
    except ArgumentError:
        pytest.skip("generated code does not contain a feature of the arm")


@pytest.mark.parametrize("shaped", [False, True])
@pytest.mark.parametrize("seed", range(1, 21))
def test_rates_equal_those_of_the_solver_up_to_rounding(seed: int, shaped: bool) -> None:
    scene = random_arm(seed) if seed % 3 else random_tree(seed)
    chain = random_shaped(seed) if shaped else fl.lump(scene.varied({"initial.q": None, "initial.qd": None}))
    model = code_of(chain)
    inputs, state = point(chain, seed)
    found, m = computed(model.tape, inputs, [*model.rate, *model.tip]), chain.freedoms
    Φ = np.eye(chain.n) if chain.shapes is None else chain.shapes.matrix
    both = fl.forward_dynamics(chain, *state), Φ @ found[m : 2 * m]
    assert rounding.acceleration_error(chain, *state, solutions=both).max() <= 1.0
    assert (found[:m] == inputs[m : 2 * m]).all()
    assert found[2 * m :] == pytest.approx(fl.tip_position(chain, state[0]), abs=1e-13 * chain.size)


def test_coupled_springs_and_dampers_are_in_the_code() -> None:
    link = flexible("a", "yz", 5, lumping="lobatto2", damping=fl.Damping(ratio=0.05, at_hz=5.0))
    chain = fl.lump(make_scene(link, gravity=(0.0, -9.81, 0.0)))
    model, (inputs, state) = model_of(chain), point(chain, 1)
    found = computed(model.tape, inputs, model.rate)[chain.n :]
    both = fl.forward_dynamics(chain, *state), found
    assert len(chain.couplings) and rounding.acceleration_error(chain, *state, solutions=both).max() <= 1.0


@pytest.mark.parametrize("modes", [None, 1])
def test_slopes_on_the_tape_are_those_of_the_linear_model(modes: int | None) -> None:
    scene = make_scene(flexible("a", "yz", 3), flexible("b", "z", 3), gravity=(0.0, -9.81, 1.0))
    chain = fl.lump(scene if modes is None else with_modes(scene, modes))
    model, (inputs, state) = model_of(chain), point(chain, 3)
    by_x, by_u = slopes_of(model)
    columns = [*by_x, *by_u]
    found = np.array([computed(model.tape, inputs, column) for column in columns]).T
    linear = fl.linearize(chain, *state)
    wanted = np.hstack([linear.A, linear.B])
    assert np.abs(found - wanted).max() <= 1e-10 * np.abs(wanted).max()


@pytest.mark.slow
def test_runs_with_strain_modes_equal_those_of_scipy_on_the_generated_equations() -> None:
    """The tape shares no code with the kernels, and SciPy none with the steps."""
    links = flexible("a", "z", 5, joint=fl.Joint(armature=0.1)), flexible("b", "z", 3)
    start = fl.InitialState(joint_deg=(10.0, -40.0), rate_deg=(20.0, 30.0))
    scene = with_modes(make_scene(*links, gravity=(0.0, -9.81, 1.0), initial=start), 1)
    scene = scene.varied({"run": fl.RunSettings(method="Radau5", tolerance=1e-7, duration=0.1, sample=0.05)})
    run = fl.simulate(scene)
    model, back = model_of(run.chain), run.chain.shapes.inverse.T

    def rate(_: float, x: np.ndarray) -> np.ndarray:
        return computed(model.tape, np.append(x, [0.0, 0.0]), model.rate)

    begin = np.append(back @ run.q[0], back @ run.qd[0])
    found = scipy.integrate.solve_ivp(rate, (0.0, 0.1), begin, "LSODA", t_eval=run.t, rtol=1e-9, atol=1e-10)
    tips = [computed(model.tape, np.append(x, [0.0, 0.0]), model.tip) for x in found.y.T]
    assert np.abs(run.tip - tips).max() <= 2e-6


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")
@pytest.mark.parametrize("modes", [None, 1])
def test_compiled_code_passes_its_self_test(modes: int | None, tmp_path: Path) -> None:
    scene = make_scene(flexible("a", "z", 3), flexible("b", "z", 3, friction=fl.Friction(coulomb=0.1)))
    chain = fl.lump(scene if modes is None else with_modes(scene, modes))
    (tmp_path / "arm.c").write_text(fl.to_c(chain, slopes=True), encoding="utf-8")
    build = ["cc", "-std=c99", "-O1", "-Wall", "-Werror", "-DTEST_TEST", "arm.c", "-o", "arm", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True)
    subprocess.run(["./arm"], cwd=tmp_path, check=True)


@pytest.mark.slow
def test_casadi_code_passes_its_self_test(tmp_path: Path) -> None:
    pytest.importorskip("casadi")
    chain = fl.lump(with_modes(make_scene(flexible("a", "z", 9), gravity=(0.0, -9.81, 0.0)), 2))
    path = tmp_path / "arm_model.py"
    path.write_text(fl.to_casadi(chain), encoding="utf-8")
    spec = importlib.util.spec_from_file_location("arm_model", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.test() <= 1e-10
    assert module.STATES[:2] == ("q a [rad]", "q a.mode1.z [rad]") and module.INPUTS == ("tau a [N m]",)


def test_the_export_command_writes_code(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "arm.toml"
    with_modes(make_scene(flexible("a", "z", 5)), 1).save(path)
    assert main(["export", str(path), "--c", str(tmp_path / "arm.c"), "--casadi", str(tmp_path / "arm.py")]) == 0
    assert {each.name for each in tmp_path.iterdir()} == {"arm.toml", "arm.c", "arm.py"}


def test_features_that_code_does_not_contain_are_refused() -> None:
    drag = make_scene(flexible("a", "z", 3, drag=fl.Drag(coefficient=1.0)), air_density=1.2)
    with refused(ArgumentError, "code-not-supported"):
        fl.to_c(fl.lump(drag))
