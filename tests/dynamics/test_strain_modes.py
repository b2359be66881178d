"""Links with strain modes: hinges that move by shapes, q̇ = Φ ż."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.chain.shapes import shaped_hinges
from flexlink.cli.main import main
from flexlink.describe.variants import refined
from flexlink.dynamics import rounding
from flexlink.errors import ArgumentError, SceneError
from flexlink.kernels.bodies.shaped_mass import mass_of_shapes
from flexlink.motion.evaluation_cost import evaluation_cost
from tests.conftest import flexible, make_scene
from tests.support.words import line, refused
from validation.oracles.common_origin import CommonOrigin
from validation.physics.formulas import INPUTS
from validation.reference_values import reference_array

ROOT = Path(__file__).parents[2]


def with_modes(scene: fl.Scene, count: int, *, segments: int | None = None, **changes: Any) -> fl.Scene:
    """The scene with this number of modes in all links that have enough hinges."""
    for link in scene.arm.links:
        if link.flex != "rigid":
            hinges = (segments or link.segments) - 1
            changes[f"link.{link.name}.modes"] = min(count, hinges)
            changes[f"link.{link.name}.segments"] = hinges + 1
    return scene.varied(changes)


def published(name: str, segments: int, modes: int | None) -> tuple[fl.Trajectory, np.ndarray]:
    """Run of a published beam with Gauss rules by a tolerance of 1 µm, and its reference tip (samples, 2) [m]."""
    scene = INPUTS[name](fl.load_scene(ROOT / "validation" / "scenes" / f"{name}.toml"))
    link = scene.arm.links[-1].name
    changes = {f"link.{link}.lumping": "gauss", f"link.{link}.segments": segments, f"link.{link}.modes": modes}
    run = fl.simulate(scene.varied(changes | {"run.step": None, "run.method": "auto", "run.tolerance": 1e-6}))
    files = {"torque_pulse": "single_link_torque_pulse", "spin_up": "spinup_kane_simo"}
    return run, reference_array(files[name], "values")


def farthest(run: fl.Trajectory, tip: np.ndarray) -> float:
    return float(np.linalg.norm(run.tip[: len(tip), :2] - tip, axis=1).max())


def possible(chain: fl.Chain, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Random angles and rates that are sums of the chain's shapes."""
    rng, Φ = np.random.default_rng(seed), chain.shapes.matrix
    bend = 0.3 / np.maximum(1.0, np.abs(Φ).sum(axis=0))
    return chain.rest + Φ @ (bend * rng.normal(size=chain.freedoms)), Φ @ rng.normal(size=chain.freedoms)


@pytest.mark.parametrize("seed", [4, 7, 10, 13])
def test_the_mass_matrix_of_shapes_is_that_of_100_digits(seed: int) -> None:
    chain = fl.lump(with_modes(make_scene(flexible("a", "xyz", 4), flexible("b", "yz", 3 + seed % 2)), 2))
    q, qd = possible(chain, seed)
    Φ = chain.shapes.matrix
    exact = Φ.T @ CommonOrigin(chain, q, qd).mass_matrix() @ Φ
    assert np.abs(mass_of_shapes(chain.arrays, chain.shapes, q) - exact).max() <= 1e-14 * np.abs(exact).max()


@pytest.mark.parametrize("flex", ["z", "xyz"])
@pytest.mark.parametrize("shapes", ["eigenmodes", "polynomials"])
def test_as_many_shapes_as_hinges_are_the_chain(flex: str, shapes: str) -> None:
    scene = make_scene(flexible("a", flex, 5), flexible("b", "z", 4), gravity=(0.0, -9.81, 1.0))
    whole = {"link.a.modes": {"x": 4, "y": 4, "z": 4, "shapes": shapes}, "link.b.modes": 3}
    chain, shaped = fl.lump(scene), fl.lump(scene.varied(whole))
    q, qd = possible(shaped, 1)
    tau = np.where(np.isin(np.arange(chain.n), chain.active), 3.0, 0.0)
    assert shaped.freedoms == chain.n
    found = [fl.forward_dynamics(each, q, qd, tau) for each in (chain, shaped)]
    assert rounding.acceleration_error(chain, q, qd, tau, solutions=(found[0], found[1])).max() <= 1.0
    rests = [fl.solve_static(each, locked=each.active) for each in (chain, shaped)]
    assert np.abs(rests[0].q - rests[1].q).max() <= 1e-12
    moving = [fl.natural_frequencies(each, rests[0].q, locked=each.active) for each in (chain, shaped)]
    assert moving[1] == pytest.approx(moving[0], rel=1e-7)
    settings = {"run.step": None, "run.method": "Radau5", "run.tolerance": 1e-8, "run.duration": 0.2}
    runs = [fl.simulate(each.varied(settings)) for each in (scene, scene.varied(whole))]
    assert np.abs(runs[0].tip - runs[1].tip).max() <= 1e-8


