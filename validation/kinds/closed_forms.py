"""Rigid motors, sensors, satellites, and scenes without a length, against closed forms and SciPy."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy import signal

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.spec import Positive
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.oracles.rigid_motions import Body, Motor, Servo, rotation

Way = dict[str, Any]  # keys of `run`


def _apart(found: Array, exact: Array) -> float:
    """Largest difference, relative to the largest exact value."""
    return float(np.abs(found - exact).max() / np.abs(exact).max())


def _run(scene: fl.Scene, way: Way) -> fl.Trajectory:
    return fl.simulate(scene.varied({f"run.{key}": value for key, value in way.items()}))


@kind
def without_length(case: Case, ways: tuple[Way, ...]) -> Iterator[Measured]:
    """A cart on a spring and a driven wheel: error of the coordinate by integration settings; {} is the default.

    m ẍ = −k x − d ẋ        x = x₀ e^(−σt) (cos ωt + σ/ω sin ωt)
    I ω̇ = τ − d ω          θ = τ/d (t − I/d (1 − e^(−dt/I)))
    """
    for scene in case.load_scenes():
        exact = _coordinate(scene, np.asarray(scene.run.times))
        for way in ways:
            error = _apart(_run(scene, way).q[:, 0], exact)
            yield Measured("motion by default" if not way else "motion", error, scene.name, varied=way)


def _coordinate(scene: fl.Scene, t: Array) -> Array:
    (link,), drive = scene.arm.links, scene.drive
    if drive.torque is not None:
        (τ,), I, d = drive.torque, link.hub.inertia[2], link.joint.viscous
        return np.asarray(τ / d * (t - I / d * (1 - np.exp(-d * t / I))))
    assert drive.kp is not None and drive.kd is not None and scene.initial.joint_m is not None
    (k,), (d,), (x0,), m = drive.kp, drive.kd, scene.initial.joint_m, link.hub.mass
    σ = d / (2 * m)
    ω = np.sqrt(k / m - σ**2)
    return np.asarray(x0 * np.exp(-σ * t) * (np.cos(ω * t) + σ / ω * np.sin(ω * t)))


@kind
def sensor_readings(case: Case) -> Iterator[Measured]:
    """Sensors of a rigid link, turned from rest by a constant torque: error of every column.

    With α = τ/I the rate is α t; a point at r has the acceleration (−r α² t², r α, 0) in the link's axes. SciPy applies
    the Butterworth low-pass filter, given by its analogue coefficients, to the rate.
    """
    for scene in case.load_scenes():
        found = fl.simulate(scene)
        for name, exact in _columns(scene, found.t).items():
            yield Measured(name.partition(" [")[0], _apart(found.columns[name], exact), scene.name)


def _columns(scene: fl.Scene, t: Array) -> Mapping[str, Array]:
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


@kind
def saturation(
    case: Case, steps: dict[str, Positive], methods: tuple[str, ...], tolerances: tuple[Positive, ...]
) -> Iterator[Measured]:
    """A motor of limited torque turns a link through an elastic gear: SciPy stops at its switches.

    Yield tip errors of runs with fixed steps [s] in m, of runs with tolerances [m] in units of the tolerance.
    """
    for scene in case.load_scenes():
        exact = _tips(scene)
        for method, step in steps.items():
            facts: Facts = {"method": method, "step": step}
            error = _of_tip(fl.simulate(scene, method=method, step=step), exact)
            yield Measured("tip error, fixed steps", error, scene.name, varied=facts)
        for method in methods:
            for tolerance in tolerances:
                found = fl.simulate(scene, method=method, tolerance=tolerance)
                facts, note = {"method": method, "tolerance": tolerance}, "; ".join(found.warnings)
                error = _of_tip(found, exact) / tolerance
                yield Measured("tip error / tolerance", error, scene.name, varied=facts, note=note)


def _tips(scene: fl.Scene) -> Array:
    (link,), drive = scene.arm.links, scene.drive
    joint = link.joint
    assert drive.kp is not None and drive.kd is not None and drive.effort is not None
    assert joint.gear_stiffness is not None
    motor = Motor(joint.armature, link.hub.inertia[2], joint.gear_stiffness, joint.gear_damping,
                  drive.kp[0], drive.kd[0], drive.effort[0])  # fmt: skip
    angle = motor.link_angles(float(np.radians(scene.initial.joint_deg[0])), np.asarray(scene.run.times))
    return link.length * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _of_tip(run: fl.Trajectory, exact: Array) -> float:
    return float(np.linalg.norm(run.tip[:, :2] - exact, axis=1).max())


@kind
def step_response(case: Case, within: Positive) -> Iterator[Measured]:
    """A step of a PD controller's target on a rigid link: errors of angle, overshoot and settling time.

    `within` is the settling tolerance [m].
    """
    for scene in case.load_scenes():
        found, servo, r = fl.simulate(scene), _servo(scene), scene.arm.links[0].length
        exact = np.array([servo.angle(t) for t in found.t.tolist()])
        yield Measured("angle", float(np.abs(found.q[:, 0] - exact).max()), scene.name)
        target, start, peak = (_position(r, angle) for angle in (servo.target, 0.0, servo.peak))
        way = (target - start) / np.linalg.norm(target - start)
        beyond = float((peak - target) @ way)
        error = abs(found.overshoot(target=target) / beyond - 1)
        yield Measured("overshoot", error, scene.name, note=f"{1e3 * beyond:.6g} mm in closed form.")
        at = servo.settled(2 * math.asin(within / (2 * r)))  # angle of a chord `within` of the tip's circle
        late = (found.settling_time(target=target, tolerance=within) - at) / scene.run.spacing
        yield Measured("settling time, samples early", -late, scene.name)
        yield Measured("settling time, samples late", late, scene.name, note=f"{at:.6g} s in closed form.")


def _position(r: float, angle: float) -> Array:
    return np.array([r * math.cos(angle), r * math.sin(angle), 0.0])


def _servo(scene: fl.Scene) -> Servo:
    body, drive = scene.arm.links[0].hub, scene.drive
    assert drive.kp is not None and drive.kd is not None and drive.target_deg is not None
    inertia = body.inertia[2] + body.mass * body.center[0] ** 2
    return Servo(inertia, drive.kp[0], drive.kd[0], math.radians(drive.target_deg[0]))


@kind
def satellite(case: Case, ways: tuple[Way, ...]) -> Iterator[Measured]:
    """A tumbling satellite: attitude and spin against Euler's equations, momenta against conservation, by method."""
    for scene in case.load_scenes():
        for way in ways:
            kept = {"duration": scene.run.duration, "sample": scene.run.sample}
            for quantity, error in _tumbling(scene, fl.simulate(scene.varied({"run": kept | way}))).items():
                yield Measured(quantity, error, scene.name, varied=way)


