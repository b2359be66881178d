"""Control laws from outside: sampled or continuous, in `simulate` and in a loop of one's own with a Simulator."""

from __future__ import annotations

import numpy as np
import pytest
from test_continued import arm

import flexlink as fl

TARGET, KP, KD = np.radians([-80.0, -10.0]), np.array([40.0, 20.0]), np.array([1.0, 0.5])


def pd(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """The law of the scene with the drive "pd": the joints of `arm` are 0 and 3."""
    return KP * (TARGET - q[[0, 3]]) - KD * qd[[0, 3]]


def test_a_loop_of_ones_own_gives_the_numbers_of_simulate() -> None:
    scene = arm("none")
    run = fl.simulate(scene, control=pd, rate=1000.0)
    simulator = fl.Simulator(scene)
    states = [simulator.state]
    while simulator.time < 0.0799:
        states.append(simulator.step(pd(*simulator.state), duration=1e-3))
    np.testing.assert_array_equal([state.q for state in states[::10]], run.q)
    np.testing.assert_array_equal([state.qd for state in states[::10]], run.qd)


def test_what_a_law_gave_can_be_played_back() -> None:
    run = fl.simulate(arm("none", **{"run.sample": 0.001}), control=pd, rate=1000.0)
    torques = run.tau[:, run.chain.active]
    drive = {"kind": "table", "hold": True, "times": run.t.tolist(), "torques": torques.tolist()}
    again = fl.simulate(arm("none").varied({"run.sample": 0.001, "drive": drive}))
    np.testing.assert_array_equal(again.q, run.q)
    np.testing.assert_array_equal(again.tau, run.tau)
    np.testing.assert_array_equal(again.work, run.work)


def test_a_continuous_law_is_the_same_as_a_drive_of_the_scene() -> None:
    """Both evaluate one formula at the stages; numpy's sums round otherwise: 3200 evaluations of a few ulp."""
    law, drive = fl.simulate(arm("none"), control=pd), fl.simulate(arm("pd"))
    np.testing.assert_allclose(law.q, drive.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(law.tau, drive.tau, rtol=0, atol=1e-9)
    np.testing.assert_allclose(law.work, drive.work, rtol=0, atol=1e-10)


def test_a_sampled_law_goes_to_the_continuous_one_with_its_rate() -> None:
    wanted = fl.simulate(arm("none"), control=pd)
    errors = [np.abs(fl.simulate(arm("none"), control=pd, rate=rate).q - wanted.q).max() for rate in (500.0, 1000.0)]
    assert errors[1] / errors[0] == pytest.approx(0.5, abs=0.05)  # a delay of half a period on average


def test_a_run_under_a_law_is_continued_to_the_bit() -> None:
    whole = fl.simulate(arm("none"), control=pd, rate=500.0)
    t, q, qd = whole.state(4)
    rest = fl.simulate(arm("none"), control=pd, rate=500.0, q0=q, qd0=qd, t0=t, duration=0.04)
    np.testing.assert_array_equal(rest.q, whole.q[4:])
    np.testing.assert_array_equal(rest.tau, whole.tau[4:])


def test_the_work_of_a_law_balances() -> None:
    run = fl.simulate(arm("none"), control=pd, rate=1000.0)
    assert run.warnings == ()
    assert np.abs(run.imbalance).max() < 1e-6 * run.exchanged[-1]


BROKEN = {
    "raises": (lambda t, q, qd: [1 / 0, 0.0] if t > 0.025 else [0.0, 0.0], "ZeroDivisionError"),
    "shape": (lambda t, q, qd: [1.0] if t > 0.025 else [0.0, 0.0], r"gave \[1.0\]; expected .* shape \(2,\)"),
    "nan": (lambda t, q, qd: [np.nan, 0.0] if t > 0.025 else [0.0, 0.0], "finite number per driven joint"),
    "complex": (lambda t, q, qd: [1j, 0.0] if t > 0.025 else [0.0, 0.0], "finite number per driven joint"),
    "text": (lambda t, q, qd: ["a", "b"] if t > 0.025 else [0.0, 0.0], "finite number per driven joint"),
}


@pytest.mark.parametrize("rate", [100.0, None])
@pytest.mark.parametrize("broken", BROKEN)
def test_a_law_that_fails_is_named_with_its_time_and_what_was_computed_is_kept(broken: str, rate: float | None) -> None:
    law, message = BROKEN[broken]
    with pytest.raises(fl.ControlError, match=rf"t = 0\.0\d* s: control law .*lambda.*{message}") as caught:
        fl.simulate(arm("none"), control=law, rate=rate)
    kept = caught.value.trajectory
    assert kept.t.tolist() == pytest.approx([0.0, 0.01, 0.02])
    free = fl.simulate(arm("constant", **{"drive.torque": [0.0, 0.0]}), duration=0.02)
    np.testing.assert_allclose(kept.q, free.q, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate": 100.0}, "rate = 100.0: there is no control"),
        ({"control": pd, "rate": 3000.0}, r"1 / rate = 0.000333333 s must be a multiple of run.step = 0.0001 s"),
        ({"control": pd, "rate": -1.0}, "rate = -1.0: must be a finite number > 0"),
        ({"control": 3.0}, "control = 3.0: expected a function"),
        ({"control": pd, "tolerance": 1e-4}, "fixed steps of an explicit method"),
        ({"control": pd, "rate": 100.0, "t0": 0.005}, "t0 = 0.005: must be a multiple of 1 / rate, 0.01 s"),
    ],
)  # fmt: skip
def test_a_law_that_cannot_be_asked_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(fl.ArgumentError, match=message):
        fl.simulate(arm("none"), **given)


def test_a_law_beside_a_drive_is_refused() -> None:
    with pytest.raises(fl.ArgumentError, match="the scene has a drive, 'pd', too"):
        fl.simulate(arm("pd"), control=pd)


def test_a_simulator_without_torques_is_driven_by_its_scene() -> None:
    scene = arm("smooth")
    simulator, run = fl.Simulator(scene), fl.simulate(scene)
    for k in range(1, 9):
        np.testing.assert_array_equal(simulator.step().q, run.q[k])
    t, q, qd = run.state(5)
    assert simulator.reset(q, qd, time=t).t == pytest.approx(0.05)
    np.testing.assert_array_equal(simulator.step().q, run.q[6])


def test_a_simulator_that_leaves_the_finite_numbers_stays_where_it_was() -> None:
    simulator = fl.Simulator(arm("none", **{"run.step": 0.01, "run.unstable": "allow"}))
    with pytest.raises(fl.DivergenceError, match=r"no longer finite|does not balance") as caught:
        while True:
            before = simulator.state
            simulator.step([0.0, 0.0])
    np.testing.assert_array_equal(simulator.state.q, before.q)
    np.testing.assert_array_equal(caught.value.trajectory.q[-1], before.q)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.step([1.0]), r"tau has shape \(1,\); expected \(2,\)"),
        (lambda s: s.step([np.inf, 0.0]), r"tau\[0\] = inf is not finite"),
        (lambda s: s.step(duration=0.00015), "duration = 0.00015: must be a multiple of run.step"),
        (lambda s: s.step(duration=0.0), "duration = 0.0: must be a finite number > 0"),
        (lambda s: s.reset([0.0]), "expected one number per joint, 6"),
    ],
)
def test_what_a_simulator_cannot_do_is_refused(call, message: str) -> None:
    with pytest.raises(fl.FlexlinkError, match=message):
        call(fl.Simulator(arm("none")))


def test_a_simulator_refuses_a_step_that_would_blow_up() -> None:
    with pytest.raises(fl.UnstableStepError, match=r"run\.step = 0\.01 s: more than .* the largest stable step of RK4"):
        fl.Simulator(arm("none", **{"run.step": 0.01}))
