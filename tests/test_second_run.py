"""A second run says what a run's own steps cannot tell: the errors of fixed implicit steps, and errors that grow."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import numpy as np
import pytest
from conftest import ROOT, compiled, flexible, make_scene
from random_jumps import random_jump
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.motion import single_run as single
from flexlink.motion import verification as second_run
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import Monitor
from flexlink.motion.verification import Second
from flexlink.results import balance
from validation.random_arms import Dice

pytestmark = compiled
WRONG = 0.05  # of the tip's motion


def swung() -> fl.Scene:
    """A rod let go 10° from its upright position, whose errors grow."""
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)))
    return scene.varied({"run": fl.RunSettings(step=0.17, sample=0.17, duration=34.0)})


def off(run: fl.Trajectory, exact: fl.Trajectory) -> float:
    """Error of the tip, as a part of its motion."""
    return float(np.abs(run.tip - exact.tip).max() / np.linalg.norm(np.ptp(exact.tip, axis=0)))


@pytest.mark.parametrize("name", ["Radau5", "Gauss4"])
def test_fixed_implicit_steps_are_doubted_before_they_are_wrong_and_not_where_they_are_right(name: str) -> None:
    scene = swung()
    exact = fl.simulate(scene, method="DOP853", tolerance=1e-9)
    runs = [fl.simulate(scene, method=name, step=0.17 / parts) for parts in (1, 2, 4, 8)]
    assert any("doubtful: tip error" in told for told in runs[0].warnings)
    assert not runs[-1].warnings
    assert off(runs[-1], exact) < WRONG / 10
    assert [run for run in runs if off(run, exact) > WRONG and not run.warnings] == []


def test_the_second_run_tells_the_error_within_a_factor_of_three_where_the_order_shows() -> None:
    scene = swung()
    exact = fl.simulate(scene, method="DOP853", tolerance=1e-9)
    run = fl.simulate(scene, method="Gauss4", step=0.17)
    (told,) = (warning for warning in run.warnings if "doubtful: tip error" in warning)
    found = float(told.split("tip error ")[1].split(" m")[0])
    actual = float(np.abs(run.tip - exact.tip).max())
    assert actual / 3 <= found <= 3 * actual


def test_steps_that_pass_over_a_blow_are_doubted_though_twice_as_long_ones_are_wrong_alike() -> None:
    torques = tuple((0.0, peak, 0.0) for peak in (0.0, 0.0, 440.0, 0.0, 0.0))
    blow = fl.Drive(kind="table", times=(0.0, 0.1037, 0.1041, 0.1113, 0.4), torques=torques)
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"drive": blow})
    run = fl.simulate(scene, method="Gauss6", step=0.02, sample=0.02, duration=0.4)
    exact = fl.simulate(scene, method="Radau5", tolerance=1e-7, sample=0.02, duration=0.4)
    assert off(run, exact) > WRONG
    assert any("doubtful: tip error" in told for told in run.warnings)


def test_twice_the_step_judges_nothing_where_its_steps_were_taken_in_parts_as_those_of_the_run_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    judges = []

    def doubt(monitor: Monitor, second: Second, tip: np.ndarray) -> str:
        judges.append(second.run)
        return second_run.doubt(monitor, second, tip)

    monkeypatch.setattr(single, "doubt", doubt)
    run = fl.simulate(random_jump(Dice(659)), method="Gauss6", step=0.005, sample=0.05)
    assert run.steps is not None
    assert run.steps.failed > 0
    assert [judge.controlled for judge in judges] == [True]


def tumbling(step: float) -> fl.Scene:
    """Two rods, let go nearly upright, that turn over and over: errors grow a thousandfold."""
    rods = [fl.Link(name=name, length=1.0, material="aluminium", section="square") for name in "ab"]
    scene = make_scene(*rods, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(150.0, 20.0)))
    return scene.varied({"run": fl.RunSettings(step=step, sample=0.1, duration=5.0)})


def test_fixed_explicit_steps_are_doubted_where_their_small_errors_grow_and_not_where_they_are_right() -> None:
    scenes = [tumbling(step) for step in (0.02, 0.01, 0.005, 1e-3, 1e-4)]
    exact = fl.simulate(scenes[0], method="DOP853", tolerance=1e-10)
    runs = [fl.simulate(scene) for scene in scenes]
    assert ["this motion amplifies errors" in "".join(run.warnings) for run in runs] == [
        True,
        True,
        False,
        False,
        False,
    ]
    assert off(runs[1], exact) > WRONG  # while its steps' own errors are less than a thousandth of the motion
    assert max(off(run, exact) for run in runs if not run.warnings) < WRONG / 10
    assert [run.warnings for run in fl.simulate_many(scenes)] == [run.warnings for run in runs]


def tumbling_body(**changes: object) -> fl.Scene:
    """A rigid body that spins about its middle axis, nearly, and turns over now and then; its tip is 1 m away."""
    stub = fl.Link(name="stub", on="base", joint=fl.Joint(locked=True), length=1.0, end=fl.RigidBody(mass=1e-3))
    base = fl.Base(kind="free", mass=10.0, inertia=(1.0, 2.0, 3.0))
    spin = fl.details.BaseState(spin_deg=(np.degrees(1e-3), np.degrees(2.0), np.degrees(1e-3)))
    scene = fl.Scene(name="tumbling", arm=fl.Arm(links=(stub,), base=base), initial=fl.InitialState(base=spin))
    run = fl.RunSettings(method="DOP853", tolerance=1e-4, sample=0.1, duration=89.5)
    return scene.varied({"gravity": (0.0, 0.0, 0.0), "run": run, **changes})


def euler(t: np.ndarray) -> np.ndarray:
    """Its angular velocity, (times, 3) [rad/s], by Euler's equations: the stub's mass stands at 1 m along x."""
    inertia = np.array([1.0, 2.0 + 1e-3, 3.0 + 1e-3])

    def changes(_t: float, ω: np.ndarray) -> np.ndarray:
        return np.asarray(-np.cross(ω, inertia * ω) / inertia)

    found = solve_ivp(changes, (0.0, t[-1]), [1e-3, 2.0, 1e-3], "DOP853", t, rtol=1e-13, atol=1e-13)
    return np.asarray(found.y.T)


def test_where_samples_make_the_steps_the_second_run_takes_half_of_them_and_tells_the_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Tolerances of 1e-3 and 1e-6 m take the same steps, so that a tenth of one says nothing of the run."""
    runs: list[single.SingleRun] = []
    begin = single.SingleRun.advance
    monkeypatch.setattr(
        single.SingleRun, "advance", lambda run, *some, **named: runs.append(run) or begin(run, *some, **named)
    )
    run = fl.simulate(tumbling_body())
    assert run.base is not None
    assert np.abs(run.base.spin - euler(run.t)).max() > 10 * 1e-4 / run.chain.reach
    assert any("tip error" in told and "this motion amplifies errors" in told for told in run.warnings)
    first, second = (each.steps.steps.taken for each in runs)
    assert second > 1.9 * first


