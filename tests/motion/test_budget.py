"""Runs with a tolerance that make no progress stop, keep their samples, and report where and why they stopped."""

import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.common.interruption import Stop
from flexlink.motion.batch import outcomes
from flexlink.motion.budget import FEWEST, LOOKS, SHORTEST, Budget, Spent
from flexlink.motion.hindrance import hindrance, sampled_growth
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from tests.conftest import compiled, flexible, make_scene
from tests.support.words import refused


def swinging(**changes: Any) -> fl.Scene:
    """Two links that bend in a plane, released at an angle, with a tolerance."""
    links = flexible("a", segments=3), flexible("b", segments=3)
    scene = make_scene(*links, gravity=(9.81, 0.0, 0.0), initial=fl.InitialState(joint_deg=(40.0, -70.0)))
    run = fl.RunSettings(method="Radau5", tolerance=1e-7, duration=0.3, sample=0.02)
    return scene.varied({"run": run, **changes})


def held_too_seldom(**changes: Any) -> fl.Scene:
    """A control loop that needs a rate of a few hundred Hz but is sampled at 20 Hz."""
    drive = fl.Drive(kind="pd", kp=(2e3,), kd=(200.0,), target_deg=(30.0,), rate=20.0)
    scene = make_scene(flexible("a", segments=3), gravity=(9.81, 0.0, 0.0), drive=drive)
    run = fl.RunSettings(method="Radau5", tolerance=1e-4, duration=1.0, sample=0.05)
    return scene.varied({"run": run, **changes})


def test_an_evaluation_budget_is_used_up_to_within_one_step_and_never_exceeded() -> None:
    budget, now, dearest = Budget(1e4, 1.0), Spent(0.0, 0, 0), 36
    budget.begin(now, 1.0)
    while steps := budget.affordable(now, dearest):
        now = Spent(now.time + 1e-6 * steps, now.steps + steps, now.evaluations + 30 * steps)
        assert now.evaluations <= 1e4
    assert now.evaluations > 1e4 - dearest
    assert "max_evaluations = 10000" in budget.over


@pytest.mark.parametrize(("step", "over", "slow"), [(1e-3, False, False), (1e-6, False, True), (1e-11, True, False)])
def test_a_stalled_run_is_reported_after_two_checks_with_tiny_steps(step: float, over: bool, slow: bool) -> None:
    budget, now, dearest, most = Budget(1e6, 1.0), Spent(0.0, 0, 0), 10, 1e6
    budget.begin(now, 1.0)
    assert (step < SHORTEST) is over
    recorded = []
    while (steps := budget.affordable(now, dearest)) and now.evaluations < 3.5 * most / LOOKS:
        now = Spent(now.time + step * steps, now.steps + steps, now.evaluations + dearest * steps)
        recorded.append((now.evaluations, bool(budget.slow)))
    assert (bool(budget.over), bool(budget.slow)) == (over, slow)
    assert FEWEST * dearest < most / LOOKS
    assert [evaluations for evaluations, there in recorded if there][:1] <= [3 * most / LOOKS]


@compiled
def test_a_run_that_exceeds_its_budget_stops_reproducibly_and_keeps_its_samples() -> None:
    scene = swinging(**{"run.max_evaluations": 2000})
    with refused(fl.errors.DivergenceError, "too-many-evaluations") as first:
        fl.simulate(scene)
    with pytest.raises(fl.errors.DivergenceError) as second:
        fl.simulate(scene)
    kept = first.value.trajectory
    assert 1 < len(kept.t) < scene.run.samples
    assert kept.steps is not None
    assert 2000 - 36 < kept.steps.evaluations <= 2000
    whole = fl.simulate(scene, max_evaluations=1e7)
    np.testing.assert_array_equal(kept.q, whole.q[: len(kept.t)])
    np.testing.assert_array_equal(kept.q, second.value.trajectory.q)
    again = pickle.loads(pickle.dumps(first.value))
    assert type(again) is type(first.value)
    assert isinstance(again, fl.errors.DivergenceError)


@compiled
def test_a_stalled_run_names_the_hinge_group_near_gimbal_lock() -> None:
    scene = make_scene(flexible("a", segments=3, flex="xyz"))
    record = SingleRun(problem_of(scene)).monitor.record
    q = np.zeros(record.chain.n)
    assert hindrance(record, q, 0.0) is None
    q[2] = np.radians(-89.9)
    found = hindrance(record, q, 0.0)
    assert found is not None
    assert "'a.1.y'" in found[0] and "-89.9°" in found[0]


