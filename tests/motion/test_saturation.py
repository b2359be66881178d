"""Saturating motors: steps meet their tolerance even when torques reach or leave their limit within a step."""

import numpy as np
import pytest

import flexlink as fl
from tests.campaigns.random_motors import WRONG, judged, outcomes
from tests.conftest import compiled

pytestmark = compiled

LOAD, EFFORT = 0.25, 2.0
"""A motor turns a rigid link of 1 m, with 0.25 kg m² about its joint, through an elastic gear."""


@pytest.fixture(scope="module")
def geared() -> fl.Scene:
    joint = fl.Joint(armature=0.03, gear_stiffness=1500.0, gear_damping=1.0)
    link = fl.Link(
        name="arm", length=1.0, joint=joint, hub=fl.RigidBody(mass=0.25, inertia=(LOAD, LOAD, LOAD))
    )  # the mass of a hub is at the joint
    return fl.Scene(
        name="saturated", arm=fl.Arm(links=(link,)), gravity=(0.0, 0.0, 0.0),
        initial=fl.InitialState(joint_deg=(60.0,)),
        drive=fl.Drive(kind="pd", kp=(100.0,), kd=(6.0,), target_deg=(0.0,), effort=(EFFORT,)),
        run=fl.RunSettings(method="auto", duration=1.0, sample=0.02, tolerance=1e-4),
    )  # fmt: skip


@pytest.fixture(scope="module")
def exact(geared: fl.Scene) -> np.ndarray:
    """Tip at the samples by SciPy: one linear equation of motion per branch of the torque."""
    return judged(geared, geared.run.times)


@pytest.mark.parametrize("method", ["auto", "DOP853", "Radau5", "Radau9"])
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_a_saturating_motor_on_an_elastic_gear_follows_the_exact_solution(geared, exact, method, tolerance) -> None:
    run = fl.simulate(geared, method=method, tolerance=tolerance)
    error = np.linalg.norm(run.tip - exact, axis=1).max()
    assert error <= WRONG * tolerance or run.warnings  # measured: 3.3; 1,100 if kinks are inside steps


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
