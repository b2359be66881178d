"""Ties: closed loops of rigid and of bending links, against another engine and closed forms; what refuses them."""

from __future__ import annotations

import json
import re
import tomllib
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from pinocchio import rnea
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

import flexlink as fl
from flexlink.chain.lumping import open_chain
from flexlink.chain.rigid import matrix_from_rpy_deg
from flexlink.cli.main import main
from flexlink.describe.scene import scene_from
from flexlink.dynamics.ties import gaps, tie_rows
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.robots.importing import import_urdf
from tests.campaigns.random_ties import judged
from tests.support.loops import Loop, places, unaccelerated, undriven
from tests.support.touching import Touching
from tests.support.words import refused, reviewed

pytestmark = pytest.mark.first
HELD = {"kind": "pd", "kp": [9.0, 0.0, 0.0], "kd": [1.0, 0.0, 0.0], "target_deg": [60.0, -33.0, -116.0]}
AT_REST = {"times": [0.0], "angle_deg": [60.0], "rate_deg": [0.0], "acceleration_deg": [0.0]}
TIP = {"profile": "quintic", "to_deg": [70.0, -40.0, -110.0], "duration": 0.3, "follows": "tip"}
STEP = {"duration": 0.4, "sample": 0.1, "step": 0.1, "method": "Radau5"}
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


def rod(**more: object) -> dict:
    return {"name": "pin", "kind": "distance", "link": "l3", "to": {"point": [1.1, 0.0, 0.0]}, **more}


def gear(link: str, **more: object) -> dict:
    return {"name": "gear", "kind": "joint", "link": link, **more}


def fourbar(**bends: object) -> fl.Scene:
    lengths = ({"length": length, **bends} for length in (0.4, 1.0, 0.8))
    return arm(*lengths, ties=[pin("l3", 1.1, 0.0, 0.0)], start=[60.0, -33.03, -116.34])


def checked(scene: fl.Scene, most: float = 3.0, law: Callable = lambda *_: undriven) -> fl.Trajectory:
    """The run of a scene, which is closed at all samples, and near that of another engine."""
    problem = fl.Problem(scene)
    chain, ties = problem.chain, tie_rows(scene, problem.chain)
    run = problem.simulate()
    loop, held = (
        Loop(chain, np.concatenate([ties[0], unaccelerated(chain)])),
        scene.drive.rate and np.arange(0.0, run.t[-1], 1.0 / scene.drive.rate),
    )
    truth = loop.run(run.q[0], run.qd[0], run.t, law(scene, loop), held=held)
    off = np.linalg.norm(places(chain, run.q) - places(chain, truth), axis=2).max()
    assert off <= most * run.stated.allowed
    assert run.kept
    assert max(np.abs(gaps(ties, chain, q)[0]).max() for q in run.q) <= 1e-12 * chain.size
    rates = max(np.abs(gaps(ties, chain, q)[1] @ qd).max() for q, qd in zip(run.q, run.qd, strict=True))
    assert rates <= 1e-9 * max(1.0, np.abs(run.qd).max())
    return run


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("bends", [{}, BENDS], ids=["rigid", "bending"])
def test_a_four_bar_linkage_moves_as_in_another_engine(bends: dict, tolerance: float) -> None:
    checked(fourbar(**bends).varied({"run.tolerance": tolerance}))