def _tumbling(scene: fl.Scene, run: fl.Trajectory) -> dict[str, float]:
    body, start = _whole(scene), scene.initial.base
    assert start.quaternion is not None and start.spin is not None and run.base is not None
    attitude, spin = body.tumbling(np.array(start.quaternion), np.array(start.spin), run.t)
    R0, ω0 = rotation(np.array(start.quaternion)), np.array(start.spin)
    velocity = np.array(start.velocity) + R0 @ np.cross(ω0, body.center)
    center = np.array(start.xyz) + R0 @ body.center + np.multiply.outer(run.t, velocity)
    turning = R0 @ body.inertia @ ω0
    still = np.tile(turning, (len(run.t), 1))
    sides = np.sign(np.sum(run.base.attitude * attitude, axis=1))[:, None]  # ±1: q and −q are the same attitude
    momentum = run.base.momentum
    pairs = {
        "attitude": (run.base.attitude * sides, attitude),
        "spin of the base": (run.base.spin, spin),
        "linear momentum": (momentum.linear, np.tile(body.mass * velocity, (len(run.t), 1))),
        "angular momentum": (momentum.angular, turning + np.cross(center, body.mass * velocity)),
        "momentum about the centre": (momentum.spin, still),
        "momentum of the states": (fl.momentum(run.chain, run.q, run.qd).spin, still),
        "centre of mass": (momentum.center, center),
    }
    return {name: _apart(found, exact) for name, (found, exact) in pairs.items()}


def _whole(scene: fl.Scene) -> Body:
    """Base and boom as one body, in axes of the base."""
    base, (boom,) = scene.arm.base, scene.arm.links
    on = np.array(boom.mount.xyz)
    first, second = (
        Body(each.mass, place + each.center, np.diag(each.inertia)) for each, place in ((base, 0 * on), (boom.hub, on))
    )
    return first.with_another(second)
