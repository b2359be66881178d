"""Ties: closed loops of rigid and of bending links, against another engine and closed forms; what refuses them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.cli.main import main
from flexlink.describe.scene import scene_from
from flexlink.motion.inputs.ties import gaps, open_chain, tie_rows
from tests.campaigns.random_ties import judged
from tests.support.loops import Loop, places
from tests.support.words import refused

BENDS = {"flex": "z", "segments": 3}


def arm(*links: dict, ties: list, start: list[float], **more: object) -> fl.Scene:
    """A planar arm that swings about Y in gravity, with these lengths and ties."""
    common = {"joint": {"axis": [0, -1, 0]}, "material": "steel", "section": "thin"}
    return scene_from({
        "name": "loop", "gravity": [0, 0, -9.81],
        "material": {"steel": {"young": 3e9, "density": 1200.0, "loss_time": 1e-3}},
        "section": {"thin": {"shape": "rectangle", "height": 0.012, "width": 0.03}},
        "link": [{"name": f"l{k}", **common, **link} for k, link in enumerate(links, 1)],
        "initial": {"joint_deg": start}, "tie": ties,
        "run": {"duration": 0.4, "sample": 0.05, "tolerance": 1e-4}, **more,
    })  # fmt: skip


def pin(link: str, *point: float) -> dict:
    return {"name": "pin", "kind": "point", "link": link, "to": {"point": list(point)}}


def fourbar(**bends: object) -> fl.Scene:
    lengths = ({"length": length, **bends} for length in (0.4, 1.0, 0.8))
    return arm(*lengths, ties=[pin("l3", 1.1, 0.0, 0.0)], start=[60.0, -33.03, -116.34])


def checked(scene: fl.Scene, most: float = 3.0) -> fl.Trajectory:
    """The run of a scene, which is closed at all samples, and near that of another engine."""
    problem = fl.Problem(scene)
    chain, rows = problem.chain, tie_rows(scene, problem.chain)
    run = problem.simulate()
    truth = Loop(chain, rows).run(run.q[0], run.qd[0], run.t)
    off = np.linalg.norm(places(chain, run.q) - places(chain, truth), axis=2).max()
    assert off <= most * run.stated.allowed
    assert run.kept
    assert max(np.abs(gaps(rows, chain, q)[0]).max() for q in run.q) <= 1e-12 * chain.size
    rates = max(np.abs(gaps(rows, chain, q)[1] @ qd).max() for q, qd in zip(run.q, run.qd, strict=True))
    assert rates <= 1e-9 * max(1.0, np.abs(run.qd).max())
    return run


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("bends", [{}, BENDS], ids=["rigid", "bending"])
def test_a_four_bar_linkage_moves_as_in_another_engine(bends: dict, tolerance: float) -> None:
    checked(fourbar(**bends).varied({"run.tolerance": tolerance}))


def test_a_hinge_with_a_redundant_row_holds_as_two_points_do() -> None:
    scene = fourbar()
    hinge = {"name": "pin", "kind": "hinge", "link": "l3", "axis": [0, 1, 0], "to": {"point": [1.1, 0.0, 0.0]}}
    run, other = checked(scene.varied({"tie": [hinge]})), checked(scene)
    np.testing.assert_allclose(run.q, other.q, atol=1e-3)


def test_a_rod_between_two_links_keeps_its_length() -> None:
    rod = {"name": "rod", "kind": "distance", "link": "l3", "length": 0.7, "to": {"link": "l1", "x": 0.1}}
    scene = arm({"length": 0.4}, {"length": 0.5}, {"length": 0.5}, ties=[rod], start=[20.0, -50.0, -80.0])
    with pytest.warns(RuntimeWarning, match="closed"):
        run = checked(scene)
    points = places(run.chain, run.q)
    place = points[:, 0] + 0.1 / 0.4 * (points[:, 1] - points[:, 0])
    np.testing.assert_allclose(np.linalg.norm(run.tip - place, axis=1), 0.7, rtol=1e-12)


def test_a_start_that_is_nearly_closed_is_closed_without_a_warning(recwarn: pytest.WarningsRecorder) -> None:
    fl.Problem(fourbar())
    assert not recwarn


def test_hinges_of_strain_modes_keep_to_their_shapes_when_ties_close_at_the_start() -> None:
    """The start is 1° off, and its rates are off the tie, so that joints and springs move; two modes for each link."""
    modes = {"flex": "z", "segments": 7, "modes": 2}
    scene = fourbar(**modes).varied({"initial.joint_deg": [61.0, -33.0, -116.0], "initial.rate_deg": [90.0, 0.0, 0.0]})
    locked = scene.varied({"link.*.joint.locked": True, "initial.rate_deg": None, "initial.joint_deg": [60, -33, -116]})
    with pytest.warns(RuntimeWarning, match="closed"):
        run = checked(scene)
    np.testing.assert_array_equal(run.qd[0, run.chain.bending], 0.0)
    with pytest.warns(RuntimeWarning, match="closed"):
        checked(locked)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("seed", [1, 2, 3, 11])
def test_random_loops_move_as_in_another_engine(seed: int) -> None:
    """Run a few of the loops that `python -m tests.campaigns.random_ties 0 300` runs."""
    assert {found.outcome for found in judged(seed)} == {"right"}


def test_the_command_simulates_a_loop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(fourbar().save(tmp_path / "fourbar.toml"))]) == 0
    assert "final tip position: x = 1.1" in capsys.readouterr().out


def test_a_tie_may_have_any_name() -> None:
    run = fl.simulate(fourbar().varied({"tie": [{**pin("l3", 1.1, 0.0, 0.0), "name": "t"}]}))
    assert run.kept


def test_a_parallelogram_swings_like_a_pendulum() -> None:
    """Two cranks m, J = m (L²/3 + h²/12), and a coupler M that does not turn: (2 J + M L²) θ̈ = −(m + M) g L sin θ."""
    lengths = ({"length": 0.5}, {"length": 0.8}, {"length": 0.5})
    start = [-50.0, 50.0, 130.0]
    scene = arm(*lengths, ties=[pin("l3", 0.8, 0.0, 0.0)], start=start).varied({"run.tolerance": 1e-7})
    run = fl.simulate(scene)
    m, M = (1200 * 0.012 * 0.03 * length for length in (0.5, 0.8))
    L, g = 0.5, 9.81

    def rates(_t: float, y: np.ndarray) -> list[float]:  # y: angle from hanging down, and its rate
        return [y[1], -(m + M) * g * L * np.sin(y[0]) / (2 * m * (L**2 / 3 + 0.012**2 / 12) + M * L**2)]

    truth = solve_ivp(rates, (0.0, 0.4), [np.radians(40.0), 0.0], rtol=1e-11, atol=1e-12, t_eval=run.t).y[0]
    np.testing.assert_allclose(run.q[:, 0], np.radians(-90.0) + truth, atol=1e-7)


def bricard() -> fl.Scene:
    """Bricard's mechanism: five rods of 1 m on hinges at right angles, whose ends a sixth hinge ties to the ground."""
    turns = [(-90, 0, 0), (90, 90, 0), (-90, -90, 0), (90, 90, 0), (-90, -90, 0)]
    common = {"length": 1.0, "material": "steel", "section": "rod"}
    links = [{"name": f"r{k}", **common, "mount": {"rpy_deg": turn}} for k, turn in enumerate(turns, 1)]
    parts = {
        "name": "bricard", "gravity": [0, -9.81, 0], "material": {"steel": {"young": 1e11, "density": 100.0}},
        "section": {"rod": {"shape": "rectangle", "height": 0.1, "width": 0.1}}, "link": links,
        "run": {"duration": 2.0, "sample": 0.1, "tolerance": 1e-4},
    }  # fmt: skip
    chain = fl.lump(scene_from(parts))
    pose = fl.frames(chain, np.zeros(chain.n))
    end = {"point": pose.points[-1].tolist(), "axis": [1, 0, 0]}
    axis = (pose.rotations[-1].T @ [1, 0, 0]).tolist()
    return scene_from(parts | {"tie": [{"name": "close", "kind": "hinge", "link": "r5", "axis": axis, "to": end}]})


