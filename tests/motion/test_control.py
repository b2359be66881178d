"""User-defined control laws: sampled or continuous, in `simulate` and in a loop with a Simulator."""

import signal
from collections.abc import Callable

import numpy as np
import pytest

import flexlink as fl
from flexlink.motion.simulator import OFTEN
from tests.motion.test_problem import arm
from tests.support.words import refused

TARGET, KP, KD = np.radians([-80.0, -10.0]), np.array([40.0, 20.0]), np.array([1.0, 0.5])


def pd(t: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
    """The control law of the scene's drive "pd" in Python; the driven joints of `arm` are 0 and 3."""
    return KP * (TARGET - q[[0, 3]]) - KD * qd[[0, 3]]


WAYS: dict[str, dict[str, object]] = {
    "RK4": {"method": "RK4"},
    "RK10": {"method": "RK10"},
    "Gauss4": {"method": "Gauss4", "step": 5e-4},
    "Gauss6": {"method": "Gauss6", "step": 1e-3},
    "Radau5": {"method": "Radau5", "step": 1e-3},
    "Radau9": {"method": "Radau9", "step": 1e-3},
    "DOP853 within 10 µm": {"method": "DOP853", "tolerance": 1e-5},
    "Radau5 within 10 µm": {"method": "Radau5", "tolerance": 1e-5},
    "Radau9 within 10 µm": {"method": "Radau9", "tolerance": 1e-5},
    "auto within 0.1 mm": {"tolerance": 1e-4},
    "auto within 1 % of the deflection": {"relative_tolerance": 0.01, "accuracy": "deflection"},
}  # fmt: skip


@pytest.mark.parametrize("t0", [0.0, 0.07])
@pytest.mark.parametrize("way", WAYS)
def test_a_user_loop_with_the_simulator_gives_the_results_of_simulate(way: str, t0: float) -> None:
    scene = arm("none").varied({"initial.time": t0, **{f"run.{key}": value for key, value in WAYS[way].items()}})
    run = fl.simulate(scene, control=pd, rate=1000.0)
    simulator = fl.Simulator(scene)
    states = [simulator.state]
    for _ in range(80):
        states.append(simulator.step(pd(*simulator.state), duration=1e-3))
    np.testing.assert_array_equal([state.q for state in states[::10]], run.q)
    np.testing.assert_array_equal([state.qd for state in states[::10]], run.qd)
    np.testing.assert_allclose([state.t for state in states[::10]], run.t, rtol=1e-15)


@pytest.mark.parametrize("way", WAYS)
def test_a_sampled_law_gives_the_same_motion_with_every_method(way: str) -> None:
    """Torques that are constant between samples define the same problem for all methods; errors are at the tip [m]."""
    wanted = fl.simulate(arm("none"), control=pd, rate=100.0)
    run = fl.simulate(arm("none"), control=pd, rate=100.0, **WAYS[way])
    np.testing.assert_array_equal(run.tau[0], wanted.tau[0])
    allowed = 1e-6 if "step" in WAYS[way] or "run" in way else 2e-3 if "deflection" in way else 2 * 1e-4
    assert np.linalg.norm(run.tip - wanted.tip, axis=1).max() < allowed


def test_torques_of_a_sampled_law_do_not_act_before_their_sample_time() -> None:
    """Adaptive steps end at the sampling times of the law."""
    push = {0.0: [0.0, 0.0], 0.04: [5.0, -2.0]}
    scene = arm("none", **{"run.sample": 0.02}).varied({"run.tolerance": 1e-4})
    run = fl.simulate(scene, control=lambda t, q, qd: push[max(s for s in push if s <= t + 1e-12)], rate=50.0)
    free = fl.simulate(scene, control=lambda t, q, qd: [0.0, 0.0], rate=50.0)
    np.testing.assert_array_equal(run.q[:3], free.q[:3])
    assert run.tau[:, run.chain.active].tolist() == [[0.0, 0.0]] * 2 + [[5.0, -2.0]] * 3
    assert np.abs(run.q[3] - free.q[3]).max() > 1e-4


def test_recorded_torques_of_a_law_reproduce_the_run() -> None:
    run = fl.simulate(arm("none", **{"run.sample": 0.001}), control=pd, rate=1000.0)
    torques = run.tau[:, run.chain.active]
    drive = {"kind": "table", "hold": True, "times": run.t.tolist(), "torques": torques.tolist()}
    again = fl.simulate(arm("none").varied({"run.sample": 0.001, "drive": drive}))
    np.testing.assert_array_equal(again.q, run.q)
    np.testing.assert_array_equal(again.tau, run.tau)
    np.testing.assert_array_equal(again.work, run.work)


def test_a_continuous_law_in_python_equals_the_same_drive_of_the_scene() -> None:
    """Both laws use the same formula at each stage, but NumPy rounds sums differently, by a few ulp in 3200 stages."""
    law, drive = fl.simulate(arm("none"), control=pd), fl.simulate(arm("pd"))
    np.testing.assert_allclose(law.q, drive.q, rtol=0, atol=1e-11)
    np.testing.assert_allclose(law.tau, drive.tau, rtol=0, atol=1e-9)
    np.testing.assert_allclose(law.work, drive.work, rtol=0, atol=1e-10)


BROKEN = {
    "raises": lambda t, q, qd: [1 / 0, 0.0] if t > 0.025 else [0.0, 0.0],
    "shape": lambda t, q, qd: [1.0] if t > 0.025 else [0.0, 0.0],
    "nan": lambda t, q, qd: [np.nan, 0.0] if t > 0.025 else [0.0, 0.0],
    "complex": lambda t, q, qd: [1j, 0.0] if t > 0.025 else [0.0, 0.0],
    "text": lambda t, q, qd: ["a", "b"] if t > 0.025 else [0.0, 0.0],
}


@pytest.mark.parametrize("way", ["RK4", "Gauss4", "Radau9 within 10 µm", "DOP853 within 10 µm"])
@pytest.mark.parametrize("broken", BROKEN)
def test_a_failing_law_is_reported_with_its_time_and_the_samples_are_kept(broken: str, way: str) -> None:
    for rate in [100.0, None] if way == "RK4" else [100.0]:
        with refused(fl.errors.ControlError, "controller-failed") as caught:
            fl.simulate(arm("none"), control=BROKEN[broken], rate=rate, **WAYS[way])
        kept = caught.value.trajectory
        assert kept.t.tolist() == pytest.approx([0.0, 0.01, 0.02])
        free = fl.simulate(arm("none"), control=lambda t, q, qd: [0.0, 0.0], rate=rate, **WAYS[way], duration=0.02)
        np.testing.assert_allclose(kept.q, free.q, rtol=0, atol=1e-5 if "within" in way else 1e-13)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rate": 100.0}, "no-effect"),
        ({"control": pd, "rate": 3000.0}, "not-a-multiple"),
        ({"control": pd, "rate": -1.0}, "out-of-range"),
        ({"control": pd, "rate": 1e-3}, "likely-unit"),
        ({"control": 3.0}, "wrong-type"),
        ({"control": pd, "tolerance": 1e-4}, "controller-needs-rate"),
        ({"control": pd, "method": "Gauss4"}, "controller-needs-rate"),
        ({"control": pd, "rate": 100.0, "t0": 0.005}, "not-a-multiple"),
        ({"control": pd}, "both-given"),
    ],
)  # fmt: skip
def test_invalid_control_arguments_are_refused(given: dict[str, object], message: str) -> None:
    with refused(fl.errors.ArgumentError, message):
        fl.simulate(arm("pd" if message == "both-given" else "none"), **given)


