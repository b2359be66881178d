"""A verification run detects errors of fixed implicit steps and growing errors that the run itself does not show."""

import re
import signal
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from flexlink.common.interruption import Stop
from flexlink.motion import single_run as single
from flexlink.motion import verification as second_run
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.monitor import Monitor
from flexlink.motion.verification import Second
from flexlink.results import balance
from flexlink.results.tip_motion import largest_distance
from tests.campaigns.random_jumps import random_jump
from tests.conftest import ROOT, compiled, flexible, make_scene
from tests.support.words import reviewed
from validation.advice.scenes import tumbling_scene
from validation.extremes.families import moving
from validation.random_arms import Dice

pytestmark = compiled
WRONG = 0.05  # a tip error above this fraction of the tip's motion is wrong


def swung() -> fl.Scene:
    """A rod released 10° from its upright position; its errors grow."""
    rod = fl.Link(name="a", length=1.0, material="aluminium", section="square")
    scene = make_scene(rod, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(170.0,)))
    return scene.varied({"run": fl.RunSettings(step=0.17, sample=0.17, duration=34.0)})


def off(run: fl.Trajectory, exact: fl.Trajectory) -> float:
    """Largest error of the tip, relative to the extent of its motion."""
    return float(np.abs(run.tip - exact.tip).max() / np.linalg.norm(np.ptp(exact.tip, axis=0)))


@pytest.mark.parametrize("name", ["Radau5", "Gauss4"])
def test_wrong_fixed_implicit_steps_are_doubted_and_accurate_ones_are_not(name: str) -> None:
    scene = swung()
    exact = fl.simulate(scene, method="DOP853", tolerance=1e-9)
    runs = [fl.simulate(scene, method=name, step=0.17 / parts) for parts in (1, 2, 4, 8)]
    assert doubts(runs[0])
    assert not runs[-1].warnings
    assert off(runs[-1], exact) < WRONG / 10
    assert [run for run in runs if off(run, exact) > WRONG and not run.warnings] == []


def doubts(run: fl.Trajectory, id: str = "doubtful-comparison") -> list[str]:
    """Warnings of a run with this id, after comparison with the reviewed texts."""
    found = [str(warning) for warning in run.warnings if warning.id == id]
    for warning in found:
        reviewed(id, warning, values=False)
    return found


def test_the_second_run_estimates_the_error_within_a_factor_of_three() -> None:
    scene = swung()
    exact = fl.simulate(scene, method="DOP853", tolerance=1e-9)
    run = fl.simulate(scene, method="Gauss4", step=0.17)
    (warning,) = doubts(run)
    found = float(re.search(r" ([\d.e+-]+) m\b", warning)[1])
    actual = float(np.abs(run.tip - exact.tip).max())
    assert actual / 3 <= found <= 3 * actual


def test_a_run_whose_steps_miss_an_impact_is_doubted() -> None:
    torques = tuple((0.0, peak, 0.0) for peak in (0.0, 0.0, 440.0, 0.0, 0.0))
    blow = fl.Drive(kind="table", times=(0.0, 0.1037, 0.1041, 0.1113, 0.4), torques=torques)
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"drive": blow})
    run = fl.simulate(scene, method="Gauss6", step=0.02, sample=0.02, duration=0.4)
    exact = fl.simulate(scene, method="Radau5", tolerance=1e-7, sample=0.02, duration=0.4)
    assert off(run, exact) > WRONG
    assert doubts(run)


def test_a_run_with_subdivided_steps_is_not_compared_with_doubled_steps(monkeypatch) -> None:
    used, doubted = [], second_run.doubt

    def doubt(monitor: Monitor, second: Second, tip: np.ndarray) -> str:
        used.append(second.run)
        return doubted(monitor, second, tip)

    monkeypatch.setattr(second_run, "doubt", doubt)
    run = fl.simulate(random_jump(Dice(659)), method="Gauss6", step=0.005, sample=0.05)
    assert run.steps is not None
    assert run.steps.failed > 0
    assert [comparison.controlled for comparison in used] == [True]