def test_a_mechanism_with_more_bearings_than_it_needs_moves() -> None:
    scene = bricard()
    run = fl.simulate(scene)
    rows = tie_rows(scene, run.chain)
    assert np.linalg.matrix_rank(gaps(rows, run.chain, run.q[0])[1], tol=1e-9) < len(rows)
    assert np.ptp(run.q, axis=0).max() > 0.5
    assert run.steps.failed == 0
    assert max(np.abs(gaps(rows, run.chain, q)[0]).max() for q in run.q) < 1e-12
    assert np.abs(run.imbalance).max() < 1e-3 * run.exchanged[-1]


def test_fixed_steps_of_a_rigid_loop_converge_with_the_order_of_their_method() -> None:
    scene = fourbar().varied({"run.duration": 0.4, "run.sample": 0.4})
    truth = fl.simulate(scene.varied({"run.tolerance": 1e-10, "run.method": "Radau9"})).q[-1]
    errors = [np.abs(fl.simulate(scene, method="Radau5", step=step).q[-1] - truth).max() for step in (0.04, 0.02)]
    assert np.log2(errors[0] / errors[1]) > 4.5


def test_energy_of_an_undamped_loop_is_constant() -> None:
    run = fl.simulate(fourbar(**BENDS).varied({"material.steel.loss_time": 0.0, "run.tolerance": 1e-7}))
    assert np.abs(run.imbalance).max() < 1e-6 * run.exchanged[-1]


