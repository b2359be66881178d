"""Saturating motors: steps meet their tolerance even when torques reach or leave their limit within a step."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexlink as fl
from tests.campaigns.random_motors import WRONG, outcomes
from tests.conftest import compiled

pytestmark = compiled

ROTOR, LOAD, GEAR, LOSS, KP, KD, EFFORT, START = 0.03, 0.25, 1500.0, 1.0, 100.0, 6.0, 2.0, np.radians(60.0)
"""A motor turns a rigid link of 1 m, with 0.25 kg m² about its joint, through an elastic gear."""


@pytest.fixture(scope="module")
def geared() -> fl.Scene:
    joint = fl.Joint(armature=ROTOR, gear_stiffness=GEAR, gear_damping=LOSS)
    link = fl.Link(
        name="arm", length=1.0, joint=joint, hub=fl.RigidBody(mass=0.25, inertia=(LOAD, LOAD, LOAD))
    )  # the mass of a hub is at the joint
    return fl.Scene(
        name="saturated", arm=fl.Arm(links=(link,)), gravity=(0.0, 0.0, 0.0),
        initial=fl.InitialState(joint_deg=(60.0,)),
        drive=fl.Drive(kind="pd", kp=(KP,), kd=(KD,), target_deg=(0.0,), effort=(EFFORT,)),
        run=fl.RunSettings(method="auto", duration=1.0, sample=0.02, tolerance=1e-4),
    )  # fmt: skip


@pytest.fixture(scope="module")
def exact(geared: fl.Scene) -> np.ndarray:
    """Exact angle of the link at the samples: one linear equation of motion per branch of the torque."""

    def requested(y: np.ndarray) -> float:
        return float(-KP * y[0] - KD * y[2])

    def motion(side: int) -> Callable[[float, np.ndarray], list[float]]:
        def slope(t: float, y: np.ndarray) -> list[float]:
            spring = GEAR * (y[0] - y[1]) + LOSS * (y[2] - y[3])
            return [y[2], y[3], ((side * EFFORT if side else requested(y)) - spring) / ROTOR, spring / LOAD]

        return slope

    def reaching(level: float) -> Callable[[float, np.ndarray], float]:
        def event(t: float, y: np.ndarray) -> float:
            return requested(y) - level

        event.terminal = True  # type: ignore[attr-defined]
        return event

    times, t, y, side, switches = np.linspace(0, 1, 51), 0.0, np.array([START, START, 0.0, 0.0]), -1, 0
    angles = np.full(51, START)
    while t < 1.0:
        events = [reaching(-EFFORT), reaching(EFFORT)]
        part = solve_ivp(motion(side), (t, 1.0), y, method="DOP853", rtol=1e-12, atol=1e-13, events=events,
                         dense_output=True, first_step=1e-7)  # fmt: skip
        inside = (times > t) & (times <= part.t[-1])
        angles[inside] = part.sol(times[inside])[1]
        t, y = part.t[-1], part.y[:, -1]
        if part.status == 1:
            level, switches = (-1 if requested(y) < 0 else 1), switches + 1
            side = 0 if side else level
            onward = solve_ivp(motion(side), (t, t + 1e-9), y, rtol=1e-10, atol=1e-13)  # away from switching times
            t, y = t + 1e-9, onward.y[:, -1]
    assert switches == 2
    return angles


@pytest.mark.parametrize("method", ["auto", "DOP853", "Radau5", "Radau9"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_a_saturating_motor_on_an_elastic_gear_follows_the_exact_solution(geared, exact, method, tolerance) -> None:
    run = fl.simulate(geared, method=method, tolerance=tolerance)
    error = np.linalg.norm(run.tip[:, :2] - np.stack([np.cos(exact), np.sin(exact)], axis=1), axis=1).max()
    assert error <= WRONG * tolerance or run.warnings  # measured: 3.3; 1,100 if kinks are inside steps


def test_torques_of_a_run_stay_within_the_effort_and_reach_it(geared: fl.Scene) -> None:
    run = fl.simulate(geared, tolerance=1e-5)
    assert np.abs(run.tau).max() == EFFORT
    assert (np.abs(run.tau) < EFFORT).any()


def test_a_torque_limit_that_is_never_reached_has_no_effect_beyond_the_tolerance(geared: fl.Scene) -> None:
    free = fl.simulate(geared.varied({"drive.effort": None}))
    wide = fl.simulate(geared.varied({"drive.effort": (1e6,)}))
    assert wide.steps == free.steps
    assert np.array_equal(wide.q, free.q)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_arms_with_saturating_motors_meet_the_tolerance(seed: int) -> None:
    for one in outcomes(seed, (1e-3, 1e-6)):
        assert one.word in {"right", "warned", "no truth"}, one
