"""Loads in a report are given in the axes of the beam, for any joint axis."""

from __future__ import annotations

import pytest

import flexlink as fl
from flexlink.scene_report.parts import loads
from flexlink.scene_report.study import Study
from tests.conftest import flexible, make_scene

HELD = {"run.duration": 0.2, "run.sample": 0.01, "run.step": 1e-4}


def test_the_root_of_a_level_beam_carries_shear_and_bending_but_no_torque() -> None:
    """Shear is (1 + ρAL) g and the bending moment g L (1 + ρAL/2) for a tip mass of 1 kg and a joint about −Y."""
    link = flexible("beam", "z", 4, length=1.0, joint=fl.Joint(axis=(0.0, -1.0, 0.0)))
    weight = 9.81 * (1.0 + 2700.0 * 0.04**2)
    drive = fl.Drive(kind="pd", kp=(1e5,), kd=(1e3,), target_deg=(0.0,), gravity="static")
    scene = make_scene(
        link, tip=fl.RigidBody(mass=1.0), gravity=(0.0, 0.0, -9.81), drive=drive,
        initial=fl.InitialState(joint_deg=(0.0,), passive="static"),
    )  # fmt: skip
    root = next(line for line in loads._table(Study(scene.varied(HELD))).lines if line[0] == "beam")
    _, tension, compression, shear, torque, bending, holding = root
    assert shear == pytest.approx(weight, rel=1e-3)
    assert bending == pytest.approx(9.81 * (1.0 + 2700.0 * 0.04**2 / 2), rel=1e-3)
    assert bending == pytest.approx(holding, rel=1e-3)
    assert max(tension, compression, torque) < 1e-2 * weight
