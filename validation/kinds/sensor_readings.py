"""Sensors of a rigid link, turned from rest by a constant torque, against closed forms.

With α = τ/I the rate is α t; a point at r has the acceleration (−r α² t², r α, 0) in the link's axes. SciPy applies the
Butterworth low-pass filter, given by its analogue coefficients, to the rate.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from scipy import signal

import flexlink as fl
from flexlink.common.types import Array
from validation.case import Case, Measured


def run(case: Case) -> Iterator[Measured]:
    """Yield the largest error of every column, relative to its largest value."""
    for scene in case.load_scenes():
        found = fl.simulate(scene)
        for name, exact in _exact(scene, found.t).items():
            error = float(np.abs(found.columns[name] - exact).max() / np.abs(exact).max())
            yield Measured(name.partition(" [")[0], error, scene.name)


def _exact(scene: fl.Scene, t: Array) -> Mapping[str, Array]:
    """Exact columns by name, from the values in the scene's file."""
    (link,), sensors = scene.arm.links, {sensor.name: sensor for sensor in scene.sensor}
    assert scene.drive.torque is not None
    body, (torque,), r = link.hub, scene.drive.torque, link.length
    α = torque / (body.inertia[2] + body.mass * body.center[0] ** 2)
    gyro, slow, motor = sensors["gyro"], sensors["slow gyro"], sensors["motor"]
    assert slow.low_pass is not None and slow.order is not None and motor.torque_constant is not None
    butter = signal.butter(slow.order, 2 * np.pi * slow.low_pass, analog=True)
    return {
        "imu x [m/s²]": -r * (α * t) ** 2,
        "imu y [m/s²]": np.full(len(t), r * α),
        "gyro [V]": gyro.gain * α * np.maximum(t - gyro.delay, 0.0) + gyro.bias,
        "slow gyro [rad/s]": signal.lsim(butter, α * t, t)[1],
        "encoder [rad]": np.radians(scene.initial.joint_deg[0]) + α * t**2 / 2,
        "motor [A]": np.full(len(t), torque / motor.torque_constant),
    }