def test_a_simulator_keeps_its_state_if_the_energy_does_not_balance() -> None:
    simulator = fl.Simulator(arm("none", **{"run.step": 0.01, "run.unstable": "allow"}))
    with refused(fl.errors.DivergenceError, "energy-imbalance") as caught:
        while True:
            before, energies = simulator.state, simulator._monitor._balance.seen.copy()
            simulator.step([0.0, 0.0])
    np.testing.assert_array_equal(simulator._monitor._balance.seen, energies)
    np.testing.assert_array_equal(simulator.state.q, before.q)
    np.testing.assert_array_equal(caught.value.trajectory.q[-1], before.q)


@pytest.mark.parametrize("way", ["RK4", "Gauss4", "Radau5 within 10 µm", "DOP853 within 10 µm"])
def test_a_refused_call_does_not_change_the_simulator(way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The state, the energies used to check later calls, and the memory of the method are unchanged."""
    scene = arm("none").varied({f"run.{key}": value for key, value in WAYS[way].items()})
    disturbed, other = fl.Simulator(scene), fl.Simulator(scene)
    for k in range(20):
        if k % 5 == 3:
            before, judged = disturbed.state, disturbed._monitor._balance.seen.copy()
            implicit = way.startswith(("Gauss", "Radau"))
            with refused(fl.errors.DivergenceError, "newton-failed" if implicit else "diverged"):
                disturbed.step([1e200, -1e200], duration=0.01)
            assert disturbed.time == before.t
            np.testing.assert_array_equal(disturbed._monitor._balance.seen, judged)
            with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
                patch.setattr(disturbed._monitor, "unbalanced", lambda *_: interrupted())
                disturbed._calls = OFTEN - 1
                disturbed.step([1.0, 0.0], duration=0.01)
            disturbed._calls = other._calls
        torque = pd(*disturbed.state)
        for one, same in zip(disturbed.step(torque, duration=1e-3), other.step(torque, duration=1e-3), strict=True):
            np.testing.assert_array_equal(one, same)


def test_a_simulator_that_is_reset_again_and_again_moves_as_a_new_one() -> None:
    scene = arm("none").varied({"run.tolerance": 1e-3})
    used = fl.Simulator(scene)
    for _ in range(4):
        used.reset()
        new = fl.Simulator(scene)
        for _ in range(10):
            np.testing.assert_array_equal(used.step(duration=0.01).q, new.step(duration=0.01).q)
        for _ in range(10):  # the gains of this law are estimated
            used.step(-5.0 * used.state.qd[[0, 3]], duration=0.01)


def interrupted() -> str:
    raise KeyboardInterrupt


@pytest.mark.parametrize("answer", [lambda: signal.raise_signal(signal.SIGINT), interrupted])
@pytest.mark.parametrize("way", ["RK4", "Gauss4", "Radau5 within 10 µm"])
def test_ctrl_c_keeps_the_samples_of_a_run_with_a_control_law(way: str, answer: Callable[[], object]) -> None:
    """The signal arrives while the law runs, or a handler set by the law raises an exception."""

    def law(t: float, q: np.ndarray, qd: np.ndarray) -> list[float]:
        if t == pytest.approx(0.025):
            answer()
        return [0.0, 0.0]

    with pytest.raises(fl.errors.InterruptedRunError) as caught:
        fl.simulate(arm("none"), control=law, rate=1000.0, **{**WAYS[way], "duration": 50.0})
    kept = caught.value.trajectory
    assert 3 <= len(kept.t) < 4000
    free = fl.simulate(arm("none"), control=lambda t, q, qd: [0.0, 0.0], rate=1000.0, **WAYS[way], duration=0.02)
    np.testing.assert_allclose(kept.q[:3], free.q, rtol=0, atol=1e-5 if "within" in way else 0)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.step([1.0]), "wrong-shape"),
        (lambda s: s.step([np.inf, 0.0]), "not-finite"),
        (lambda s: s.step(duration=0.00015), "not-a-multiple"),
        (lambda s: s.step(duration=[1e-3]), "out-of-range"),
        (lambda s: s.step(duration=0.0), "out-of-range"),
        (lambda s: s.reset([0.0]), "one-per-joint"),
    ],
)
def test_unsupported_simulator_calls_are_refused(call, message: str) -> None:
    with refused(fl.FlexlinkError, message):
        call(fl.Simulator(arm("none")))


def test_a_simulator_refuses_an_unstable_step_size() -> None:
    with refused(fl.errors.UnstableStepError, "unstable-step"):
        fl.Simulator(arm("none", **{"run.step": 0.01}))
