"""How points of an arm move: velocity and acceleration, and what sensors on the arm read (see `terms` for shapes).

    ω_i = Σ e_k q̇_k        α_i = Σ (e_k q̈_k + ω × e_k q̇_k), ω before hinge k        over the hinges k up to body i
    v_{i+1} = v_i + ω_i × r_i        a_{i+1} = a_i + α_i × r_i + ω_i × (ω_i × r_i)        r_i = p_{i+1} − p_i

The forward half of recursive Newton-Euler (Luh, Walker & Paul 1980), as sums along the arm, in frame 0.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, integer, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.batches import each, is_batch
from flexlink.dynamics.result import Result
from flexlink.kernels.bodies.kinematics import forward_kinematics
from flexlink.kernels.tools.finite import is_finite


class BodyMotion(NamedTuple):
    """All bodies of a chain at one state, in frame 0; points are their origins."""

    rotations: Array  # (bodies, 3, 3), R: v_0 = R v_body
    points: Array  # (bodies, 3) [m]
    axes: Array  # (n, 3), of the hinges
    velocity: Array  # (bodies, 3) [m/s]
    angular_velocity: Array  # (bodies, 3), ω [rad/s]
    acceleration: Array  # (bodies, 3), without gravity [m/s²]
    angular_acceleration: Array  # (bodies, 3), α [rad/s²]


def body_motion(chain: Chain, q: Array, qd: Array, qdd: Array) -> BodyMotion:
    """Motion of every body, of checked arguments; beyond float64 it is not finite."""
    R, p, axes = forward_kinematics(chain.arrays, q)
    stop = chain.bodies["stop"]
    with np.errstate(over="ignore", invalid="ignore"):
        turned = axes * qd[:, None]
        after = _sums(turned)
        ω = after[stop]
        α = _sums(axes * qdd[:, None] + np.cross(after[:-1], turned))[stop]
        r = np.diff(p, axis=0)
        v = _sums(np.cross(ω[:-1], r))
        a = _sums(np.cross(α[:-1], r) + np.cross(ω[:-1], np.cross(ω[:-1], r)))
    return BodyMotion(R, p, axes, v, ω, a, α)


def _sums(terms: Array) -> Array:
    """Sum of the first k vectors, k = 0 … len(terms)."""
    return np.vstack([np.zeros(3), np.cumsum(terms, axis=0)])


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PointMotion(Result):
    """Motion of one point of an arm; the first three in frame 0, what sensors there read in axes of their body."""

    position: Array  # (…, 3) [m]
    velocity: Array  # (…, 3) [m/s]
    acceleration: Array  # (…, 3), d²/dt² of the position: without gravity [m/s²]
    accelerometer: Array  # (…, 3), Rᵀ(acceleration − g): an arm at rest reads 9.81 m/s² upwards [m/s²]
    gyroscope: Array  # (…, 3), Rᵀω [rad/s]

    def __repr__(self) -> str:
        *states, _ = self.position.shape
        return f"<PointMotion: one point{f' in {states[0]} states' if states else ''}>"


def point_motion(
    chain: Chain,
    q: ArrayLike,
    qd: ArrayLike,
    qdd: ArrayLike,
    *,
    body: int = -1,
    point: ArrayLike = (0.0, 0.0, 0.0),
) -> PointMotion:
    """Position, velocity and acceleration of a point of a body, and what an inertial sensor (IMU) fixed there reads.

    The accelerometer reads a − g in axes of the body: at rest the support, against gravity; in free fall nothing.

    Parameters
    ----------
    chain
        The chain.
    q, qd, qdd
        Angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states; along a run
        `run.q`, `run.qd`, `run.qdd`.
    body
        Number of the body in `chain.bodies`, from −1, the tip frame, backwards or from 0 on; of the one that hangs on a
        joint or hinge `chain.body("upper.2.z")`.
    point
        The point in axes of the body's frame, from its origin, shape (3,) [m].

    Returns
    -------
    PointMotion
        `position`, `velocity`, `acceleration`, `accelerometer`, `gyroscope`, shape (3,), or (b, 3).

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, there is no such body, or a result
        is beyond float64.

    Examples
    --------
    >>> imu = fl.point_motion(chain, q, qd, qdd, body=chain.body("fore"), point=(0.1, 0.0, 0.0))
    >>> print(imu.position[:2].round(3), np.linalg.norm(imu.accelerometer).round(2))  # m; m/s²
    [0.954 0.446] 9.81
    """
    if is_batch(q, qd, qdd):
        return each(point_motion, chain, {"q": q, "qd": qd, "qdd": qdd}, body=body, point=point)
    n, m = require_type("chain", chain, Chain).n, len(chain.bodies)
    i, offset = integer("body", body, -m, m - 1), vector("point", point, 3)
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    moving = body_motion(chain, q, qd, qdd)
    R, ω, α = moving.rotations[i], moving.angular_velocity[i], moving.angular_acceleration[i]
    c = R @ offset
    with np.errstate(over="ignore", invalid="ignore"):
        velocity = moving.velocity[i] + np.cross(ω, c)
        acceleration = moving.acceleration[i] + np.cross(α, c) + np.cross(ω, np.cross(ω, c))
        found = moving.points[i] + c, velocity, acceleration, R.T @ (acceleration - chain.gravity), R.T @ ω
    if not is_finite(np.concatenate(found)):
        raise beyond_float64("the motion of the point", q=q, qd=qd, qdd=qdd, point=offset, gravity=chain.gravity)
    return PointMotion(*found)
