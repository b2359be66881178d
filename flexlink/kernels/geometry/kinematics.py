"""Forward kinematics: positions of all bodies and hinge axes in frame 0.

p ← p + R r        R ← R R_mount        axis_k = R e_k        R ← R R_k(q_k)        prismatic: p ← p + axis_k q_k
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.branches import loaded_body
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.address import records
from flexlink.kernels.tools.axes3 import pick, place_axes, rotate, turn_axes
from flexlink.kernels.tools.compiler import inlined, kernel, recursion, unfused
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import at, cos_sin_of, position_of, put_vec_of, vec_of, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, apply, cross, dot, put, scale, sub, vector


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


@recursion
def add_slope(chain, placed, body, point, u, J):
    """J += u · ∂p/∂q for a point of a body, given by its index, −1 for frame 0; u and the point in frame 0."""
    i = body
    while i >= 0:
        moment = cross(sub(point, vector(placed.points[i])), u)
        for k in range(chain.bodies[i].first, chain.bodies[i].stop):
            J[k] += dot(vector(placed.axes[k]), u if chain.hinges[k].axis >= SLIDES else moment)
        i = chain.bodies[i].parent - 1


@recursion
def spread(chain, placed, loads, τ):
    """τ (n,) += Jᵀ of loads (bodies, 6), forces and moments about the origin; loads add up toward the base."""
    for i in range(len(chain.bodies) - 1, -1, -1):
        b, (f, moment) = chain.bodies[i], kept(loads, i, (ZERO, ZERO))
        about = sub(moment, cross(vector(placed.points[i]), f))
        for k in range(b.first, b.stop):
            τ[k] += dot(vector(placed.axes[k]), f if chain.hinges[k].axis >= SLIDES else about)
        if b.parent > 0:
            keep(loads, b.parent - 1, added(loads, b.parent - 1, (f, moment)))


def body_point(address, body, q, point):
    """Write the hinge point of a body, given by its index; return whether q has n finite values."""
    chain, placed = records(address)
    if len(q) != len(placed.axes) or not is_finite(q):
        return False
    kinematics(chain, q, placed)
    put(point, vector(placed.points[body]))
    return True


def jacobian(address, body, offset, q, found):
    """Write J_v and J_ω of a point to `found` (2, 3, n); return whether q has n finite values.

    `body` is the body's index, `offset` (3,) the point in its frame.
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


@unfused
def attitudes(rows, references, back, q, qd, turned, spins, tangents):
    """Write quaternions w, x, y, z (samples, 4) and angular velocities (samples, 3), in its axes, of a floating base.

    From sample `rows[k]` on, angles are measured from the attitude `references[k]` (m, 4). `tangents` (2, samples, 3):
    numerators and denominators of the tangents of the angles from the inverse of the attitude `back`.
    """
    k = 0
    for row in range(len(q)):
        while k + 1 < len(rows) and rows[k + 1] <= row:
            k += 1
        a, b, c = 0.5 * q[row, 3], 0.5 * q[row, 4], 0.5 * q[row, 5]
        both = quaternion((math.cos(a), math.sin(a), 0.0, 0.0), (math.cos(b), 0.0, math.sin(b), 0.0))
        turned[row] = quaternion(references[k], quaternion(both, (math.cos(c), 0.0, 0.0, math.sin(c))))
        y, z, (u, v, w) = q[row, 4], q[row, 5], vector(qd[row, 3:])
        cy, cz, sy, sz = math.cos(y), math.cos(z), math.sin(y), math.sin(z)
        spins[row] = cy * cz * u + sz * v + 0.0 * w, -cy * sz * u + cz * v + 0.0 * w, sy * u + 0.0 * v + w
        w, x, y, z = quaternion(back, turned[row])
        along, across = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z)
        tangents[0, row] = -(2.0 * (y * z - w * x)), 2.0 * (x * z + w * y), -across
        tangents[1, row] = 1.0 - 2.0 * (x * x + y * y), math.hypot(along, across), along


@unfused
def rates_of_angles(q, spins, qd):
    """Write rates φ̇ of a base's angles into `qd`: S φ̇ = ω is solved with partial pivoting, in the order of LAPACK."""
    A = np.empty((3, 4))
    for row in range(len(q)):
        y, z, (u, v, w) = q[row, 4], q[row, 5], vector(spins[row])
        cy, cz, sy, sz = math.cos(y), math.cos(z), math.sin(y), math.sin(z)
        A[0], A[1], A[2] = (cy * cz, sz, 0.0, u), (-cy * sz, cz, 0.0, v), (sy, 0.0, 1.0, w)
        for k in range(2):
            pivot = k + np.argmax(np.abs(A[k:, k]))
            for j in range(4):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            for i in range(k + 1, 3):
                factor = A[i, k] * (1.0 / A[k, k])
                for j in range(k + 1, 4):
                    A[i, j] -= factor * A[k, j]
        for i in range(2, -1, -1):
            for j in range(2, i, -1):
                A[i, 3] -= A[i, j] * A[j, 3]
            qd[row, 3 + i] = A[i, 3] = A[i, 3] / A[i, i]


@unfused
def quaternion(p, q):
    """Unit quaternion of rotation p followed by rotation q about the rotated axes, normalized."""
    w = p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3]
    x = p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2]
    y = p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1]
    z = p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0]
    size = math.sqrt(w * w + x * x + y * y + z * z)
    return w / size, x / size, y / size, z / size
