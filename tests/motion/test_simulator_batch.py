"""SimulatorBatch: many arms that the caller advances together, equal to a Simulator of each."""

import numpy as np
import pytest

import flexlink as fl
from tests.conftest import flexible, make_scene
from tests.support.words import refused

RUN = fl.RunSettings(step=1e-4, duration=0.1, sample=0.002)


def scenes(count: int, **changes: object) -> list[fl.Scene]:
    """Arms that differ in their payload."""
    motor = fl.Joint(armature=2.0)
    arm = make_scene(flexible("a", segments=2, joint=motor), flexible("b", segments=2, joint=motor))
    arm = arm.varied({"run": RUN, **changes})
    return [arm.varied({"tip.mass": 1.0 + k}) for k in range(count)]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("count", [1, 8, 11])
def test_states_are_those_of_a_simulator_of_each_arm(count: int, threads: int, rng: np.random.Generator) -> None:
    arms, singles = fl.SimulatorBatch(scenes(count), threads=threads), [fl.Simulator(each) for each in scenes(count)]
    assert len(arms) == count and len(arms.chains) == count
    for duration in (0.002, 0.001, None):
        tau = rng.normal(size=(count, 2)) * 20.0
        after = arms.step(tau, duration=duration)
        for k, single in enumerate(singles):
            expected = single.step(tau[k], duration=duration)
            assert after.t == expected.t
            np.testing.assert_array_equal(after.q[k], expected.q)
            np.testing.assert_array_equal(after.qd[k], expected.qd)


@pytest.mark.parametrize("kind", ["pd", "cascade", "computed_torque"])
def test_the_drives_of_the_scenes_act_as_in_a_simulator(kind: str) -> None:
    gains = {"kp": (9.0, 9.0), "kd": (6.0, 2.0)} | ({"ki": (3.0, 3.0)} if kind == "cascade" else {})
    drive = fl.Drive(kind=kind, **gains, target_deg=(20.0, -10.0), rate=500.0, delay=0.001)
    driven = scenes(9, drive=drive)
    arms, singles = fl.SimulatorBatch(driven), [fl.Simulator(each) for each in driven]
    for _ in range(5):
        np.testing.assert_array_equal(arms.step().q, [single.step().q for single in singles])
    first = arms.reset().q
    np.testing.assert_array_equal(first, [single.reset().q for single in singles])
    np.testing.assert_array_equal(arms.step().q, [single.step().q for single in singles])
    with refused(fl.errors.ArgumentError, "together-only"):
        arms.reset([0])


def test_effort_limits_the_torques_of_the_caller() -> None:
    limited = scenes(2, drive=fl.Drive(effort=(5.0, 5.0)))
    arms, single = fl.SimulatorBatch(limited), fl.Simulator(limited[1])
    np.testing.assert_array_equal(arms.step([[9.0, 9.0], [99.0, -99.0]]).q[1], single.step([99.0, -99.0]).q)


def test_some_arms_restart_while_others_continue() -> None:
    given = scenes(10)
    arms, going = fl.SimulatorBatch(given), fl.Simulator(given[0])
    tau = np.full((10, 2), 9.0)
    arms.step(tau)
    going.step(tau[0])
    q = np.full((2, 4), 0.1)
    seen = arms.reset([3, 9], q=q, qd=np.zeros(4))
    np.testing.assert_array_equal(seen.q[[3, 9]], q)
    mask = np.arange(10) == 4
    assert not arms.reset(mask).q[4].any()
    after = arms.step(tau)
    np.testing.assert_array_equal(after.q[0], going.step(tau[0]).q)
    fresh = fl.Simulator(given[9])
    fresh.reset(q[0], np.zeros(4))
    np.testing.assert_array_equal(after.q[9], fresh.step(tau[0]).q)
    assert after.t == pytest.approx(0.004) and arms.reset().t == 0.0


def test_a_diverging_arm_is_named_and_no_arm_moves() -> None:
    arms = fl.SimulatorBatch(scenes(9))
    before = arms.step(np.zeros((9, 2)))
    tau = np.zeros((9, 2))
    tau[8] = 1e300
    with refused(fl.errors.DivergenceError, "diverged") as caught:
        arms.step(tau)
    assert caught.value.arms == (8,)
    np.testing.assert_array_equal(arms.state.q, before.q)
    assert arms.time == before.t
    np.testing.assert_array_equal(arms.step(np.zeros((9, 2))).q[:8], fl.SimulatorBatch(scenes(8)).step(
        np.zeros((8, 2)), duration=0.004).q)  # fmt: skip


def test_an_arm_whose_energy_does_not_balance_is_named() -> None:
    """With steps beyond the stable one, energy grows."""
    coarse = scenes(3, run=fl.RunSettings(step=1e-2, duration=0.1, sample=0.01, unstable="allow"))
    arms = fl.SimulatorBatch(coarse)
    arms.reset(qd=np.full(4, 0.5))
    with pytest.raises(fl.errors.DivergenceError) as caught:
        for _ in range(64):
            arms.step(np.zeros((3, 2)))
    assert caught.value.arms


@pytest.mark.parametrize("arms", [[3], [-1], [0.5], np.ones(2, bool), [[0]]])
def test_unknown_arms_are_refused(arms: object) -> None:
    with refused(fl.errors.ArgumentError, "wrong-value"):
        fl.SimulatorBatch(scenes(3)).reset(arms)


def test_what_cannot_be_advanced_side_by_side_is_refused() -> None:
    one, other = scenes(2)
    with refused(fl.errors.ArgumentError, "empty"):
        fl.SimulatorBatch([])
    with refused(fl.errors.ArgumentError, "not-similar"):
        fl.SimulatorBatch([one, other.varied({"run.step": 5e-5})])
    with refused(fl.errors.ArgumentError, "not-similar"):
        fl.SimulatorBatch([one.varied({"run": fl.RunSettings(duration=0.1, tolerance=1e-4)})])
    with pytest.raises(fl.errors.UnstableStepError):
        fl.SimulatorBatch([one.varied({"run.step": 2e-2, "run.sample": 0.02})])
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.SimulatorBatch([one, other]).step([1.0, 2.0])
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        fl.SimulatorBatch([one, other]).reset(q=np.full(4, np.nan))