def tumbling(step: float) -> fl.Scene:
    """Two rods, released nearly upright, that tumble: errors grow a thousandfold."""
    rods = [fl.Link(name=name, length=1.0, material="aluminium", section="square") for name in "ab"]
    scene = make_scene(*rods, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(150.0, 20.0)))
    return scene.varied({"run": fl.RunSettings(step=step, sample=0.1, duration=5.0)})


def test_fixed_explicit_steps_are_doubted_only_if_their_errors_grow() -> None:
    scenes = [tumbling(step) for step in (0.02, 0.01, 0.005, 1e-3, 1e-4)]
    exact = fl.simulate(scenes[0], method="DOP853", tolerance=1e-10)
    runs = [fl.simulate(scene) for scene in scenes]
    assert [bool(doubts(run)) for run in runs] == [True, True, False, False, False]
    assert off(runs[1], exact) > WRONG  # though step errors are below 1/1000 of the motion
    assert max(off(run, exact) for run in runs if not run.warnings) < WRONG / 10
    assert [run.warnings for run in fl.simulate_many(scenes)] == [run.warnings for run in runs]


def tumbling_body(**changes: object) -> fl.Scene:
    """A free rigid body that spins nearly about its intermediate axis and flips at times; its tip is 1 m away."""
    stub = fl.Link(name="stub", on="base", joint=fl.Joint(locked=True), length=1.0, end=fl.RigidBody(mass=1e-3))
    base = fl.Base(kind="free", mass=10.0, inertia=(1.0, 2.0, 3.0))
    spin = fl.details.BaseState(spin_deg=(np.degrees(1e-3), np.degrees(2.0), np.degrees(1e-3)))
    scene = fl.Scene(name="tumbling", arm=fl.Arm(links=(stub,), base=base), initial=fl.InitialState(base=spin))
    run = fl.RunSettings(method="DOP853", tolerance=1e-4, sample=0.1, duration=89.5)
    return scene.varied({"gravity": (0.0, 0.0, 0.0), "run": run, **changes})


def euler(t: np.ndarray) -> np.ndarray:
    """Angular velocity of the body by Euler's equations, (times, 3) [rad/s]; the tip mass is at 1 m along x."""
    inertia = np.array([1.0, 2.0 + 1e-3, 3.0 + 1e-3])

    def changes(_t: float, ω: np.ndarray) -> np.ndarray:
        return np.asarray(-np.cross(ω, inertia * ω) / inertia)

    found = solve_ivp(changes, (0.0, t[-1]), [1e-3, 2.0, 1e-3], "DOP853", t, rtol=1e-13, atol=1e-13)
    return np.asarray(found.y.T)


@pytest.fixture
def begun(monkeypatch: pytest.MonkeyPatch) -> list[single.SingleRun]:
    """All runs that begin in a test."""
    runs: list[single.SingleRun] = []
    begin = single.SingleRun.advance
    monkeypatch.setattr(
        single.SingleRun, "advance", lambda run, *some, **named: runs.append(run) or begin(run, *some, **named)
    )
    return runs


def test_if_samples_limit_the_steps_the_second_run_halves_them(begun: list[single.SingleRun]) -> None:
    """Tolerances of 1e-3 and 1e-6 m give the same steps, so a run with a tenth of the tolerance verifies nothing."""
    run = fl.simulate(tumbling_body())
    assert run.base is not None
    assert np.abs(run.base.spin - euler(run.t)).max() < 3 * 1e-4 / run.chain.reach  # the first run misses this
    assert not doubts(run)
    first, second, *_ = (each.steps.steps.taken for each in begun)
    assert second > 1.9 * first


def test_tumbling_rigid_bodies_run_explicitly_and_follow_eulers_equations() -> None:
    run = fl.simulate(tumbling_body(**{"run.method": "auto", "run.sample": 0.01, "run.tolerance": 1e-3}))
    assert run.steps is not None and run.steps.method == "DOP853"
    assert run.base is not None
    assert np.abs(run.base.spin - euler(run.t)).max() < 1e-3