def control(scene: fl.Scene, loop: Loop) -> Callable:
    """Torques by Pinocchio of the open rigid arm, along `drive.reference`."""
    active, drive, rigid = loop.chain.active, scene.drive, Loop(fl.lump(open_chain(scene).rigidified()), [])

    def torque(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        r, v, a = scene.course(t)
        τ, still = np.zeros(len(q)), np.zeros(len(r))
        feedback = np.array(drive.kp) * (r - q[active]) + np.array(drive.kd) * (v - qd[active])
        motion = (q[active], qd[active], a + feedback) if drive.kind == "computed_torque" else (r, still, still)
        τ[active] = rnea(rigid.model, rigid.data, *motion) + (drive.kind == "pd") * feedback
        return τ

    return torque


SAMPLED = {"kind": "computed_torque", "kp": [100.0] * 3, "kd": [5.0] * 3, "rate": 200.0}
STIFF = {"material.steel.young": 7e10, "initial.passive": "static"}


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize(("law", "more"), [(HELD | {"gravity": "rigid"}, {}), (SAMPLED, STIFF)])
def test_drives_with_a_model_move_a_loop_as_in_another_engine(law: dict, more: dict, tolerance: float) -> None:
    move = {"profile": "quintic", "to_deg": [75.0, -40.0, -120.0], "duration": 0.3}
    scene = fourbar(**BENDS).varied({"drive": law | {"target_deg": None, "reference": move}, **more})
    assert np.ptp(checked(scene.varied({"run.tolerance": tolerance}), law=control).q[:, 0]) > 0.2


@pytest.mark.parametrize("method", ["Radau5", "DOP853"])
@pytest.mark.parametrize(
    "bends", [{}, BENDS, {"flex": "z", "modes": 2, "segments": 7}], ids=["rigid", "hinges", "modes"]
)
def test_a_prescribed_joint_moves_a_loop_as_in_another_engine(bends: dict, method: str) -> None:
    """The torque of its motion does the work that the energy shows, in the samples and in the steps."""
    ends = {"times": [0.0, 0.4], "angle_deg": [60.0, 108.0], "rate_deg": [120.0, 120.0], "acceleration_deg": [0.0, 0.0]}
    moved = {"motion": [{"link": "l1", **ends}], "initial.rate_deg": [120.0, 0.0, 0.0], "run.method": method}
    strict = {"run.tolerance": 1e-6, "run.sample": 0.0125, "run.duration": 0.2, "run.outputs": ["torques"]}
    run = checked(fourbar(**bends).varied(moved | strict))
    np.testing.assert_allclose(np.degrees(run.q[:, 0]), 60.0 + 120.0 * run.t, rtol=0, atol=1e-10)
    E = run.energy.kinetic + run.energy.gravity + run.energy.elastic
    np.testing.assert_allclose(run.work, E - E[0], rtol=0, atol=1e-4)
    if not bends:
        power = (run.tau * run.qd).sum(axis=1)
        np.testing.assert_allclose(CubicSpline(run.t, power).antiderivative()(run.t), E - E[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_joints_move_in_their_ratio_as_in_another_engine(tolerance: float) -> None:
    pair = gear("l2", ratio=-2.5, to={"link": "l1"})
    scene = arm({"length": 0.4, **BENDS}, {"length": 0.5}, ties=[pair], start=[20.0, -50.0])
    run = checked(scene.varied({"run.tolerance": tolerance}))
    first, second = run.chain.active
    np.testing.assert_allclose(run.q[:, second], -2.5 * run.q[:, first], rtol=0, atol=1e-12)
    near = fl.simulate(scene.varied({"tie.gear.stiffness": 1e7, "tie.gear.damping": 1e3}), tolerance=1e-7)
    assert np.linalg.norm(near.tip - run.tip, axis=1).max() <= 1e-4 + tolerance


def test_a_hinge_with_a_redundant_row_holds_as_two_points_do() -> None:
    scene = fourbar()
    hinge = {"name": "pin", "kind": "hinge", "link": "l3", "axis": [0, 1, 0], "to": {"point": [1.1, 0.0, 0.0]}}
    run, other = checked(scene.varied({"tie": [hinge]})), checked(scene)
    np.testing.assert_allclose(run.q, other.q, atol=1e-3)


def test_a_weld_holds_a_bending_arm_by_its_end() -> None:
    """Its attitude is the sum of the angles about −Y, a negative pitch."""
    start, attitude = [60.0, -33.03, -116.34], (0.0, 89.37, 0.0)
    weld = {"name": "pin", "kind": "weld", "link": "l3", "to": {"point": [1.1, 0.0, 0.0], "rpy_deg": attitude}}
    scene = fourbar(**BENDS).varied({"tie": [weld], "initial.joint_deg": start, "run.tolerance": 1e-5})
    run = checked(scene)
    last = forward_kinematics(run.chain.arrays, run.q[-1]).rotations[-1]
    np.testing.assert_allclose(last, matrix_from_rpy_deg(attitude), atol=1e-10)
    assert np.ptp(run.q, axis=0).max() > 1e-3


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


def squeezer() -> fl.Scene:
    """Andrews' squeezing mechanism: seven bodies in a plane, three loops and a spring, driven by 0.033 N m."""
    bodies = {  # on, root, mass, moment of inertia, centre of mass
        "K1": ("base", (0.0, 0.0), 0.04325, 2.194e-6, (0.00092, 0.0)),
        "K2": ("K1", (0.007, 0.0), 0.00365, 4.41e-7, (-0.0115, 0.0)),
        "K3": ("base", (-0.03635, 0.03273), 0.02373, 5.255e-6, (0.01043, -0.01874)),
        "K5": ("base", (-0.06934, -0.00227), 0.0705, 1.169e-5, (0.02308, 0.00916)),
        "K4": ("K5", (0.04, 0.0), 0.00706, 5.667e-7, (0.0, -0.00579)),
        "K7": ("base", (-0.06934, -0.00227), 0.05498, 1.912e-5, (-0.00449, -0.01228)),
        "K6": ("K7", (0.0, -0.04), 0.00706, 5.667e-7, (0.00579, 0.0)),
    }
    start = [-0.0617138900142764496, 0.0, 0.45527981916307038, 0.48736497954384255, 0.22266839016588588,
             1.2305474445498212, -0.22266839016588588]  # fmt: skip
    ends = {"K3": [0.0, -0.035, 0.0], "K4": [0.0, -0.02, 0.0], "K6": [0.02, 0.0, 0.0]}
    at_e = {"kind": "point", "link": "K2", "point": [-0.028, 0.0, 0.0]}
    spring = {"kind": "distance", "link": "K3", "point": [0.02, -0.018, 0.0], "to": {"point": [0.014, 0.072, 0.0]}}
    return scene_from({
        "name": "squeezer", "gravity": [0, 0, 0], "initial": {"joint_deg": np.degrees(start).tolist()},
        "link": [{"name": name, "on": on, "mount": {"xyz": [*root, 0.0]}, "flex": "rigid",
                  "hub": {"mass": mass, "center": [*center, 0.0], "inertia": [moment] * 3}}
                 for name, (on, root, mass, moment, center) in bodies.items()],
        "tie": [*({"name": link, **at_e, "to": {"link": link, "point": point}} for link, point in ends.items()),
                {"name": "spring", **spring, "length": 0.07785, "stiffness": 4530.0}],
        "drive": {"kind": "constant", "torque": [0.033] + 6 * [0.0]},
        "run": {"duration": 0.03, "sample": 0.03, "tolerance": 1e-8},
    })  # fmt: skip


def test_andrews_squeezing_mechanism_ends_where_it_is_published() -> None:
    """Mazzia and Magherini, Test Set for Initial Value Problem Solvers, problem andrews, at 0.03 s."""
    published = [15.81077119629904, -15.75637105984298, 0.04082224013073101, 0.5244099658805304, -0.5347301163226948,
                 1.048080741042263, 0.5347301163226948]  # fmt: skip
    np.testing.assert_allclose(fl.simulate(squeezer()).q[-1], published, rtol=0, atol=3e-6)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("seed", [1, 2, 3, 11])
def test_random_loops_move_as_in_another_engine(seed: int) -> None:
    """Run a few of the loops that `python -m tests.campaigns.random_ties 0 300` runs."""
    assert {found.outcome for found in judged(seed)} == {"right"}


def test_the_command_simulates_a_loop(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", str(fourbar().save(tmp_path / "fourbar.toml"))]) == 0
    assert re.search(r"final \w+ position: x = 1\.1", capsys.readouterr().out)


def test_the_command_info_names_what_ties_leave(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rope = rod(name="rope", length=0.9, stiffness=1e3, only="pull")
    ties = [pin("l3", 1.1, 0.0, 0.0), rope, rope | {"name": "second"}]
    file = str(fourbar().varied({"tie": ties}).save(tmp_path / "fourbar.toml"))
    assert main(["info", file]) == 0
    assert re.search(r"ties leave (\d)", capsys.readouterr().out)[1] == "1"
    assert main(["info", file, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [tie["independent_rows"] for tie in found["ties"]] == [2, 0, 0]


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


def fourbars(number: int) -> fl.Scene:
    """Four-bars in a row (IFToMM A02): rods of 1 m and 1 kg, upright, whose tips start at 1 m/s."""
    common = {"length": 1.0, "material": "m", "section": "rod", "flex": "rigid"}
    bars, cranks = ([f"{kind}{k}" for k in range(1, number + 1)] for kind in "bc")
    on = {"c0": "base"} | dict(zip(bars, ["c0", *bars], strict=False)) | dict(zip(cranks, bars, strict=True))
    turned = {"c0": 90.0, "b1": -90.0} | dict.fromkeys(cranks, -90.0)
    rates = {"c0": -1.0, "b1": 1.0} | dict.fromkeys(cranks, -1.0)  # of the upright rods −1 rad/s, of the others 0
    ends = [[float(k), 0.0, 0.0] for k in range(1, number + 1)]
    return scene_from({
        "name": "fourbars", "gravity": [0, -9.81, 0], "material": {"m": {"young": 1e11, "density": 1e6}},
        "section": {"rod": {"shape": "rectangle", "height": 1e-3, "width": 1e-3}},
        "link": [{"name": name, "on": below, **common} for name, below in on.items()],
        "initial": {"joint_deg": [turned.get(name, 0.0) for name in on],
                    "rate_deg": np.degrees([rates.get(name, 0.0) for name in on]).tolist()},
        "tie": [{"name": c, "kind": "point", "link": c, "to": {"point": p}} for c, p in zip(cranks, ends, strict=True)],
        "run": {"duration": 10.0, "sample": 0.05, "tolerance": 1e-3},
    })  # fmt: skip


@pytest.mark.parametrize("number", [2, 10])
def test_four_bars_pass_their_singular_postures_as_one_pendulum(number: int) -> None:
    """((N + 1) J + N m L²) θ̈ = −((N + 1) / 2 + N) m g L cos θ; the benchmark allows a change of energy of 0.1 J."""
    run = fl.simulate(fourbars(number))
    inertia = (number + 1) * (1.0 / 3.0 + 1e-6 / 12.0) + number
    weight = 9.81 * ((number + 1) / 2 + number)
    truth = solve_ivp(
        lambda _t, y: [y[1], -weight * np.cos(y[0]) / inertia], (0.0, 10.0), [np.pi / 2, -1.0],
        rtol=1e-11, atol=1e-12, t_eval=run.t,
    ).y[0]  # fmt: skip
    assert truth[-1] < -8 * np.pi  # it turns, through both flat postures
    np.testing.assert_allclose(run.q[:, 0], truth, atol=1e-3)
    E = run.energy.kinetic + run.energy.gravity
    assert np.abs(E - E[0]).max() < 0.1


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
    ties = tie_rows(scene, run.chain)
    assert np.linalg.matrix_rank(gaps(ties, run.chain, run.q[0])[1], tol=1e-9) < len(ties[0])
    assert np.ptp(run.q, axis=0).max() > 0.5
    assert run.steps.failed == 0
    assert max(np.abs(gaps(ties, run.chain, q)[0]).max() for q in run.q) < 1e-12
    assert np.abs(run.imbalance).max() < 1e-3 * run.exchanged[-1]


@pytest.mark.parametrize(("method", "order"), [("Radau5", 5), ("RK4", 4)])
def test_fixed_steps_of_a_rigid_loop_converge_with_the_order_of_their_method(method: str, order: int) -> None:
    scene = fourbar().varied({"run.duration": 0.4, "run.sample": 0.4})
    truth = fl.simulate(scene.varied({"run.tolerance": 1e-10, "run.method": "Radau9"})).q[-1]
    runs = [fl.simulate(scene, method=method, step=step) for step in (0.02, 0.01)]
    errors = [np.abs(run.q[-1] - truth).max() for run in runs]
    assert np.log2(errors[0] / errors[1]) > order - 0.3
    assert runs[0].imbalance[-1] < 20 * runs[1].exchanged[-1] * errors[0]


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


def pendulum(ties: list, **more: object) -> fl.Scene:
    """A rod of 1 m and 0.4 kg that swings about Y, with ties."""
    scene = arm({"length": 1.0, "joint": {"axis": [0, -1, 0], "limits_deg": [-100.0, -60.0]}}, ties=ties, start=[-65.0])
    square = {"material.steel.density": 1000.0, "section.thin.height": 0.02, "section.thin.width": 0.02}
    return scene.varied({**square, "run.duration": 1.0, **more})


INERTIA = 0.4 * (1.0 / 3.0 + 0.02**2 / 12.0)


@pytest.mark.parametrize("dissipation", [0.0, 0.3])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_a_pendulum_is_thrown_back_by_its_stops(tolerance: float, dissipation: float) -> None:
    """J θ̈ = −m g L/2 cos θ − k δ (1 + c δ̇) beyond the limits, integrated from corner to corner by SciPy."""
    k, c = 1e5, dissipation
    low, high = np.radians([-100.0, -60.0])
    run = fl.simulate(pendulum([], **{"run.tolerance": tolerance, "limits": {"stiffness": k, "dissipation": c}}))
    assert run.kept
    assert not run.warnings

    def rates(_t: float, y: np.ndarray, side: int) -> list[float]:
        depth = side * (y[0] - (high if side > 0 else low))
        pressed = side * k * depth * (1.0 + c * side * y[1]) if side else 0.0
        return [y[1], (-0.4 * 9.81 * 0.5 * np.cos(y[0]) - pressed) / INERTIA]

    def end(_t: float, y: np.ndarray, side: int) -> float:  # of the present piece, where this becomes positive
        return max(y[0] - high, low - y[0]) if not side else side * ((high if side > 0 else low) - y[0])

    end.terminal, end.direction = True, 1
    t, y, side, angles = 0.0, np.array([np.radians(-65.0), 0.0]), 0, np.full(len(run.t), np.nan)
    accurate = {"method": "DOP853", "rtol": 1e-11, "atol": 1e-12, "dense_output": True}
    while np.isnan(angles[-1]):
        found = solve_ivp(rates, (t, 1.0), y, args=(side,), events=end, **accurate)
        there = (run.t >= t) & (run.t <= found.t[-1])
        angles[there] = found.sol(run.t[there])[0] if there.any() else []
        t, y = found.t[-1], found.y[:, -1]
        side = 0 if side else 1 if y[0] > np.radians(-80.0) else -1
    assert np.abs(run.q[:, 0] - angles).max() < 3 * tolerance


@pytest.mark.parametrize(("method", "order"), [("Radau5", 5), ("Radau9", 9), ("Gauss6", 6), ("RK4", 4)])
def test_fixed_steps_end_where_stops_press_and_keep_their_order(method: str, order: int) -> None:
    stop = {"name": "stop", "kind": "stop", "link": "l1", "stiffness": 1e5}
    scene = pendulum([stop], **{"run.sample": 0.04})
    truth = fl.simulate(scene.varied({"run.method": "Radau9", "run.tolerance": 1e-9})).q
    fixed = {"duration": 1.0, "sample": 0.04, "method": method}
    steps = (2e-3, 1e-3) if order == 9 else (1e-3, 5e-4)
    errors = [np.abs(fl.simulate(scene.varied({"run": fixed | {"step": h}})).q - truth).max() for h in steps]
    assert np.log2(errors[0] / errors[1]) > order - 0.8


def test_limits_become_stops_of_all_joints_without_one() -> None:
    """A trolley turns back at its limit, its arm at a stop that is a tie; a third joint is locked."""
    trolley = {"length": 0.6, "joint": {"kind": "prismatic", "axis": [0, 0, 1], "limits_m": [-0.02, 0.5]}}
    turns = {"axis": [0, -1, 0], "limits_deg": [-20.0, 30.0]}
    links = trolley, {"length": 0.5, **BENDS, "joint": turns}, {"length": 0.1, "joint": turns | {"locked": True}}
    stop = {"kind": "stop", "name": "stop of l2", "link": 2, "stiffness": 1e3, "dissipation": 0.2}
    own = {"kind": "stop", "name": "stop of l1", "link": "l1", "stiffness": 1e4, "dissipation": 0.1}
    start = {"joint_deg": [0.0, 10.0, 5.0], "joint_m": [0.0, 0.0, 0.0]}
    scene = arm(*links, ties=[stop], start=[], initial=start)
    limits = {"stiffness_m": 1e4, "dissipation_m": 0.1}
    made, given = scene.varied({"limits": limits}), scene.varied({"tie": [stop, own]})
    for each, other in ((made, given), (made.rigidified(), given.rigidified())):
        run = fl.simulate(each)
        np.testing.assert_array_equal(run.q, fl.simulate(other).q)
        assert run.q[:, 0].min() < -0.02
    assert scene_from(tomllib.loads(made.to_toml())) == made
    assert fl.to_mjcf(run.chain, ties=each) == fl.to_mjcf(run.chain, ties=other)


def test_limits_of_an_imported_robot_become_stops(tmp_path: Path) -> None:
    stops = {"limits.stiffness": 1e5, "initial.joint_deg.1": -65.0, "run.duration": 1.0, "run.sample": 0.05}
    file = tmp_path / "robot.urdf"
    file.write_text(re.sub("<flexlink[^>]*>", "", fl.to_urdf(fl.lump(pendulum([])))), encoding="utf-8")
    robot = import_urdf(file).scene.varied({"gravity": [0, 0, -9.81], "run.tolerance": 1e-6, **stops})
    run = fl.simulate(pendulum([], **stops, **{"run.tolerance": 1e-6}))
    np.testing.assert_allclose(fl.simulate(robot).q, run.q, atol=3e-6)
    assert run.q.min() > np.radians(-100.0) + 0.01  # without stops it passes -110°


def test_an_inertia_in_a_gear_with_play_swings_with_the_period_of_the_closed_form() -> None:
    """Free over the play s, half an oscillation of ω² = k / J at each end: T = 2 s / v + 2 π / ω."""
    k, v, play = 400.0, 2.0, 0.3
    gear = {"name": "gear", "kind": "joint", "link": "l1", "stiffness": k, "play": play}
    period = 2 * play / v + 2 * np.pi / np.sqrt(k / INERTIA)
    start = {"gravity": [0, 0, 0], "initial.joint_deg": [0.0], "link.l1.joint.limits_deg": None}
    scene = pendulum([gear], **start, **{"run.duration": 3 * period, "run.sample": period, "run.tolerance": 1e-8})
    run = fl.simulate(scene, qd0=[v])
    np.testing.assert_allclose(run.q[:, 0], 0.0, atol=2e-8)
    np.testing.assert_allclose(run.qd[:, 0], v, atol=1e-6)


def test_a_mass_on_a_cable_falls_hangs_and_is_thrown_up() -> None:
    """Free fall over h, then z = −g/ω² (1 − cos ωτ) − v/ω sin ωτ with v = √(2 g h), ω² = k / m while it pulls."""
    k, h, g, m = 2e3, 0.1, 9.81, 0.36
    cable = {
        "name": "rope", "kind": "distance", "link": "l1", "length": 1.0 + h, "stiffness": k, "only": "pull",
        "to": {"point": [1.0, 0.0, 1.0]},
    }  # fmt: skip
    scene = arm({"length": 1.0, "joint": {"kind": "prismatic", "axis": [0, 0, 1]}}, ties=[cable], start=[0.0])
    scene = scene.varied({"initial.joint_deg": None, "run.tolerance": 1e-8, "material.steel.density": 1000.0})
    run = fl.simulate(scene)
    assert fl.mass_matrix(run.chain, run.q[0])[0, 0] == pytest.approx(m)
    fall, v, ω = np.sqrt(2 * h / g), np.sqrt(2 * g * h), np.sqrt(k / m)
    taut = (2 * np.pi - 2 * np.arctan2(v, g / ω)) / ω  # until the cable is as long again, with the speed reversed
    t = run.t
    z = np.where(t < fall, -g * t**2 / 2, -h - g / ω**2 * (1 - np.cos(ω * (t - fall))) - v / ω * np.sin(ω * (t - fall)))
    up = t - fall - taut
    z = np.where(up > 0, -h + v * up - g * up**2 / 2, z)
    assert (up > 0).any()
    np.testing.assert_allclose(run.q[:, 0], z, atol=1e-8)


def test_a_cylinder_raises_a_boom_by_its_length() -> None:
    """cos β = (a² + b² − l²) / (2 a b) at each time, of the boom against the line to the cylinder's foot."""
    a, b = 0.6, 0.5
    lift = {
        "name": "lift", "kind": "distance", "link": "l1", "x": a, "times": [0.0, 0.3], "lengths": [0.7, 0.9],
        "to": {"point": [0.0, 0.0, -b]},
    }  # fmt: skip
    start = {"initial.joint_deg": [-10.0], "link.l1.joint.limits_deg": None}
    scene = pendulum([lift], **start, **{"run.duration": 0.5, "run.tolerance": 1e-6})
    with pytest.warns(RuntimeWarning, match="closed"):
        run = fl.simulate(scene)
    x = np.clip(run.t / 0.3, 0.0, 1.0)
    length = 0.7 + 0.2 * x**3 * (10 + x * (6 * x - 15))
    angle = np.arccos((a * a + b * b - length**2) / (2 * a * b)) - np.pi / 2
    np.testing.assert_allclose(run.q[:, 0], angle, atol=1e-12)
    lever = a * b * np.cos(angle) / length  # dl/dθ: the force follows from J θ̈ + m g L/2 cos θ = −F dl/dθ
    rate = (30 * x**2 - 60 * x**3 + 30 * x**4) * 0.2 / 0.3
    bent = (60 * x - 180 * x**2 + 120 * x**3) * 0.2 / 0.09
    turned = -a * b * np.sin(angle) / length - (a * b * np.cos(angle)) ** 2 / length**3
    θ_tt = (bent - turned * (rate / lever) ** 2) / lever
    force = -(INERTIA * θ_tt + 0.4 * 9.81 * 0.5 * np.cos(angle)) / lever
    np.testing.assert_allclose(run.tie_forces["lift"], force, atol=1e-9 * np.abs(force).max())
    np.testing.assert_allclose(run.qdd[:, 0], θ_tt, atol=1e-8)
    along, across = (
        np.array([c, 0 * c, s]).T for c, s in ((np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle)))
    )
    pull = -(force / length)[:, None] * (a * along + [0.0, 0.0, b])  # on the boom
    inertia = 0.4 * (0.5 * (θ_tt[:, None] * across - ((rate / lever) ** 2)[:, None] * along) + [0.0, 0.0, 9.81])
    root = pull - inertia  # of the boom on its bearing
    most = np.abs(root).max()
    np.testing.assert_allclose(run.loads.N[:, 0], (root * along).sum(axis=1), atol=1e-8 * most)
    np.testing.assert_allclose(np.abs(run.loads.V_y[:, 0]), np.abs((root * across).sum(axis=1)), atol=1e-8 * most)
    np.testing.assert_allclose(run.loads.hinge_moment[:, 0], 0.0, atol=1e-8 * most)
    assert np.abs(run.imbalance).max() < 1e-4 * run.exchanged[-1]


def test_a_stiff_spring_is_nearly_an_exact_tie() -> None:
    scene = fourbar(**BENDS).varied({"run.tolerance": 1e-5})
    held = fl.simulate(scene)
    for stiffness, most in ((1e7, 2e-5), (1e10, 1e-5)):
        spring = fl.simulate(scene.varied({"tie.pin.stiffness": stiffness}), q0=held.q[0], qd0=held.qd[0])
        assert np.abs(places(held.chain, spring.q) - places(held.chain, held.q)).max() < most
        assert spring.steps.taken < 4 * held.steps.taken


def test_a_crank_drives_a_slider() -> None:
    """x = r cos θ + √(l² − r² sin² θ)."""
    line = {"point": [0.0, 0.0, 0.0], "axis": [1.0, 0.0, 0.0]}
    slider = {"name": "pin", "kind": "slider", "link": "l2", "to": line}
    scene = arm({"length": 0.3}, {"length": 0.7}, ties=[slider], start=[60.0, -81.787])
    run = fl.simulate(scene.varied({"run.duration": 1.0}))
    θ = run.q[:, 0]
    assert np.ptp(θ) > 2.0
    np.testing.assert_allclose(run.tip[:, 0], 0.3 * np.cos(θ) + np.sqrt(0.49 - 0.09 * np.sin(θ) ** 2), atol=1e-12)
    np.testing.assert_allclose(run.tip[:, 1:], 0.0, atol=1e-12)


def touching() -> fl.Scene:
    """A bending arm of two links on a rope, over a wall, with a spring and a damper between its links."""
    wall = {"point": [0.0, 0.0, -0.45], "axis": [0.1, 0.0, 1.0]}
    ties = [
        {"name": "wall", "kind": "point", "link": "l2", "stiffness": 1e4, "dissipation": 0.2, "only": "push",
         "to": wall},
        {"name": "rope", "kind": "distance", "link": "l1", "length": 0.72, "stiffness": 1e3, "only": "pull",
         "to": {"point": [0.0, 0.2, 0.5]}},
        {"name": "ball", "kind": "point", "link": "l2", "x": 0.3, "stiffness": 20.0, "damping": 0.5,
         "to": {"link": "l1", "point": [0.3, 0.0, 0.0]}},
    ]  # fmt: skip
    lengths = ({"length": 0.5, "flex": "z", "segments": 3}, {"length": 0.5, "flex": "z", "segments": 3})
    return arm(*lengths, ties=ties, start=[10.0, -20.0]).varied({"material.steel.young": 1e9})


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_a_bending_arm_touches_a_wall_a_rope_and_a_spring(tolerance: float) -> None:
    problem = fl.Problem(touching().varied({"run.tolerance": tolerance}))
    run = problem.simulate()
    truth, pieces = Touching(problem.chain, tie_rows(problem.scene, problem.chain)).run(run.q[0], run.qd[0], run.t)
    assert pieces > 3
    assert run.kept
    assert np.linalg.norm(places(run.chain, run.q) - places(run.chain, truth), axis=2).max() < 3 * tolerance
    assert np.abs(run.imbalance).max() < 10 * tolerance * run.exchanged[-1]


@pytest.mark.parametrize("stiffness", [1e4, None])
@pytest.mark.parametrize("bends", [{}, BENDS], ids=["rigid", "bending"])
def test_a_boom_on_a_cylinder_starts_at_rest(bends: dict, stiffness: float | None) -> None:
    lift = rod(name="lift", link="l1", x=0.6, length=0.8, to={"point": [0.0, 0.0, -0.5]})
    static = {"initial": {"joint_deg": [5.0], "passive": "static"}}
    scene = arm({"length": 1.0, **bends}, ties=[lift | {"stiffness": stiffness}], start=[5.0]).varied(static)
    run = fl.simulate(scene.varied({"run.tolerance": 1e-6}))
    assert np.abs(run.q - run.q[0]).max() < 1e-9  # a thousandth of the tolerance
    assert np.abs(run.qdd[0]).max() < 1e-8
    if not bends and stiffness:  # the least energy: m g L/2 sin θ + k (l − 0.8)² / 2
        m = 1200 * 0.012 * 0.03

        def energy(θ: float) -> float:
            return m * 9.81 * 0.5 * np.sin(θ) + stiffness / 2 * (np.sqrt(0.61 + 0.6 * np.sin(θ)) - 0.8) ** 2

        least = minimize_scalar(energy, (-0.1, 0.1), tol=1e-12).x
        assert run.q[0, 0] == pytest.approx(least, abs=1e-7)


@pytest.mark.parametrize("scene", [fourbar(**BENDS), touching()], ids=["hanging", "on a wall and a rope"])
def test_a_tied_arm_starts_at_rest(scene: fl.Scene) -> None:
    run = fl.simulate(scene.varied({"initial.passive": "static", "run.tolerance": 1e-6}))
    assert np.abs(run.q - run.q[0]).max() < 1e-9  # a thousandth of the tolerance
    assert np.abs(run.qdd[0]).max() < 1e-8


@pytest.mark.parametrize("scene", [fourbar(**BENDS), touching()], ids=["loop", "touching"])
def test_a_simulator_steps_a_tied_arm_as_a_run_does(scene: fl.Scene) -> None:
    run, arm = fl.simulate(scene), fl.Simulator(scene)
    off = [(places(run.chain, np.array([arm.step(duration=0.05).q, q]))) for q in run.q[1:]]
    assert max(np.linalg.norm(one - other, axis=1).max() for one, other in off) < 3 * run.stated.allowed
    assert arm.error < run.stated.allowed


def test_many_runs_and_sweeps_of_tied_arms_have_the_numbers_of_single_runs() -> None:
    scenes = [fourbar(**BENDS).varied({"tie.pin.to.point": [1.1, 0.0, z], "run.duration": 0.1}) for z in (0.0, 1e-3)]
    alone = [fl.simulate(scene) for scene in scenes]
    for one, run in zip(alone, fl.simulate_many([*scenes, scenes[0].varied({"tie": ()})]), strict=False):
        assert (one.q == run.q).all()
    measured = {"x": {"of": "tip x [m]"}, "rest": {"of": "settling time [s]", "target": "rest", "tolerance": 0.1}}
    grid = {"tie.pin.to.point": [[1.1, 0, 0], [1.1, 0, 1e-3]]}
    rows = fl.sweep(fl.Sweep(scene=scenes[0], grid=grid, quantity=measured))
    assert [row[5] for row in rows.rows] == [run.tip[-1, 0] for run in alone]
    assert all("ties" in reason for reason in rows.failed.values())


def test_an_accelerometer_on_a_loop_feels_what_differences_of_the_motion_show() -> None:
    feel = {"name": "s", "kind": "accelerometer", "link": "l2", "axis": [1, 0, 0]}
    scene = fourbar().varied({"run.tolerance": 1e-9, "run.sample": 1e-3, "sensor": [feel], "run.duration": 0.1})
    run = fl.simulate(scene)
    start, end = places(run.chain, run.q)[:, -3], places(run.chain, run.q)[:, -2]  # of the second of three links
    acceleration = (end[2:] - 2 * end[1:-1] + end[:-2]) / 1e-6
    along = (end - start)[1:-1]  # the link is 1 m long
    felt = ((acceleration - [0.0, 0.0, -9.81]) * along).sum(axis=1)
    np.testing.assert_allclose(run.readings["s [m/s²]"][1:-1], felt, atol=1e-3)


def test_a_law_and_a_simulator_read_sensors_of_a_loop() -> None:
    """A law that reads an accelerometer and drives nothing reads what the run's sensor shows, also behind a motion."""
    feel = {"name": "s", "kind": "accelerometer", "link": "l2", "axis": [1, 0, 0]}
    motor = {"name": "motor", "kind": "torque", "link": "l1"}
    scene = fourbar().varied({"run.sample": 0.01, "run.duration": 0.1, "sensor": [feel, motor], "run.tolerance": 1e-6})
    ends = {"times": [0.0, 1.0], "angle_deg": [60.0, 90.0], "rate_deg": [0, 0], "acceleration_deg": [900.0, 0]}
    for each in (scene, scene.varied({"motion": [{"link": "l1", **ends}]})):
        seen: list[dict] = []

        def law(_t: float, _q: np.ndarray, _qd: np.ndarray, sensors: dict, seen: list = seen) -> list[float]:
            seen.append(dict(sensors))
            return [0.0, 0.0, 0.0]

        run = fl.simulate(each, control=law, rate=100.0)
        simulator = fl.Simulator(each)
        simulator.step([0.0, 0.0, 0.0], duration=0.1)
        for name, readings in run.readings.items():
            np.testing.assert_allclose([values[name] for values in seen], readings[: len(seen)], rtol=0, atol=1e-4)
            assert simulator.readings[name] == pytest.approx(readings[-1], abs=1e-4)
        assert (abs(run.readings["motor [N m]"]).min() > 1e-3) == bool(each.motion)


@pytest.mark.parametrize(
    ("change", "id"),
    [
        ({"tie.pin.to.point": [3.0, 0.0, 0.0]}, "ties-open"),
        ({"run": {"duration": 1.0, "step": 0.01, "method": "Gauss4"}}, "method-with-ties"),
        ({"motion": [{"link": "l1", **AT_REST}], "tie": [gear("l1")]}, "tie-of-locked-joint"),
        ({"drive": {**HELD, "target_deg": None, "reference": TIP}}, "ties-not-supported"),
        ({"drive": HELD | {"kind": "computed_torque"}}, "ties-not-supported"),
        ({"tie.pin.kind": "hinge"}, "missing-key"),
        ({"tie.pin.length": 1.0}, "key-of-another-kind"),
        ({"tie.pin.to": {}}, "missing-key"),
        ({"tie.pin.to": {"x": 0.1}}, "needs-another-key"),
        ({"tie.pin.link": None}, "missing-key"),
        ({"tie.pin.damping": 1.0}, "needs-another-key"),
        ({"tie.pin.stiffness": 1e3, "tie.pin.play": 0.1}, "needs-another-key"),
        ({"tie.pin.stiffness": 1e3, "tie.pin.dissipation": 0.1}, "needs-another-key"),
        ({"tie": [rod(length=1.0, stiffness=1e3, play=0.1, only="pull")]}, "both-given"),
        ({"tie": [rod(length=1.0, stiffness=1e3, only="pull", damping=1.0)]}, "key-of-another-kind"),
        ({"tie": [rod(length=1.0, stiffness=1e3, dissipation=1.0)]}, "key-of-another-kind"),
        ({"tie": [rod(length=1.0, times=[0.0, 1.0], lengths=[1.0, 1.1])]}, "both-given"),
        ({"tie": [rod(times=[0.0, 1.0], lengths=[1.0])]}, "one-per-time"),
        ({"tie": [rod(times=[0.1, 1.0], lengths=[1.0, 1.1])]}, "first-time"),
        ({"tie": [rod()]}, "missing-key"),
        ({"tie": [{"name": "stop", "kind": "stop", "link": "l1", "stiffness": 1e3}]}, "stop-without-limits"),
        ({"tie": [gear("l1", to={"link": "l2", "x": 0.1})]}, "key-of-another-kind"),
        ({"tie": [gear("l1", ratio=2.0)]}, "needs-another-key"),
        ({"tie": [gear("l1")], "link.l1.joint.locked": True}, "tie-of-locked-joint"),
        ({"tie": [gear("l2", to={"link": "l1"})], "link.l1.joint.locked": True}, "tie-of-locked-joint"),
        ({"limits.stiffness": 1e3}, "no-effect"),
        ({"limits.stiffness_m": 1e3, "link.l1.joint.limits_deg": [0, 90]}, "no-effect"),
        ({"limits.dissipation": 0.1, "link.l1.joint.limits_deg": [0, 90]}, "missing-key"),
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
    with refused(fl.FlexlinkError, "ties-not-supported"):
        fl.lump(scene)
    assert fl.lump(open_chain(scene)).n == run.chain.n


def test_a_run_reports_a_cylinder_that_becomes_too_long() -> None:
    ends = {"times": [0.0, 0.4], "lengths": [1.0, 1.4], "to": {"point": [-0.2, 0.0, 0.0]}}  # at most 1.2 m is in reach
    cylinder = {"name": "cylinder", "kind": "distance", "link": "l2", **ends}
    scene = arm({"length": 0.4}, {"length": 0.6}, start=[40.0, -60.0], ties=[cylinder])
    with pytest.raises(fl.errors.DivergenceError, match="'cylinder'"):
        fl.simulate(scene)
    spring = {"tie.cylinder.stiffness": 1e5, "tie.cylinder.damping": 100.0}
    assert fl.simulate(scene.varied(spring)).kept


def test_a_cylinder_that_does_not_fit_the_initial_angles_is_reported_with_the_length_that_does() -> None:
    ram = {"name": "ram", "kind": "distance", "link": "l2", "times": [0.0, 1.0], "lengths": [0.8, 0.9]}
    ram |= {"stiffness": 1e5, "to": {"point": [-0.2, 0.0, 0.0]}}
    scene = arm({"length": 0.4}, {"length": 0.6}, start=[40.0, -60.0], ties=[ram]).varied({"initial.passive": "static"})
    with pytest.warns(RuntimeWarning) as warned:
        fl.Problem(scene)
    reviewed("ties-closed", str(warned[0].message))
    fitting = float(re.search(r"give (\S+),", str(warned[0].message))[1])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fl.Problem(scene.varied({"tie.ram.lengths": (fitting, 0.9)}))


def test_steps_after_a_failed_one_begin_with_the_multipliers_of_the_last_good_one() -> None:
    soft = {"material.steel.young": 3e8, "initial.rate_deg": [200.0, 0.0, 0.0]}
    run = {"run.tolerance": 1e-2, "run.duration": 1.0, "run.sample": 0.1}
    assert checked(fourbar(**BENDS).varied(soft | run)).steps.failed > 0


@pytest.mark.parametrize("deg", [-120.0, -80.0, 10.0, 95.0])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_a_tie_within_one_rigid_part_holds_nothing(deg: float, tolerance: float) -> None:
    rod = {"name": "rod", "kind": "distance", "link": "l2", "length": 1.0, "to": {"link": "l1", "x": 0.13}}
    second = {"length": 0.53, "joint": {"axis": [0, -1, 0], "locked": True}}
    scene = arm({"length": 0.4}, second, ties=[rod], start=[20.0, deg]).varied({"run.tolerance": tolerance})
    bare = open_chain(scene)
    chain = fl.lump(bare)
    off = gaps(tie_rows(scene, chain), chain, fl.initial_state(bare, chain)[0])[0].item()
    run = fl.simulate(scene.varied({"tie.rod.length": 1.0 + off}))
    np.testing.assert_allclose(run.tip, fl.simulate(bare, tolerance=1e-7).tip, atol=3 * tolerance)


@pytest.mark.parametrize("method", ["auto", "Radau9"])
def test_an_error_that_smaller_tolerances_do_not_reduce_is_stated_as_it_is(method: str) -> None:
    """A gear with play rattles so fast that runs of any tolerance are 1 to 7 cm apart; one tolerance is 1 mm."""
    gear = {"name": "gear", "kind": "joint", "link": "l1", "stiffness": 47304.80608473587, "play": 0.4}
    line = {
        "point": [0.9820792156079807, 0.0, 0.014355801843593738],
        "axis": [0.9506607732068573, 0.0, -0.3102323230834272],
    }
    guide = {"name": "guide", "kind": "slider", "link": "l2", "to": line}
    parts = {
        "material.steel": {"young": 858665421.7192887, "density": 2000.0, "loss_time": 1.4846517267479985e-05},
        "section.thin.height": 0.02, "link.l1.joint.viscous": 0.05,
        "run": {"duration": 0.3, "sample": 0.03, "tolerance": 1e-3, "method": method},
        "initial.q": [0.3117853371875928, 0.0, 0.0, -0.49627653545578154],
        "initial.qd": [0.6819039575181516, 0.0, 0.0, -1.2393253488498175],
    }  # fmt: skip
    scene = arm({"length": 0.408, **BENDS}, {"length": 0.604}, ties=[guide, gear], start=[0.0, 0.0]).varied(parts)
    run = fl.simulate(scene)
    assert "doubtful-comparison" in {each.id for each in run.warnings}
    assert run.stated.tip.max() > 0.01
    assert not run.kept
