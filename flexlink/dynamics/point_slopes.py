"""Derivatives of `point_motion`: how the motion of a point changes with angles, rates and accelerations.

Hinge j has the axis e_j through p_j. The part inboard of it moves with ω, α; the part outboard turns about it rigidly:

    ∂p = e × r        ∂v = ω × (e × r) + e × u        ∂ω_P = e × (ω_P − ω)                  by q_j, with r = p − p_j
    ∂a = α × (e × r) + ω × (ω × (e × r)) + 2 ω × (e × u) + e × w
    ∂v = e × r        ∂ω_P = e        ∂a = 2 ω × (e × r) + 2 e × u                          by q̇_j
    ∂a = e × r                                                                              by q̈_j

ω_P is the angular velocity of the point's body; u and w are velocity and acceleration of the point relative to the
inboard part. For a sliding joint, which shifts the
outboard part, replace e × r by e, and e × u, e × w and ∂ω_P by 0.
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.dynamics.placement import hinge_bodies, hinges_before
from flexlink.dynamics.point_motion import body_motion


def point_slopes(
    chain: Chain, q: Array, qd: Array, qdd: Array, body: int, point: Array
) -> dict[str, tuple[Array, ...]]:
    """Derivatives of each result of `point_motion` with respect to q, q̇ and q̈, (3, n) each, except those that vanish.

    The state is (n,); the point of the body is given in axes of the body [m].
    """
    moving, beyond = body_motion(chain, q, qd, qdd), hinge_bodies(chain)
    R, ω_P, α_P = moving.rotations[body], moving.angular_velocity[body], moving.angular_acceleration[body]
    c = R @ point
    v = moving.velocity[body] + cross(ω_P, c)
    a = moving.acceleration[body] + cross(α_P, c) + cross(ω_P, cross(ω_P, c))
    ω, α = moving.before
    e = np.where(hinges_before(chain, body)[:, None], moving.axes, 0.0)
    r = moving.points[body] + c - moving.points[beyond]
    u = v - moving.velocity[beyond] - cross(ω, r)
    w = a - moving.acceleration[beyond] - cross(α, r) - cross(ω, cross(ω, r) + 2 * u)
    shift, turn = cross(e, r), e.copy()
    slides = chain.slides
    shift[slides], turn[slides] = e[slides], 0.0
    swung = cross(turn, u)
    by_angle = cross(α, shift) + cross(ω, cross(ω, shift) + 2 * swung) + cross(turn, w)
    seen_by_angle = by_angle - cross(turn, a - chain.gravity)  # the axes of the sensor turn as well
    spun = -cross(turn, np.broadcast_to(ω, turn.shape))
    accelerometer = _in(R, seen_by_angle), _in(R, 2 * (cross(ω, shift) + swung)), _in(R, shift)
    return {
        "position": (np.ascontiguousarray(shift.T),),
        "gyroscope": (_in(R, spun), _in(R, turn)),
        "accelerometer": accelerometer,
    }


def _in(R: Array, rows: Array) -> Array:
    """Vectors (n, 3) in axes of a body, shape (3, n)."""
    return np.ascontiguousarray((rows @ R).T)
