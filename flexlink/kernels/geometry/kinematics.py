"""Forward kinematics: positions of all bodies and hinge axes in frame 0.

p ← p + R r        R ← R R_mount        axis_k = R e_k        R ← R R_k(q_k)        prismatic: p ← p + axis_k q_k
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.branches import loaded_body
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.address import records
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import at, cos_sin_of, position_of, put_vec_of, vec_of, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.vec3 import (
    ZERO,
    add,
    add_scaled,
    apply,
    cross,
    dot,
    pick,
    place_axes,
    put,
    rotate,
    scale,
    sub,
    turn_axes,
    vector,
)


class KinematicsWork(NamedTuple):
    """Results of `kinematics`, in frame 0."""

    rotations: Any  # R of every body, (nb, 3, 3)
    points: Any  # hinge point p of every body, (nb, 3); after prismatic hinges, the displaced point
    axes: Any  # of all hinges, (n, 3)


@kernel
def kinematics_workspace(chain):
    """Allocate the results of `kinematics` for a chain."""
    m, n = len(chain.bodies), len(chain.hinges)
    return KinematicsWork(np.empty((m, 3, 3)), np.empty((m, 3)), np.empty((n, 3)))


@kernel
def forward_kinematics(chain, q):
    """R and p of every body, and all hinge axes, in new arrays."""
    work = kinematics_workspace(chain)
    kinematics(chain, q, work)
    return work


@kernel
def tip_points(chain, qs, tips):
    """Write the origin of the tip frame, (states, 3), for the coordinates (states, n)."""
    work = kinematics_workspace(chain)
    for row in range(len(qs)):
        kinematics(chain, qs[row], work)
        put(tips[row], vector(work.points[-1]))


@recursion
def kinematics(chain, q, work):
    """Write R and p of every body, and all hinge axes, for coordinates (n,) or `Turns` of eight states side by side."""
    bodies, hinges = chain.bodies, chain.hinges
    rotations, points, axes = work.rotations, work.points, work.axes
    o = zero_of(points, 0, 0)
    x, y, z = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o)  # columns of R
    p = (o, o, o)
    for i in range(len(bodies)):
        b = bodies[i]
        if chain.rare is not None and rarely(b.begins):
            x, y, z, p = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o), (o, o, o)
            if b.parent > 0:
                x, y, z = columns_of(rotations[b.parent - 1])
                p = vec_of(points, b.parent - 1, 0)
        p = add(p, rotate(vector(b.translation), x, y, z))
        if b.turned:
            x, y, z = place_axes(b.rotation, x, y, z)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            if chain.rare is not None and rarely(axis >= SLIDES):
                e = pick(axis - SLIDES, x, y, z)
                put_vec_of(axes, e, k, 0)
                p = add_scaled(p, position_of(q, k), e)
                continue
            put_vec_of(axes, pick(axis, x, y, z), k, 0)
            c, s = cos_sin_of(q, k)
            x, y, z = turn_axes(axis, c, s, x, y, z)
        put_vec_of(points, p, i, 0)
        for row in range(3):
            put_vec_of(rotations[i], (x[row], y[row], z[row]), row, 0)


@inlined
def columns_of(R):
    """Columns x, y, z of an array R of shape (3, 3), or of eight such arrays side by side."""
    return (
        (at(R, 0, 0), at(R, 1, 0), at(R, 2, 0)), (at(R, 0, 1), at(R, 1, 1), at(R, 2, 1)),
        (at(R, 0, 2), at(R, 1, 2), at(R, 2, 2)),
    )  # fmt: skip


@recursion
def motion_of(chain, body, qd, placed):
    """ω of a body and the velocity of its hinge point, from the results of `kinematics`.

    Body numbers start at 1; 0 is the base. The sums include all joints on the path to the body: revolute ω = Σ q̇ e and
    v = Σ q̇ e × (p − p_k), prismatic v = Σ q̇ e.
    """
    ω, v, i = ZERO, ZERO, body - 1
    while i >= 0:
        lever = sub(vector(placed.points[body - 1]), vector(placed.points[i]))
        for k in range(chain.bodies[i].first, chain.bodies[i].stop):
            e = vector(placed.axes[k])
            if chain.hinges[k].axis >= SLIDES:
                v = add_scaled(v, qd[k], e)
            else:
                ω, v = add_scaled(ω, qd[k], e), add(v, scale(qd[k], cross(e, lever)))
        i = chain.bodies[i].parent - 1
    return ω, v


def body_point(address, body, q, point):
    """Write the hinge point of a body, given by its index; return whether q has n finite values.

    Records: the chain and the results of `kinematics`.
    """
    chain, placed = records(address)
    if len(q) != len(placed.axes) or not is_finite(q):
        return False
    kinematics(chain, q, placed)
    put(point, vector(placed.points[body]))
    return True


def jacobian(address, body, offset, q, found):
    """Write J_v and J_ω of a point to `found` (2, 3, n); return whether q has n finite values.

    `body` is the body's index, `offset` (3,) the point in its frame. Records: the chain and the results of
    `kinematics`.
    """
    chain, placed = records(address)
    if len(q) != len(placed.axes) or not is_finite(q):
        return False
    kinematics(chain, q, placed)
    found[:, :, :] = 0.0
    point, i = add(vector(placed.points[body]), apply(placed.rotations[body], vector(offset))), body
    while i >= 0:
        lever = sub(point, vector(placed.points[i]))
        for k in range(chain.bodies[i].first, chain.bodies[i].stop):
            e = vector(placed.axes[k])
            if chain.hinges[k].axis >= SLIDES:
                put(found[0, :, k], e)
            else:
                put(found[0, :, k], cross(e, lever))
                put(found[1, :, k], e)
        i = chain.bodies[i].parent - 1
    return True


@kernel
def arm_length(bodies):
    """Sum of the lengths of all bodies [m], or 1 if it is zero; a scale to compare displacements with rotations."""
    length = 0.0
    for i in range(len(bodies)):
        r = vector(bodies[i].translation)
        length += math.sqrt(dot(r, r))
    return length if length > 0.0 else 1.0


@kernel
def turned_with_tip(chain, wrench, q):
    """Convert a wrench (6,) from axes of the tip frame on which it acts to frame 0."""
    tip, turned = forward_kinematics(chain, q).rotations[loaded_body(chain.bodies)], np.empty(6)
    put(turned[:3], apply(tip, vector(wrench)))
    put(turned[3:], apply(tip, vector(wrench[3:])))
    return turned