def test_an_expensive_verification_run_is_abandoned_with_a_warning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(second_run, "GIVEN_UP", 0.1)
    run = fl.simulate(swung(), method="Radau5", step=0.17 / 8)
    (warning,) = doubts(run, "no-comparison-run")
    assert str(second_run.GIVEN_UP) in warning


def spinning(rate: float) -> fl.Scene:
    """Two links without friction that bend in all directions; the first joint turns at `rate` [deg/s]."""
    links = flexible("a", "yz", 3), flexible("b", "yz", 3, mount=fl.Mount(rpy_deg=(90.0, 0.0, 0.0)))
    initial = fl.InitialState(joint_deg=(0.0, 40.0), rate_deg=(rate, 0.0))
    return make_scene(*links, gravity=(0.0, 0.0, 9.81), initial=initial).varied(
        {"run.duration": 0.2, "run.sample": 0.01, "run.relative_tolerance": 1e-4, "run.method": "DOP853"}
    )


@pytest.mark.slow
def test_a_spinning_arm_meets_its_tolerance() -> None:
    """By the method that the scene sets, one of these runs is off by more than ten tolerances: it is replaced."""
    scene = spinning(36000.0).varied({"run.duration": 0.1})
    exact = fl.simulate(scene, relative_tolerance=1e-9)
    for tolerance in (1e-3, 1e-4, 1e-5):
        run = fl.simulate(scene, relative_tolerance=tolerance)
        assert np.abs(run.tip - exact.tip).max() <= 3.0 * tolerance * run.chain.reach


def test_only_motions_with_large_rotations_have_a_verification_run(begun: list[single.SingleRun]) -> None:
    for rate, wanted in ((90.0, 1), (36000.0, 2)):
        begun.clear()
        fl.simulate(spinning(rate), relative_tolerance=1e-2)
        assert min(len(begun), 2) == wanted  # if a loose comparison run differs, finer ones follow
    bends = spinning(36000.0).varied({"link.*.flex": "z", "link.*.segments": 3})
    begun.clear()
    fl.simulate(bends, relative_tolerance=1e-1, accuracy="deflection")
    assert [(each.monitor.run.method, each.monitor.run.relative_tolerance) for each in begun[:2]] == [
        ("DOP853", 0.1), ("DOP853", pytest.approx(1e-2)),
    ]  # fmt: skip
    for duration, wanted in ((0.5, 1), (5.0, 2)):
        begun.clear()
        fl.simulate(tumbling(1e-3), duration=duration)
        assert min(len(begun), 2) == wanted  # if a loose verification run differs, a stricter one follows


def test_a_large_energy_error_within_tolerance_starts_a_second_run(begun: list[single.SingleRun]) -> None:
    """The integrator damps vibrations below the tolerance and thereby dissipates most of the energy."""
    zigzag = fl.InitialState(q=(0.0, 0.03, -0.03, 0.03, -0.03))
    scene = make_scene(flexible("a", segments=5), initial=zigzag)
    scene = scene.varied({"run": fl.RunSettings(method="Radau5", tolerance=0.05, duration=1.0, sample=0.01)})
    run = fl.simulate(scene)
    assert np.abs(run.imbalance[-1]) > balance.SHARE * run.exchanged[-1]
    assert len(begun) == 2
    assert begun[0].monitor.confirmed
    assert run.warnings == ()


def test_the_turned_angle_does_not_depend_on_the_sampling() -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"initial.joint_deg": (0.0, 70.0, 90.0)})
    run = fl.RunSettings(tolerance=1e-3, duration=2.5, method="Radau5")
    scenes = [scene.varied({"run": run, "run.sample": sample}) for sample in (0.01, 2.5)]
    firsts = [single.SingleRun(problem_of(each)).finish(Stop(), compared=False) for each in scenes]
    assert firsts[0].steps == firsts[1].steps
    often, once = (fl.simulate(each) for each in scenes)
    assert often.stated is not None and once.stated is not None
    assert (often.stated.compared, once.stated.compared) == (True, True)  # though two samples show hardly any travel
    assert often.stated.travelled == pytest.approx(once.stated.travelled, rel=0.05)


