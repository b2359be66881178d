"""The manufactured solution: its torque is that of the equations, every term counts, and a wrong one is seen."""

from __future__ import annotations

import numpy as np
import pytest
from mpmath import mp, mpf

import flexlink as fl
from validation.case import scene_file
from validation.kinds import manufactured as kind
from validation.oracles import manufactured
from validation.oracles.manufactured import Motion

SCENE = fl.load_scene(scene_file("every_term"))


@pytest.fixture(scope="module")
def moved() -> Motion:
    return manufactured.motion(fl.lump(SCENE), (0.6, 0.08), (2.0, 6.0), seed=1)


def test_rates_and_accelerations_are_the_slopes_of_the_angles(moved: Motion) -> None:
    with mp.workdps(50):
        h, t = mpf(10) ** -12, mpf("0.3")
        before, here, after = (moved.at(t + side * h) for side in (-1, 0, 1))
        for k in range(len(here[0])):
            assert (after[0][k] - before[0][k]) / (2 * h) == pytest.approx(here[1][k], abs=1e-20)
            assert (after[1][k] - before[1][k]) / (2 * h) == pytest.approx(here[2][k], abs=1e-20)


def test_the_torque_gives_back_the_accelerations(moved: Motion) -> None:
    chain, wrench = fl.lump(SCENE), kind._wrench(SCENE)
    for t in (0.0, 0.21, 0.5):
        ((torque,), (q, qd)) = manufactured.torques(chain, [t], moved, wrench), manufactured.states([t], moved)
        load = np.array(wrench(mpf(t)), dtype=float)
        qdd = fl.forward_dynamics(chain, q[0], qd[0], torque, tip_wrench=load)
        exact = np.array(moved.at(mpf(t))[2], dtype=float)
        assert np.abs(qdd - exact).max() < 1e-10 * np.abs(exact).max()


TERMS = {
    "gravity": {"gravity": [0.5, -0.3, -9.8]},
    "a sliding mass": {"link.carriage.hub.mass": 12.01},
    "dry friction": {"link.boom.joint.coulomb": 3.001},
    "viscous friction": {"link.fore.joint.viscous": 0.501},
    "a rotor": {"link.waist.joint.armature": 0.501},
    "an elastic gear": {"link.waist.joint.gear_stiffness": 60.01},
    "springs": {"material.polymer.young": 4.001e7},
    "structural damping": {"material.polymer.loss_time": 2.1e-3},
    "the payload's inertia": {"tip.inertia": [0.01, 0.012, 0.0081]},
    "the payload's place": {"tip.center": [0.05, 0.02, 0.0301]},
    "a mount": {"link.mast.mount.xyz": [-0.1, 0.101, 0.1]},
    "the branch": {"link.mast.length": 0.501},
    "drag": {"link.fore.drag.coefficient": 2.001},
    "the wrench": {"wrench.moments": [[0.5, 0.2, -0.4], [-0.3, 0.6, 0.701]]},
}


@pytest.mark.parametrize("change", TERMS.values(), ids=TERMS)
def test_a_small_mistake_in_any_term_makes_another_torque(change: dict[str, object], moved: Motion) -> None:
    wrong = SCENE.varied(change)
    right = manufactured.torques(fl.lump(SCENE), [0.4], moved, kind._wrench(SCENE))
    other = manufactured.torques(fl.lump(wrong), [0.4], moved, kind._wrench(wrong))
    assert np.abs(other - right).max() > 1e-6 * np.abs(right).max()