@pytest.mark.slow
def test_four_coordinates_follow_a_pulse_of_torque_that_bends_the_link_by_40_degrees() -> None:
    run, tip = published("torque_pulse", 21, 3)
    assert run.chain.freedoms == 4
    assert farthest(run, tip) <= 0.15e-3
    assert farthest(published("torque_pulse", 21, None)[0], tip) > farthest(run, tip)


@pytest.mark.slow
@pytest.mark.parametrize(("modes", "limit"), [(1, 4e-3), (3, 0.8e-3)])
def test_spin_up_keeps_the_stiffening_by_centrifugal_forces(modes: int, limit: float) -> None:
    run, tip = published("spin_up", 21, modes)
    assert farthest(run, tip) <= limit


@pytest.mark.slow
def test_two_soft_links_in_free_fall_converge_with_the_number_of_shapes() -> None:
    soft = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied(
        {
            "material.aluminium.young": 70e7, "run.duration": 1.0, "run.sample": 0.02, "run.step": None,
            "run.method": "auto", "run.tolerance": 1e-6, "link.upper.lumping": "gauss", "link.fore.lumping": "gauss",
        }
    )  # fmt: skip
    divided = [with_modes(soft, m, segments=21) for m in (3, 4)]
    fine = fl.simulate(soft.varied({"link.upper.segments": 41, "link.fore.segments": 41}))
    errors = [np.linalg.norm(fl.simulate(scene).tip - fine.tip, axis=1).max() for scene in divided]
    assert errors[0] <= 0.3e-3 and errors[1] <= 0.1e-3


def test_damped_implicit_runs_stay_within_the_shapes() -> None:
    """Extrapolated stages once magnified rounding errors beside the shapes, up to whole radians in a minute."""
    scene = make_scene(flexible("a", "z", 7, damping=fl.Damping(ratio=0.5, at_hz=3.0)), gravity=(0.0, -9.81, 0.0))
    settings = fl.RunSettings(method="Radau5", tolerance=1e-7, duration=60.0, sample=1.0)
    run = fl.simulate(scene.varied({"link.a.modes": 2, "link.a.joint.locked": True, "run": settings}))
    Φ = run.chain.shapes.matrix
    beside = run.q - run.q @ np.linalg.pinv(Φ).T @ Φ.T
    assert np.abs(beside).max() <= 1e-12 and not run.warnings


def test_fewer_shapes_lower_the_highest_frequency() -> None:
    scene = make_scene(flexible("a", "z", 21, lumping="gauss"))
    chain, shaped = fl.lump(scene), fl.lump(with_modes(scene, 2))
    assert fl.natural_frequencies(shaped)[-1] <= 0.05 * fl.natural_frequencies(chain)[-1]
    assert fl.stable_step(shaped) >= 20 * fl.stable_step(chain)
    slowest = [fl.natural_frequencies(each, locked=each.active)[0] for each in (chain, shaped)]
    assert slowest[1] == pytest.approx(slowest[0], rel=1e-12)


