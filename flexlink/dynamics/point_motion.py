"""Velocity and acceleration of points of an arm, and readings of inertial sensors on it (see `terms` for shapes).

    ω_i = Σ e_k q̇_k        α_i = Σ (e_k q̈_k + ω × e_k q̇_k), ω inboard of hinge k        over hinges k up to body i
    v_j = v_i + ω_i × r_j        a_j = a_i + α_i × r_j + ω_i × (ω_i × r_j)        r_j = p_j − p_i, i the parent of j

If body j slides along e, e q̇ adds to its velocity and e q̈ + 2 ω_i × e q̇ to its acceleration; it does not turn.
This is the forward half of recursive Newton-Euler (Luh, Walker & Paul 1980), as sums along the arm in frame 0.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.chain import Chain
from flexlink.chain.layout import Branch, of_parents, spans_of, sums_outward
from flexlink.common.errors import FlexlinkError
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.dynamics.batches import about_state, is_batch, rows
from flexlink.dynamics.placement import body_number, hinge_bodies, hinges_before, slid_apart
from flexlink.dynamics.result import Result
from flexlink.kernels.geometry.kinematics import forward_kinematics
from flexlink.kernels.tools.finite import is_finite

BATCH = 1000  # number of states processed at once, which takes a few MB


class BodyMotion(NamedTuple):
    """Motion of all bodies of a chain in frame 0; with b states, b is the second axis. Points are body origins."""

    rotations: Array  # (bodies, 3, 3), R: v_0 = R v_body
    points: Array  # (bodies, 3) [m]
    axes: Array  # (n, 3), of the hinges
    velocity: Array  # (bodies, 3) [m/s]
    angular_velocity: Array  # (bodies, 3), ω [rad/s]
    acceleration: Array  # (bodies, 3), without gravity [m/s²]
    angular_acceleration: Array  # (bodies, 3), α [rad/s²]
    before: tuple[Array, Array]  # (n, 3) each, ω and α of the body or hinge before each hinge


def body_motion(chain: Chain, q: Array, qd: Array, qdd: Array) -> BodyMotion:
    """Motion of every body at one state (n,) of validated arguments; not finite if it overflows float64."""
    R, p, axes = forward_kinematics(chain.arrays, q)
    return motion_of_bodies(chain, R, p, axes, qd, qdd)


def body_motions(chain: Chain, q: Array, qd: Array, qdd: Array) -> BodyMotion:
    """Motion of every body at states (b, n), bitwise equal to `body_motion`; b is the second axis of all parts."""
    R, p = np.empty((len(chain.bodies), len(q), 3, 3)), np.empty((len(chain.bodies), len(q), 3))
    axes = np.empty((chain.n, len(q), 3))
    for k, angles in enumerate(q):
        R[:, k], p[:, k], axes[:, k] = forward_kinematics(chain.arrays, angles)
    return motion_of_bodies(chain, R, p, axes, qd.T, qdd.T)


def motion_of_bodies(chain: Chain, R: Array, p: Array, axes: Array, qd: Array, qdd: Array) -> BodyMotion:
    """Motion of bodies and hinges, given their positions, and rates and accelerations (n,) or (n, b), of any type."""
    spans, rest = spans_of(chain.bodies), np.zeros(p.shape[1:])
    with np.errstate(over="ignore", invalid="ignore"):
        turned, faster = axes * qd[..., None], axes * qdd[..., None]
        slid, slid_faster = (slid_apart(chain, part) for part in (turned, faster))
        before, ω = _after_hinges(chain, spans, turned)
        before_α, α = _after_hinges(chain, spans, faster + cross(before, turned))
        ω_before, α_before = of_parents(chain, ω, rest), of_parents(chain, α, rest)
        r = p - of_parents(chain, p, rest)
        v = cross(ω_before, r)
        a = cross(α_before, r) + cross(ω_before, cross(ω_before, r))
        if chain.slides.any():
            v += slid
            a += slid_faster + 2 * cross(ω_before, slid)
        v, a = sums_outward(spans, v), sums_outward(spans, a)
    return BodyMotion(R, p, axes, v, ω, a, α, (before, before_α))


def _after_hinges(chain: Chain, spans: list[Branch], terms: Array) -> tuple[Array, Array]:
    """Sums of hinge terms (n, …, 3) along the arm, from the base to just before each hinge, and to each body."""
    before, at = np.empty_like(terms), np.empty((len(chain.bodies), *terms.shape[1:]), terms.dtype)
    first, stop = chain.bodies["first"], chain.bodies["stop"]
    for parent, begin, end in spans:
        start = at[parent] if parent >= 0 else np.zeros(terms.shape[1:])
        hinges = slice(first[begin], stop[end - 1])
        sums = np.cumsum(np.concatenate([start[None], terms[hinges]]), axis=0)
        before[hinges] = sums[:-1]
        at[begin:end] = sums[stop[begin:end] - first[begin]]
    return before, at


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class PointMotion(Result):
    """Motion of one point of an arm in frame 0; sensor readings are in axes of its link."""

    position: Array  # (…, 3) [m]
    velocity: Array  # (…, 3) [m/s]
    acceleration: Array  # (…, 3), d²/dt² of the position: without gravity [m/s²]
    accelerometer: Array  # (…, 3), Rᵀ(acceleration − g): at rest 9.81 m/s² upward [m/s²]
    gyroscope: Array  # (…, 3), Rᵀω [rad/s]

    def __repr__(self) -> str:
        *states, _ = self.position.shape
        return f"<PointMotion: one point{f' in {states[0]} states' if states else ''}>"


def point_motion(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, body: int = -1, tip: str | int | None = None,
    point: ArrayLike = (0.0, 0.0, 0.0),
) -> PointMotion:  # fmt: skip
    """Return position, velocity and acceleration of a point of a body, and readings of an inertial sensor (IMU) there.

    The accelerometer reads a − g in axes of the link: at rest an upward 9.81 m/s², in free fall zero.

    Parameters
    ----------
    chain, q, qd, qdd
        The chain; angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states; for a
        simulation `run.q`, `run.qd`, `run.qdd`.
    body
        Number in `chain.bodies`, from 0, or back from −1, the tip frame. `chain.body("upper.2.z")`: what a hinge moves.
    tip
        Instead of the body: name or number of a link without child links, whose tip frame is used.
    point
        The point relative to the origin of the body's frame, in axes of its link, shape (3,) [m]; x is along the beam
        unless the link has a `line`. At a tip they are axes of the tip frame.

    Returns
    -------
    PointMotion
        `position`, `velocity`, `acceleration`, `accelerometer`, `gyroscope`, shape (3,), or (b, 3).

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite; the body does not exist; or a result is beyond
        float64.

    Examples
    --------
    >>> imu = fl.point_motion(chain, q, qd, qdd, body=chain.body("fore"), point=(0.1, 0.0, 0.0))
    >>> print(imu.position[:2].round(3), np.linalg.norm(imu.accelerometer).round(2))  # m; m/s²
    [0.954 0.446] 9.81
    """
    n = require_type("chain", chain, Chain).n
    i, offset = body_number(chain, body, tip), vector("point", point, 3)
    axes = chain.described["link"][i]
    if is_batch(q, qd, qdd):
        found = motion_in_body(chain, *rows(n, {"q": q, "qd": qd, "qdd": qdd}), body=i, point=axes @ offset)
        return dataclasses.replace(found, accelerometer=found.accelerometer @ axes, gyroscope=found.gyroscope @ axes)
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    moving = body_motion(chain, q, qd, qdd)
    position, velocity, acceleration, seen, spin = of_point(moving, i, axes @ offset, chain.gravity)
    if not is_finite(np.concatenate([position, velocity, acceleration, seen, spin])):
        raise _overflow(chain, q, qd, qdd, offset)
    return PointMotion(position, velocity, acceleration, seen @ axes, spin @ axes)


def _overflow(chain: Chain, q: Array, qd: Array, qdd: Array, point: Array) -> FlexlinkError:
    return beyond_float64("the motion of the point", q=q, qd=qd, qdd=qdd, point=point, gravity=chain.gravity)


def motion_in_body(chain: Chain, q: Array, qd: Array, qdd: Array, *, body: int, point: Array) -> PointMotion:
    """`point_motion` at b states (b, n), already validated; `point` and readings are in axes of the body."""
    found = np.empty((len(PointMotion.__dataclass_fields__), len(q), 3))
    for start in range(0, len(q), BATCH):
        part = slice(start, start + BATCH)
        found[:, part] = of_point(body_motions(chain, q[part], qd[part], qdd[part]), body, point, chain.gravity)
    for k in np.flatnonzero(~np.isfinite(found).all(axis=(0, 2)))[:1].tolist():
        raise about_state(k, _overflow(chain, q[k], qd[k], qdd[k], point @ chain.described["link"][body]))
    return PointMotion(*found)


def of_point(moving: BodyMotion, i: int, offset: Array, gravity: Array) -> tuple[Array, ...]:
    """The fields of `PointMotion`, each (3,), or (b, 3)."""
    R, ω, α = moving.rotations[i], moving.angular_velocity[i], moving.angular_acceleration[i]
    c = R[..., 0] * offset[0] + R[..., 1] * offset[1] + R[..., 2] * offset[2]
    with np.errstate(over="ignore", invalid="ignore"):
        velocity = moving.velocity[i] + cross(ω, c)
        acceleration = moving.acceleration[i] + cross(α, c) + cross(ω, cross(ω, c))
        felt = acceleration - gravity, ω  # in axes of the body: Rᵀ v
        seen, spin = (R[..., 0, :] * v[..., :1] + R[..., 1, :] * v[..., 1:2] + R[..., 2, :] * v[..., 2:] for v in felt)
        return moving.points[i] + c, velocity, acceleration, seen, spin


# Derivatives of `point_motion`: how the motion of a point changes with angles, rates and accelerations.
#
# Hinge j has the axis e_j through p_j. The part inboard moves with ω, α; the part outboard turns about it rigidly:
#
#     ∂p = e × r        ∂v = ω × (e × r) + e × u        ∂ω_P = e × (ω_P − ω)                  by q_j, with r = p − p_j
#     ∂a = α × (e × r) + ω × (ω × (e × r)) + 2 ω × (e × u) + e × w
#     ∂v = e × r        ∂ω_P = e        ∂a = 2 ω × (e × r) + 2 e × u                          by q̇_j
#     ∂a = e × r                                                                              by q̈_j
#
# ω_P is the angular velocity of the point's body; u and w are velocity and acceleration of the point relative to the
# inboard part. For a sliding joint, which shifts the outboard part, replace e × r by e, and e × u, e × w and ∂ω_P by 0.


def point_slopes(chain: Chain, q: Array, qd: Array, qdd: Array, i: int, point: Array) -> dict[str, tuple[Array, ...]]:
    """Derivatives by q, q̇ and q̈, (3, n) each, of results of `point_motion` at a state (n,), unless they vanish."""
    moving, beyond = body_motion(chain, q, qd, qdd), hinge_bodies(chain)
    R, ω_P, α_P = moving.rotations[i], moving.angular_velocity[i], moving.angular_acceleration[i]
    c = R @ point
    v = moving.velocity[i] + cross(ω_P, c)
    a = moving.acceleration[i] + cross(α_P, c) + cross(ω_P, cross(ω_P, c))
    ω, α = moving.before
    e = np.where(hinges_before(chain, i)[:, None], moving.axes, 0.0)
    r = moving.points[i] + c - moving.points[beyond]
    u = v - moving.velocity[beyond] - cross(ω, r)
    w = a - moving.acceleration[beyond] - cross(α, r) - cross(ω, cross(ω, r) + 2 * u)
    shift, turn = cross(e, r), e.copy()
    slides = chain.slides
    shift[slides], turn[slides] = e[slides], 0.0
    swung = cross(turn, u)
    by_angle = cross(α, shift) + cross(ω, cross(ω, shift) + 2 * swung) + cross(turn, w)
    seen_by_angle = by_angle - cross(turn, a - chain.gravity)  # the axes of the sensor turn as well
    spun = -cross(turn, np.broadcast_to(ω, turn.shape))
    return {
        "position": (np.ascontiguousarray(shift.T),),
        "gyroscope": (_in(R, spun), _in(R, turn)),
        "accelerometer": (_in(R, seen_by_angle), _in(R, 2 * (cross(ω, shift) + swung)), _in(R, shift)),
    }


def _in(R: Array, rows: Array) -> Array:
    """Vectors (n, 3) in axes of a body, shape (3, n)."""
    return np.ascontiguousarray((rows @ R).T)
