"""A motor of limited torque turns a link through an elastic gear: comparison with SciPy, which stops at each switch."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.spec import Positive
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles.rigid_motions import Motor


def run(
    case: Case, steps: dict[str, Positive], methods: tuple[str, ...], tolerances: tuple[Positive, ...]
) -> Iterator[Measured]:
    """Yield tip errors of runs with fixed steps [s], and of runs with tolerances [m], in units of the tolerance."""
    for scene in case.load_scenes():
        exact = _tips(scene)
        for method, step in steps.items():
            found = fl.simulate(scene, method=method, step=step)
            yield Measured(
                "tip error, fixed steps", _apart(found, exact), scene.name, varied={"method": method, "step": step}
            )
        for method in methods:
            for tolerance in tolerances:
                found = fl.simulate(scene, method=method, tolerance=tolerance)
                facts: Facts = {"method": method, "tolerance": tolerance}
                warnings = "; ".join(found.warnings)
                yield Measured(
                    "tip error / tolerance", _apart(found, exact) / tolerance, scene.name, varied=facts, note=warnings
                )


def _tips(scene: fl.Scene) -> Array:
    """Tip at the scene's samples, from the values in its file."""
    (link,), drive = scene.arm.links, scene.drive
    joint = link.joint
    assert (
        drive.kp is not None and drive.kd is not None and drive.effort is not None and joint.gear_stiffness is not None
    )
    motor = Motor(joint.armature, link.hub.inertia[2], joint.gear_stiffness, joint.gear_damping,
                  drive.kp[0], drive.kd[0], drive.effort[0])  # fmt: skip
    angle = motor.link_angles(float(np.radians(scene.initial.joint_deg[0])), np.asarray(scene.run.times))
    return link.length * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _apart(run: fl.Trajectory, exact: Array) -> float:
    return float(np.linalg.norm(run.tip[:, :2] - exact, axis=1).max())