def test_runs_of_a_batch_are_doubted_for_their_energy_like_single_runs() -> None:
    changes = {"gravity": (0.0, 0.0, 0.0), "initial.joint_deg": (0.0, -80.0, 0.0)}
    changes |= {"drive": fl.Drive(kind="constant", torque=(0.0, 50.0, 50.0))}
    h = 4.9e-4  # slightly above the stable step
    run = fl.RunSettings(step=h, sample=20 * h, duration=600 * h, unstable="allow")
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({**changes, "run": run})
    alone, (in_batch, _) = fl.simulate(scene), fl.simulate_many([scene, scene])
    assert doubts(alone, "doubtful-energy")
    assert in_batch.warnings == alone.warnings


def test_a_coarser_run_is_enough_where_it_shows_a_small_error(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"initial.joint_deg": (0.0, 70.0, 90.0)})
    varied = scene.varied({"run": fl.RunSettings(tolerance=1e-3, sample=0.05, duration=0.9)})
    exact = fl.simulate(varied, tolerance=1e-8)
    monkeypatch.setattr(second_run, "runs_of_other_order", None)  # not called
    run = fl.simulate(varied)
    assert run.stated is not None
    assert run.stated.compared
    error = np.linalg.norm(run.tip - exact.tip, axis=1).max()
    assert 0.3 * error < run.stated.tip.max() <= 1e-3


def test_an_interrupted_verification_run_confirms_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = fl.load_scene(ROOT / "models" / "paper_fig5.toml").varied({"initial.joint_deg": (0.0, 70.0, 90.0)})
    varied = scene.varied({"run": fl.RunSettings(tolerance=1e-3, sample=0.1, duration=2.5)})
    run = single.SingleRun(problem_of(varied))
    stop, began, finer = Stop(), [], second_run.runs_of_other_order

    def stopped(run: fl.RunSettings, name: str, *sizes: float) -> Iterator[fl.RunSettings]:
        stop.signal = signal.SIGINT
        began.append(name)
        return finer(run, name, *sizes)

    monkeypatch.setattr(second_run, "runs_of_other_order", stopped)
    with pytest.raises(fl.errors.InterruptedRunError):
        run.finish(stop)
    assert began
    assert not run.monitor.confirmed


@pytest.mark.parametrize(("rate", "grows"), [(400.0, True), (1000.0, False)])
def test_runs_of_an_unstable_sampled_loop_meet_their_tolerance(rate: float, grows: bool) -> None:
    """An undamped arm that a torque-limited motor turns by 20°: it vibrates, but no joint turns far."""
    arm = make_scene(flexible("a", segments=4, joint=fl.Joint(armature=0.02)), gravity=(0.0, 0.0, -9.81))
    pd = fl.Drive(kind="pd", kp=(200.0,), kd=(10.0,), target_deg=(20.0,), rate=rate, effort=(60.0,))
    scene = arm.varied(
        {"drive": pd, "run": fl.RunSettings(method="auto", relative_tolerance=1e-4, duration=1.0, sample=0.02)}
    )
    run, exact = fl.simulate(scene), fl.simulate(scene, method="Radau9", relative_tolerance=1e-8)
    off = np.linalg.norm(run.tip - exact.tip, axis=1).max() / (1e-4 * run.chain.reach)
    assert off <= 3.0  # at 400 Hz the first run is off by more than ten
    assert [warning.id for warning in run.warnings] == ["unstable-loop"] * grows