def test_rigid_bodies_that_tumble_are_left_to_an_explicit_method_and_turn_as_euler_says() -> None:
    run = fl.simulate(tumbling_body(**{"run.method": "auto", "run.sample": 0.01, "run.tolerance": 1e-3}))
    assert run.steps is not None and run.steps.method == "DOP853"
    assert run.base is not None
    assert np.abs(run.base.spin - euler(run.t)).max() < 1e-3


def test_a_second_run_that_takes_very_long_is_given_up_and_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(single, "GIVEN_UP", 0.1)
    run = fl.simulate(swung(), method="Radau5", step=0.17 / 8)
    assert any("no comparison run with other steps ended" in told for told in run.warnings)


def spinning(rate: float) -> fl.Scene:
    """Two links that bend in all directions, no friction, the first joint turning so fast [deg/s]."""
    links = flexible("a", "yz", 3), flexible("b", "yz", 3, mount=fl.Mount(rpy_deg=(90.0, 0.0, 0.0)))
    initial = fl.InitialState(joint_deg=(0.0, 40.0), rate_deg=(rate, 0.0))
    return make_scene(*links, gravity=(0.0, 0.0, 9.81), initial=initial).varied(
        {"run.duration": 0.2, "run.sample": 0.01, "run.relative_tolerance": 1e-4, "run.method": "DOP853"}
    )