@compiled
def test_an_unstable_sampled_control_loop_is_recognised() -> None:
    for scene, unstable in ((held_too_seldom(), True), (held_too_seldom(**{"drive.rate": 1000.0}), False)):
        growth, without = sampled_growth(SingleRun(problem_of(scene)).monitor.record)
        assert without == pytest.approx(1.0, abs=1e-3)
        assert (growth > 1.0 + 1e-3) is unstable
    scene = held_too_seldom(**{"run.max_evaluations": 4000, "run.duration": 20.0})
    with refused(fl.errors.DivergenceError, "too-many-evaluations"):
        fl.simulate(scene)


@compiled
@pytest.mark.slow
def test_a_stalled_run_with_an_unstable_control_loop_ends_early() -> None:
    scene = held_too_seldom(**{"run.max_evaluations": 2e5, "run.duration": 20.0})
    with refused(fl.errors.DivergenceError, "too-many-evaluations") as e:
        fl.simulate(scene)
    assert e.value.trajectory.steps is not None
    assert e.value.trajectory.steps.evaluations <= 2e5 / 10


@compiled
def test_the_growth_factor_of_a_sampled_loop_on_a_wheel_is_exact() -> None:
    """In every sample period T, the rate ω of a wheel with inertia I changes to (1 − k_d T / I) ω."""
    link = fl.Link(name="wheel", length=0.0, flex="rigid", joint=fl.Joint(armature=0.5))
    drive = fl.Drive(kind="pd", kp=(0.0,), kd=(30.0,), target_deg=(0.0,), rate=20.0)
    scene = make_scene(link, drive=drive, gravity=(0.0, 0.0, 0.0))
    growth, without = sampled_growth(SingleRun(problem_of(scene)).monitor.record)
    assert growth == pytest.approx(abs(1 - 30.0 / 20.0 / 0.5))
    assert without == pytest.approx(1.0)


@compiled
def test_members_of_a_batch_and_rows_of_a_sweep_report_why_they_stopped() -> None:
    good, bad = swinging(**{"run.tolerance": 1e-3}), swinging(**{"run.max_evaluations": 1000})
    with pytest.raises(fl.errors.DivergenceError) as error:
        fl.simulate_many([good, bad])
    assert len(error.value.runs[0].t) == good.run.samples
    assert 1 < len(error.value.runs[1].t) < bad.run.samples
    ended = outcomes([bad, good], Stop())
    assert isinstance(ended[0], fl.errors.DivergenceError)
    assert isinstance(ended[1], fl.Trajectory)


@compiled
def test_a_simulator_keeps_its_state_if_a_step_exceeds_its_budget() -> None:
    arm = fl.Simulator(swinging(**{"run.max_evaluations": 1000}))
    for _ in range(3):
        arm.step(duration=0.01)
    before = arm.state
    with refused(fl.errors.DivergenceError, "too-many-evaluations"):
        arm.step(duration=0.3)
    np.testing.assert_array_equal(arm.state.q, before.q)
    assert arm.step(duration=0.01).t == pytest.approx(0.04)


@compiled
def test_slow_progress_is_reported_during_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("flexlink.motion.budget.FEWEST", 1)
    monkeypatch.setattr("flexlink.motion.budget.BREATH", 0.0)  # check after every piece
    scene = swinging(**{"run.max_evaluations": 2500})
    with warnings.catch_warnings(record=True) as caught, pytest.raises(fl.errors.DivergenceError):
        warnings.simplefilter("always")
        fl.simulate(scene)
    assert len(caught) == 1
    assert getattr(caught[0].message.args[0], "id", "") == "slow-progress"
    assert "max_evaluations" in str(caught[0].message)


@compiled
def test_the_simulate_command_keeps_the_samples_of_a_run_that_exceeds_its_budget(tmp_path: Path, capsys: Any) -> None:
    scene, out = tmp_path / "scene.toml", tmp_path / "run.csv"
    scene.write_text(swinging().to_toml())
    assert main(["simulate", str(scene), "--max-evaluations", "2000", "--out", str(out)]) == 2
    assert "max_evaluations = 2000" in capsys.readouterr().err
    assert 2 < len(out.read_text().splitlines()) < 16
