"""Ideal signals of a scene's sensors along a run, without effects of the instruments, and derivatives at a state."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import OF_THE_DRIVE, Sensor
from flexlink.dynamics.point_motion import motion_in_body
from flexlink.dynamics.point_slopes import point_slopes
from flexlink.dynamics.sensors.gauge import gauge_slope, gauge_strain
from flexlink.dynamics.sensors.placement import placement_of


class Samples(Protocol):
    """The samples of a run."""

    @property
    def t(self) -> Array:
        """Times (samples,) [s]."""

    @property
    def chain(self) -> Chain:
        """The chain that moves."""

    @property
    def q(self) -> Array:
        """Angles (samples, n)."""

    @property
    def qd(self) -> Array:
        """Rates (samples, n)."""

    @property
    def tau(self) -> Array:
        """Drive torques (samples, n)."""

    @property
    def qdd(self) -> Array:
        """Accelerations (samples, n)."""


class Slopes(NamedTuple):
    """Derivatives of signals (columns,) with respect to q, q̇, q̈ and drive torques, each of shape (columns, n)."""

    q: Array
    qd: Array
    qdd: Array
    tau: Array


def signal_of(sensor: Sensor, scene: Scene, run: Samples) -> Array:
    """Ideal signal of a sensor at the samples of a run, in SI units and radians, shape (columns, samples).

    Raises
    ------
    SceneError
        As in `placement_of`.
    SingularMassError
        For accelerometers, as in `forward_dynamics`.
    """
    if sensor.kind == "strain":
        return gauge_strain(sensor, scene, run.q)[None]
    if sensor.kind in OF_THE_DRIVE:
        k, seen = joint_of(sensor, run.chain, scene), run.q if sensor.kind == "joint" else run.tau
        return seen[None, :, k] / (sensor.torque_constant or 1.0)
    body, point, axes = placement_of(sensor, scene)
    qdd = run.qdd if sensor.kind == "accelerometer" else np.zeros_like(run.q)
    moving = motion_in_body(run.chain, run.q, run.qd, qdd, body=body, point=point)
    return np.asarray(axes @ getattr(moving, sensor.kind).T)


def joint_of(sensor: Sensor, chain: Chain, scene: Scene) -> int:
    """Sequential index of the joint at which a joint sensor is mounted."""
    return chain.index(scene.arm.number(sensor.link), 0, 0)


def slopes_of(sensor: Sensor, scene: Scene, chain: Chain, q: Array, qd: Array, qdd: Array) -> Slopes:
    """Derivatives of `signal_of` at a state (n,); errors as in `signal_of`."""
    if sensor.kind == "strain":
        return _slopes(chain.n, q=gauge_slope(sensor, scene, chain, q)[None])
    if sensor.kind in OF_THE_DRIVE:
        selected = np.zeros((1, chain.n))
        selected[0, joint_of(sensor, chain, scene)] = 1.0 / (sensor.torque_constant or 1.0)
        return _slopes(chain.n, **{"q" if sensor.kind == "joint" else "tau": selected})
    body, point, axes = placement_of(sensor, scene)
    parts = point_slopes(chain, q, qd, qdd, body, point)[sensor.kind]
    return _slopes(chain.n, **{name: axes @ part for name, part in zip(Slopes._fields, parts, strict=False)})


def _slopes(n: int, **parts: Array) -> Slopes:
    columns = len(next(iter(parts.values())))
    return Slopes(*(parts.get(name, np.zeros((columns, n))) for name in Slopes._fields))
