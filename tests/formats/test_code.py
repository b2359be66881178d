"""The equations of motion as C and CasADi code, against flexlink's solver and equations that share no code with it."""

import importlib.util
import itertools
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
from flexlink.dynamics.free_motion import all_motions
from flexlink.errors import ArgumentError
from flexlink.formats.code import c_text
from flexlink.formats.code.model import model_of, slopes_of
from flexlink.formats.code.tape import Number, Tape
from tests.campaigns.random_code import KINDS, arms, compiled, judged, state
from tests.conftest import ROOT, flexible, make_scene
from tests.dynamics.test_strain_modes import with_modes
from tests.matrix import case
from tests.support.words import refused

RULES = {
    "+": lambda a, b: a + b, "-": lambda a, b: a - b, "*": lambda a, b: a * b, "/": lambda a, b: a / b,
    "neg": lambda a: -a, "sin": math.sin, "cos": math.cos, "tanh": math.tanh, "fabs": abs, "sqrt": math.sqrt,
    "atan2": math.atan2, "choose": lambda x, a, b: a if x >= 0 else b, "held": lambda a: a,
}  # fmt: skip
needs_a_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


def computed(tape: Tape, inputs: np.ndarray, results: list[Any]) -> np.ndarray:
    """Values of results on a tape."""
    values: dict[int, float] = {}
    given = iter(inputs.tolist())
    for line, (name, operands) in enumerate(tape.operations):
        terms = [values[a] if isinstance(a, int) else a for a in operands]
        values[line] = next(given) if name == "input" else RULES[name](*terms)
    return np.array([values[each.line] if isinstance(each, Number) else each for each in results])


OPEN = [name for name in case.names() if not case.case(name).scene.ties]


@pytest.mark.parametrize("name", OPEN)
def test_rates_and_slopes_equal_those_of_the_solver_up_to_rounding(name: str) -> None:
    chain = case.case(name).chain
    model, (x, u), Φ, m = model_of(chain), state(chain, 2), all_motions(chain), chain.freedoms
    u[chain.hinges["prescribed"][chain.active] != 0] = 0.0  # as in `forward_dynamics`
    columns = [entry for column in itertools.chain(*slopes_of(model)) for entry in column]
    found = computed(model.tape, np.append(x, u), [*model.rate, *model.tip, *columns])
    rest, tau = 0.0 if chain.shapes is None else chain.rest, np.zeros(chain.n)
    tau[chain.active] = u
    q, qd = rest + Φ @ x[:m], Φ @ x[m:]
    both = fl.forward_dynamics(chain, q, qd, tau), Φ @ found[m : 2 * m]
    assert rounding.acceleration_error(chain, q, qd, tau, solutions=both).max() <= 1.0
    assert (found[:m] == x[m:]).all()
    assert found[2 * m : 2 * m + 3] == pytest.approx(fl.tip_position(chain, q), abs=1e-13 * chain.size)
    linear = fl.linearize(chain, q, qd, tau)
    kept = np.delete(np.arange(2 * m), chain.internal)  # a linear model leaves out the angles of lags
    slopes = found[2 * m + 3 :].reshape(-1, 2 * m).T[kept][:, [*kept, *range(2 * m, 2 * m + len(u))]]
    wanted = np.hstack([linear.A, linear.B])
    assert np.abs(slopes - wanted).max() <= 1e-10 * np.abs(wanted).max()


@pytest.mark.slow
@needs_a_compiler
@pytest.mark.parametrize("kind", KINDS)
def test_code_of_random_arms_solves_equations_of_motion_that_share_no_code_with_the_kernels(kind: str) -> None:
    pytest.importorskip("casadi")
    """Both languages are written from one list of operations: one arm of each kind is also run in CasADi."""
    for count, (seed, chain) in enumerate(itertools.islice(arms(kind), 3)):
        found = judged(chain, seed, casadi=count == 0)
        assert max(found.values()) <= 1.0, found


@pytest.mark.slow
@needs_a_compiler
def test_runs_with_strain_modes_equal_those_of_scipy_on_the_compiled_equations(tmp_path: Path) -> None:
    links = flexible("a", "z", 5, joint=fl.Joint(armature=0.1)), flexible("b", "z", 3)
    start = fl.InitialState(joint_deg=(10.0, -40.0), rate_deg=(20.0, 30.0))
    scene = with_modes(make_scene(*links, gravity=(0.0, -9.81, 1.0), initial=start), 1)
    scene = scene.varied({"run": fl.RunSettings(method="Radau5", tolerance=1e-7, duration=0.1, sample=0.05)})
    run = fl.simulate(scene)
    code, back, still = compiled(run.chain, tmp_path), run.chain.shapes.inverse.T, np.zeros(2)
    begin = np.append(back @ run.q[0], back @ run.qd[0])
    found = scipy.integrate.solve_ivp(
        lambda _, x: code(x, still)[:-3], (0.0, 0.1), begin, "LSODA", t_eval=run.t, rtol=1e-9, atol=1e-10
    )
    tips = [code(np.ascontiguousarray(x), still)[-3:] for x in found.y.T]
    assert np.abs(run.tip - tips).max() <= 2e-6


@pytest.mark.parametrize(
    ("name", "most"),
    [("paper_fig5", 784), ("t2_spatial", 5984), ("t3_spatial", 4759), ("three_links", 3100), ("gantry", 4701)],
)
def test_code_has_no_more_operations_than_now(name: str, most: int) -> None:
    model = model_of(fl.lump(fl.load_scene(ROOT / "models" / f"{name}.toml")))
    assert len(model.tape.needed(model.rate)) <= most


def test_a_constant_is_not_a_line_of_the_tape() -> None:
    tape = Tape()
    x = [tape.input() for _ in range(3)]
    assert (x[0] * x[2]).line != (x[0] * 2.0).line
    assert (x[0] * 2.0).line == (2.0 * x[0]).line


def test_a_kernel_that_branches_on_a_state_cannot_be_exported_silently() -> None:
    with pytest.raises(TypeError):
        assert Tape().input()
    with pytest.raises(TypeError):
        assert Tape().input() > 0.0
    with pytest.raises(TypeError):
        assert Tape().input() == 0.0


@pytest.mark.slow
@needs_a_compiler
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


def test_code_that_is_too_long_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c_text, "LONGEST", 10)
    with refused(ArgumentError, "code-too-long"):
        fl.to_c(fl.lump(make_scene(flexible("a", "z", 3))))
