"""A step of a PD controller's target on a rigid link: motion, settling time and overshoot of a second-order system."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.spec import Positive
from validation.case import Case, Measured
from validation.oracles.rigid_motions import Servo


def run(case: Case, within: Positive) -> Iterator[Measured]:
    """Yield errors of angle, overshoot and settling time; `within` is the settling tolerance [m]."""
    for scene in case.load_scenes():
        found, servo, r = fl.simulate(scene), _servo(scene), scene.arm.links[0].length
        exact = np.array([servo.angle(t) for t in found.t.tolist()])
        yield Measured("angle", float(np.abs(found.q[:, 0] - exact).max()), scene.name)
        target, start = _position(r, servo.target), _position(r, 0.0)
        way = (target - start) / np.linalg.norm(target - start)
        beyond = float((_position(r, servo.peak) - target) @ way)
        error = abs(found.overshoot(target=target) / beyond - 1)
        yield Measured("overshoot", error, scene.name, note=f"{1e3 * beyond:.6g} mm in closed form.")
        at = servo.settled(2 * math.asin(within / (2 * r)))  # angle of a chord `within` of the tip's circle
        late = (found.settling_time(target=target, tolerance=within) - at) / scene.run.spacing
        yield Measured("settling time, samples early", -late, scene.name)
        yield Measured("settling time, samples late", late, scene.name, note=f"{at:.6g} s in closed form.")


def _position(r: float, angle: float) -> Array:
    return np.array([r * math.cos(angle), r * math.sin(angle), 0.0])


def _servo(scene: fl.Scene) -> Servo:
    """The closed-form servo, from the values in the scene's file."""
    body, drive = scene.arm.links[0].hub, scene.drive
    assert drive.kp is not None and drive.kd is not None and drive.target_deg is not None
    inertia = body.inertia[2] + body.mass * body.center[0] ** 2
    return Servo(inertia, drive.kp[0], drive.kd[0], math.radians(drive.target_deg[0]))