def test_a_linear_model_has_the_coordinates_of_the_shapes_as_states() -> None:
    scene = with_modes(make_scene(flexible("a", "yz", 9), gravity=(0.0, 0.0, -9.81)), 2)
    chain = fl.lump(scene)
    rest = fl.solve_static(chain, locked=chain.active)
    model = fl.linearize(chain, rest.q, tau=rest.tau, outputs=("tip", "state"))
    assert model.states[:3] == ("q a [rad]", "q a.mode1.y [rad]", "q a.mode2.y [rad]")
    assert model.A.shape == (2 * chain.freedoms,) * 2
    elastic = np.sort(np.abs(np.linalg.eigvals(model.A)))[-1]
    assert elastic == pytest.approx(fl.natural_frequencies(chain, rest.q)[-1], rel=1e-9)
    assert chain.shapes.matrix @ model.x[: chain.freedoms] == pytest.approx(rest.q - chain.rest, abs=1e-14)


def test_states_that_are_no_sum_of_the_shapes_are_refused() -> None:
    scene = with_modes(make_scene(flexible("a", "z", 5)), 2)
    chain = fl.lump(scene)
    bent = np.zeros(chain.n)
    bent[2] = 0.1
    with refused(ArgumentError, "not-a-shape"):
        fl.solve_static(chain, bent)
    with refused(ArgumentError, "not-a-shape"):
        fl.simulate(scene, q0=bent)
    with refused(ArgumentError, "not-a-shape"):
        fl.simulate(scene, qd0=bent)


def test_modes_that_make_no_sense_are_refused() -> None:
    scene = make_scene(flexible("a", "z", 5), fl.Link(name="rigid", length=0.3))
    with refused(SceneError, "too-many-modes"):
        fl.lump(scene.varied({"link.a.modes": 5}))
    with refused(SceneError, "rigid-segments"):
        scene.varied({"link.rigid.modes": 2})
    chain = fl.lump(scene.varied({"link.a.modes": 2}))
    with refused(ArgumentError, "locked-shape"):
        fl.modes(chain, locked=["a.2.z"])
    with refused(ArgumentError, "modes-not-supported"):
        fl.to_urdf(chain)
    with refused(ArgumentError, "not-similar"):
        fl.SimulatorBatch([with_modes(make_scene(flexible("a", "z", 5)), 2)] * 2)
    assert shaped_hinges(chain).tolist() == chain.bending.tolist()


def test_finer_chains_have_no_shapes() -> None:
    """So a comparison with them includes what the shapes leave out."""
    scene = with_modes(make_scene(flexible("a", "z", 5)), 2)
    finer = fl.lump(refined(scene, 2.0))
    assert finer.n == 9 and finer.freedoms == finer.n


@pytest.mark.slow
def test_advice_for_control_finds_fewer_coordinates_at_the_same_error() -> None:
    soft = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied(
        {"material.aluminium.young": 70e7, "run.duration": 0.5, "run.sample": 0.02, "run.step": None}
    )
    advice = fl.advise(soft, "0.3 mm", measure="control")
    fine = {"link.upper.segments": 33, "link.fore.segments": 33, "run.method": "auto", "run.tolerance": 1e-6}
    truth = fl.simulate(soft.varied(fine)).tip
    assert advice.met
    assert np.linalg.norm(fl.simulate(advice.scene).tip - truth, axis=1).max() <= advice.error <= 3e-4
    assert fl.lump(advice.scene).freedoms <= 0.7 * fl.lump(fl.advise(soft, "0.3 mm").scene).n


@pytest.mark.slow
def test_advice_for_explicit_methods_minimises_the_cost_of_their_steps() -> None:
    arm = fl.load_scene(ROOT / "models" / "t3_spatial.toml").varied({"run.duration": 0.3})
    chains = [fl.lump(fl.advise(arm, "1 mm", measure=measure).scene) for measure in ("simulation", "explicit")]
    costs = [evaluation_cost(chain, explicit=True) / fl.stable_step(chain) for chain in chains]
    assert costs[1] <= 1.1 * costs[0]


@pytest.mark.slow
def test_the_reduce_command_writes_a_scene_with_modes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, out = tmp_path / "arm.toml", tmp_path / "small.toml"
    make_scene(flexible("a", "z", 5), gravity=(0.0, -9.81, 0.0), run=fl.RunSettings(duration=0.2, sample=0.01)).save(
        path
    )
    assert main(["reduce", str(path), "--tip", "1e-6", "-o", str(out)]) == 0
    assert line(capsys.readouterr().out, "strain modes:")
    chain = fl.lump(fl.load_scene(out))
    assert chain.freedoms < chain.n