@pytest.mark.slow
def test_a_motion_that_turns_round_and_round_is_within_its_tolerance_or_warned() -> None:
    scene = spinning(36000.0).varied({"run.duration": 0.1})
    exact = fl.simulate(scene, relative_tolerance=1e-9)
    errors, warned = [], []
    for tolerance in (1e-3, 1e-4, 1e-5):
        run = fl.simulate(scene, relative_tolerance=tolerance)
        errors.append(np.abs(run.tip - exact.tip).max() / (tolerance * run.chain.reach))
        warned.append(any("this motion amplifies errors" in told for told in run.warnings))
    assert max(errors) > 10  # there is something to warn of
    assert all(said or error <= 10 for error, said in zip(errors, warned, strict=True))


def test_only_what_turns_far_has_a_second_run(monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[Monitor] = []
    begin = single.SingleRun.advance
    monkeypatch.setattr(
        single.SingleRun, "advance", lambda run, *some, **named: runs.append(run.monitor) or begin(run, *some, **named)
    )
    for rate, wanted in ((90.0, 1), (36000.0, 2)):
        runs.clear()
        fl.simulate(spinning(rate), relative_tolerance=1e-2)
        assert len(runs) == wanted
    bends = spinning(36000.0).varied({"link.*.flex": "z", "link.*.segments": 3})
    runs.clear()
    fl.simulate(bends, relative_tolerance=1e-1, accuracy="deflection")
    assert [monitor.run.relative_tolerance for monitor in runs] == pytest.approx([1e-1, 1e-2])
    for duration, wanted in ((0.5, 1), (5.0, 2)):
        runs.clear()
        fl.simulate(tumbling(1e-3), duration=duration)
        assert min(len(runs), 2) == wanted  # a loose one that differs is followed by a stricter one


def test_energy_that_only_the_tolerance_excuses_calls_for_a_second_run_which_confirms_or_doubts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Vibrations that stay below the tolerance are damped away, and with them most of the energy."""
    runs: list[Monitor] = []
    begin = single.SingleRun.advance
    monkeypatch.setattr(
        single.SingleRun, "advance", lambda run, *some, **named: runs.append(run.monitor) or begin(run, *some, **named)
    )
    zigzag = fl.InitialState(q=(0.0, 0.03, -0.03, 0.03, -0.03))
    scene = make_scene(flexible("a", segments=5), initial=zigzag)
    scene = scene.varied({"run": fl.RunSettings(method="Radau5", tolerance=0.05, duration=1.0, sample=0.01)})
    run = fl.simulate(scene)
    assert np.abs(run.imbalance[-1]) > balance.SHARE * run.exchanged[-1]
    assert len(runs) == 2
    assert runs[0].confirmed
    assert run.warnings == ()


def test_how_far_joints_turn_does_not_depend_on_how_often_they_are_looked_at() -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"initial.joint_deg": (0.0, 70.0, 90.0)})
    often, once = (
        fl.simulate(scene, tolerance=1e-3, sample=sample, duration=2.5, method="Radau5") for sample in (0.01, 2.5)
    )
    assert [bool(run.warnings) for run in (often, once)] == [True, True]
    assert often.steps == once.steps


def test_runs_side_by_side_from_rest_are_doubted_for_their_energy_as_single_ones_are() -> None:
    changes = {"gravity": (0.0, 0.0, 0.0), "initial.joint_deg": (0.0, -80.0, 0.0)}
    changes |= {"drive": fl.Drive(kind="constant", torque=(0.0, 50.0, 50.0))}
    h = 4.9e-4  # a hair beyond the stable step
    run = fl.RunSettings(step=h, sample=20 * h, duration=600 * h, unstable="allow")
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({**changes, "run": run})
    alone, (beside, _) = fl.simulate(scene), fl.simulate_many([scene, scene])
    assert any("the energy error is" in told for told in alone.warnings)
    assert beside.warnings == alone.warnings


def test_a_second_run_that_is_stopped_confirms_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"initial.joint_deg": (0.0, 70.0, 90.0)})
    varied = scene.varied({"run": fl.RunSettings(tolerance=1e-3, sample=0.1, duration=2.5)})
    run = single.SingleRun(problem_of(varied))
    stop, began = Stop(), []

    def stopped(monitor: Monitor, name: str) -> Iterator[Second]:
        stop.signal = signal.SIGINT
        began.append(name)
        yield from second_run.second_runs(monitor, name)

    monkeypatch.setattr(single, "second_runs", stopped)
    with pytest.raises(fl.errors.InterruptedRunError):
        run.finish(stop)
    assert began
    assert not run.monitor.confirmed


@pytest.mark.parametrize(("rate", "grows"), [(400.0, True), (1000.0, False)])
def test_a_sampled_loop_that_is_unstable_multiplies_errors_and_is_doubted(rate: float, grows: bool) -> None:
    """An arm without damping, which a motor of limited torque turns by 20°: it swings on, and no joint turns far."""
    arm = make_scene(flexible("a", segments=4, joint=fl.Joint(armature=0.02)), gravity=(0.0, 0.0, -9.81))
    pd = fl.Drive(kind="pd", kp=(200.0,), kd=(10.0,), target_deg=(20.0,), rate=rate, effort=(60.0,))
    scene = arm.varied(
        {"drive": pd, "run": fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=1.0, sample=0.02)}
    )
    run, exact = fl.simulate(scene), fl.simulate(scene, method="Radau9", relative_tolerance=1e-8)
    off = np.linalg.norm(run.tip - exact.tip, axis=1).max() / (1e-4 * run.chain.reach)
    assert (off > 10) == grows
    assert [f"the control loop, unstable at drive.rate = {rate:g} Hz, amplifies errors" in w for w in run.warnings] == (
        [True] if grows else []
    )


@pytest.mark.parametrize(
    "run", [{"method": "Radau5", "tolerance": 1e-3}, {"method": "RK4", "step": 0.025}], ids=["tolerance", "step"]
)
def test_errors_of_a_branch_that_does_not_end_the_arm_are_told(run: dict[str, object]) -> None:
    """A double pendulum beside a last link that stands still: its tip shows nothing of an error of metres."""
    bar = fl.RigidBody(mass=1.0, center=(0.5, 0.0, 0.0), inertia=(0.0, 1 / 12, 1 / 12))
    still = fl.Link(name="c", on="base", length=1.0, hub=bar, joint=fl.Joint(locked=True))
    scene = make_scene(
        *(fl.Link(name=name, length=1.0, hub=bar) for name in "ab"), still,
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(90.0, 30.0, 0.0)),
    ).varied({"run": fl.RunSettings(duration=10.0, sample=0.1, **run)})  # fmt: skip
    found, exact = fl.simulate(scene), fl.simulate(scene, method="DOP853", tolerance=1e-10, step=None)
    assert np.abs(found.q - exact.q).max() > 1.0 and np.ptp(found.tip) == np.ptp(found.tip[0])
    assert any("doubtful: tip error" in told for told in found.warnings)