@pytest.mark.parametrize(
    "run", [{"method": "Radau5", "tolerance": 1e-3}, {"method": "RK4", "step": 0.025}], ids=["tolerance", "step"]
)
def test_errors_of_a_branch_without_the_tip_are_detected(run: dict[str, object]) -> None:
    """A double pendulum and a last link at rest: an error of metres is not visible at the tip."""
    bar = fl.RigidBody(mass=1.0, center=(0.5, 0.0, 0.0), inertia=(0.0, 1 / 12, 1 / 12))
    still = fl.Link(name="c", on="base", length=1.0, hub=bar, joint=fl.Joint(locked=True))
    scene = make_scene(
        *(fl.Link(name=name, length=1.0, hub=bar) for name in "ab"), still,
        gravity=(0.0, -9.81, 0.0), initial=fl.InitialState(joint_deg=(90.0, 30.0, 0.0)),
    ).varied({"run": fl.RunSettings(duration=10.0, sample=0.1, **run)})  # fmt: skip
    found, exact = fl.simulate(scene), fl.simulate(scene, method="DOP853", tolerance=1e-10, step=None)
    assert np.ptp(found.tip) == np.ptp(found.tip[0])
    assert (np.abs(found.q - exact.q).max() < 1e-3) == ("tolerance" in run)  # the first run is off by 1 rad
    assert bool(doubts(found)) == ("step" in run)


def test_the_error_under_a_table_as_dense_as_the_steps_is_compared_with_a_run_of_other_order() -> None:
    """A coarser run would end its steps at the same times of the table, and so have the same error."""
    arm = make_scene(flexible("a", segments=3), flexible("b", segments=3), gravity=(0.0, -9.81, 0.0))
    pd = fl.Drive(kind="pd", kp=(60.0, 20.0), kd=(6.0, 1.5), target_deg=(16.0, -28.0), rate=200.0)
    given = fl.simulate(arm.varied({"drive": pd}), method="Radau9", relative_tolerance=1e-6, sample=5e-3, duration=1.0)
    table = fl.Drive(kind="table", times=tuple(given.t), torques=tuple(map(tuple, given.tau[:, given.chain.active])))
    scene = arm.varied({"drive": table, "run": fl.RunSettings(duration=1.0, sample=0.02)})
    run = fl.simulate(scene, relative_tolerance=1e-6)
    exact = fl.simulate(scene, method="Radau9", relative_tolerance=1e-10, accuracy="deflection")
    error = np.linalg.norm(run.tip - exact.tip, axis=1).max()
    assert run.error is not None
    assert error < 1e-6 * run.chain.reach
    assert 0.5 * error < run.error.max() < 2.0 * error  # from its steps it would be 8 times as large


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
def test_an_arm_that_a_motor_at_its_limit_balances_keeps_its_tolerance(tolerance: float) -> None:
    """Its errors grow 600-fold; runs of two methods with equal tolerances were both 42 tolerances off, 0.7 apart."""
    scene = moving("saturated", 525).scene
    true = fl.simulate(scene, method="DOP853", relative_tolerance=1e-9, max_evaluations=1e6).tip
    run = fl.simulate(scene, relative_tolerance=tolerance)
    error, allowed = largest_distance(run.tip, true), tolerance * run.chain.size
    assert error <= allowed
    assert run.error.max() > 0.3 * error


def test_a_run_by_a_law_in_python_that_may_amplify_what_it_reads_is_doubtful() -> None:
    """It cannot be repeated; this one is 51 tolerances off, and the errors that the law reads add up to 0.9."""
    arm = moving("python law", 774)
    (text,) = fl.simulate(arm.scene, relative_tolerance=1e-3, **arm.arguments).warnings
    assert text.id == "doubtful-comparison"
    reviewed(text.id, text)


def test_a_comparison_run_that_would_be_given_up_is_not_begun(monkeypatch: pytest.MonkeyPatch) -> None:
    """The motion is chaotic: three decades of the tolerance cost the second comparison run four times the first."""
    began: list[int] = []
    other = single._other

    def counted(first: Any, *given: Any) -> Any:
        found = other(first, *given)
        began.append(found.steps.evaluations)
        return found

    monkeypatch.setattr(single, "_other", counted)
    run = fl.simulate(tumbling_scene(2), step=None, method="auto", tolerance=1e-2)
    assert [warning.id for warning in run.warnings] == ["doubtful-comparison"]
    assert len(began) == 2
    assert began[1] * 1.5**3 > 50 * 2000 > began[1]