def test_runs_repeat_continue_and_are_stored() -> None:
    scene = fourbar(**BENDS)
    problem = fl.Problem(scene)
    runs = [problem.simulate() for _ in range(3)]
    assert all(np.array_equal(run.q, runs[0].q) for run in runs)
    later = fl.simulate(scene, after=runs[0], duration=0.1)
    np.testing.assert_array_equal(later.q[0], runs[0].q[-1])
    assert scene_from(tomllib.loads(scene.to_toml())) == scene


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({"tie.pin.to.point": [3.0, 0.0, 0.0]}, "ties-open"),
        ({"run.method": "DOP853"}, "method-with-ties"),
        ({"initial.passive": "static"}, "ties-not-supported"),
        ({"sensor": [{"name": "s", "kind": "joint", "link": "l1"}]}, "ties-not-supported"),
        ({"base": {"kind": "free", "mass": 1.0, "inertia": [1, 1, 1]}, "gravity": [0, 0, 0]}, "ties-not-supported"),
        ({"tie.pin.kind": "hinge"}, "missing-key"),
        ({"tie.pin.length": 1.0}, "key-of-another-kind"),
        ({"tie.pin.to": {}}, "missing-key"),
        ({"tie.pin.to": {"x": 0.1}}, "needs-another-key"),
        ({"tie.pin.to": {"link": "l3"}}, "tie-to-itself"),
        ({"tie.pin.link": "l9"}, "unknown-link"),
        ({"tie.pin.x": 5.0}, "out-of-range"),
        ({"tie": [pin("l3", 1.0, 0.0, 0.0), pin("l2", 1.0, 0.0, 0.0)]}, "name-twice"),
    ],
)
def test_mistakes_and_what_ties_do_not_allow_are_refused(change: dict, id: str) -> None:
    with refused(fl.errors.SceneError, id):
        fl.simulate(fourbar().varied(change))


def test_all_other_functions_refuse_a_scene_with_ties() -> None:
    scene = fourbar()
    run = fl.simulate(scene)
    for call in (
        lambda: fl.lump(scene), lambda: fl.Simulator(scene), lambda: fl.simulate_many([scene]), lambda: run.qdd,
        lambda: fl.advise(scene), lambda: fl.compare(scene), lambda: run.loads,
    ):  # fmt: skip
        with refused(fl.FlexlinkError, "ties-not-supported"):
            call()
    assert fl.lump(open_chain(scene)).n == run.chain.n
