"""Mass matrix four ways: the three methods of Walker & Orin (1982) that the paper names, and composite bodies.

columns     every column is a full inverse dynamics with one unit acceleration, no gravity, no rates
lower       the same, but outward from the moving joint only: the part of the column on and below the diagonal
upper       the bodies beyond the joint move as one rigid body: the part on and above the diagonal, in body frames
composite   the same bodies in inertial axes: a row needs only the joints' axes and points (Featherstone 2008, 6.2)

All write M (n, n) and return its trace.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.compiler import inlined, kernel, recursion
from flexlink.kernels.kinematics import KinematicsWork, kinematics, kinematics_workspace
from flexlink.kernels.rne import rne, rne_workspace
from flexlink.kernels.sym3 import (
    ZERO6,
    point_inertia,
    product_inertia,
    sym_add,
    sym_apply,
    sym_rotate,
    sym_turn,
    symmetric,
)
from flexlink.kernels.vec3 import (
    ZERO,
    add,
    add_along,
    apply,
    apply_transposed,
    cos_sin,
    cross,
    dot,
    put,
    scale,
    sub,
    turn,
    unit,
    vector,
)


@inlined
def trace(M):
    """Σ M_kk, finite if M is: |M_jk|² ≤ M_jj M_kk."""
    total = 0.0
    for k in range(len(M)):
        total += M[k, k]
    return total


@kernel
def mass_columns(chain, q, M):
    """M by n inverse dynamics (Walker-Orin method 1)."""
    n = len(chain.hinges)
    work = rne_workspace(chain)
    rest, unit_acceleration, wrench, column = np.zeros(n), np.zeros(n), np.zeros(6), np.empty(n)
    for k in range(n):
        unit_acceleration[k] = 1.0
        rne(chain, ZERO, wrench, q, rest, unit_acceleration, column, work)
        M[:, k] = column
        unit_acceleration[k] = 0.0
    return trace(M)


@kernel
def mass_lower(chain, q, M):
    """M by restricted inverse dynamics (Walker-Orin method 2): joint j at rest inward of it, so only i ≥ j."""
    bodies, hinges = chain.bodies, chain.hinges
    forces, moments = np.empty((len(bodies), 3)), np.empty((len(bodies), 3))
    for start in range(len(bodies)):
        for j in range(bodies[start].first, bodies[start].stop):
            α, a = ZERO, ZERO
            for i in range(start, len(bodies)):
                b = bodies[i]
                first = b.first
                if i == start:
                    first = j
                else:
                    a = add(a, cross(α, vector(b.translation)))
                    if b.turned:
                        α, a = apply_transposed(b.rotation, α), apply_transposed(b.rotation, a)
                for k in range(first, b.stop):
                    c, s = cos_sin(q[k])
                    α, a = turn(hinges[k].axis, c, -s, α), turn(hinges[k].axis, c, -s, a)
                    if k == j:
                        α = add_along(hinges[k].axis, 1.0, α)
                F = scale(b.mass, add(a, cross(α, vector(b.center))))
                N = add(apply(b.inertia, α), cross(vector(b.center), F))
                forces[i, 0], forces[i, 1], forces[i, 2] = F
                moments[i, 0], moments[i, 1], moments[i, 2] = N
            f, n = ZERO, ZERO
            for i in range(len(bodies) - 1, start - 1, -1):
                b = bodies[i]
                f, n = add(f, vector(forces[i])), add(n, vector(moments[i]))
                for k in range(b.stop - 1, max(b.first, j) - 1, -1):
                    M[k, j] = M[j, k] = n[hinges[k].axis]
                    c, s = cos_sin(q[k])
                    f, n = turn(hinges[k].axis, c, s, f), turn(hinges[k].axis, c, s, n)
                if b.turned:
                    f, n = apply(b.rotation, f), apply(b.rotation, n)
                n = add(n, cross(vector(b.translation), f))
            M[j, j] += hinges[j].armature
    return trace(M)


@kernel
def mass_upper(chain, q, M):
    """M by composite bodies in body frames (Walker-Orin method 3): the column above the diagonal, inward."""
    bodies, hinges = chain.bodies, chain.hinges
    m, h, J = 0.0, ZERO, ZERO6  # mass, first moment, inertia of all bodies from here on, about the hinge point
    for start in range(len(bodies) - 1, -1, -1):
        b = bodies[start]
        c = vector(b.center)
        m += b.mass
        h = add(h, scale(b.mass, c))
        J = sym_add(J, sym_add(symmetric(b.inertia), point_inertia(b.mass, c)))
        for j in range(b.stop - 1, b.first - 1, -1):
            axis = hinges[j].axis
            f = cross(unit(axis), h)
            n = sym_apply(J, unit(axis))
            k = j
            for i in range(start, -1, -1):
                while k >= bodies[i].first:
                    M[k, j] = M[j, k] = n[hinges[k].axis]
                    c, s = cos_sin(q[k])
                    f, n = turn(hinges[k].axis, c, s, f), turn(hinges[k].axis, c, s, n)
                    k -= 1
                if bodies[i].turned:
                    f, n = apply(bodies[i].rotation, f), apply(bodies[i].rotation, n)
                n = add(n, cross(vector(bodies[i].translation), f))
            M[j, j] += hinges[j].armature
            c, s = cos_sin(q[j])
            h = turn(axis, c, s, h)
            J = sym_turn(axis, c, s, J)
        if b.turned:
            h = apply(b.rotation, h)
            J = sym_rotate(b.rotation, J)
        r = vector(b.translation)
        J = sym_add(J, sym_add(product_inertia(h, r), point_inertia(m, r)))
        h = add(h, scale(m, r))
    return trace(M)


class CompositeWork(NamedTuple):
    """Scratch of `composite`."""

    placed: KinematicsWork
    pivots: Any  # hinge point of every hinge


@kernel
def composite_workspace(chain):
    """Scratch of `composite` for a chain."""
    return CompositeWork(kinematics_workspace(chain), np.empty((len(chain.hinges), 3)))


@kernel
def mass_composite(chain, q, M):
    """M by composite bodies in inertial axes."""
    composite(chain, q, M, composite_workspace(chain))
    return trace(M)


@recursion
def composite(chain, q, M, work):
    """M by composite bodies in inertial axes.

    With mass m, centre C and inertia J of all bodies beyond hinge k at p_k, unit acceleration about its axis gives
    f = m axis_k × (C − p_k),  n = J axis_k + (C − p_k) × f,  and  M_jk = axis_j · (n + (p_k − p_j) × f),  j ≤ k.
    """
    bodies, hinges = chain.bodies, chain.hinges
    kinematics(chain, q, work.placed)
    rotations, points, axes, pivots = work.placed.rotations, work.placed.points, work.placed.axes, work.pivots
    for i in range(len(bodies)):
        for k in range(bodies[i].first, bodies[i].stop):
            put(pivots[k], vector(points[i]))
    m, C, J = 0.0, ZERO, ZERO6
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        p = vector(points[i])
        J = sym_add(J, sym_rotate(rotations[i], symmetric(b.inertia)))
        if b.mass > 0.0:
            d = sub(add(p, apply(rotations[i], vector(b.center))), C)
            J = sym_add(J, point_inertia(m * b.mass / (m + b.mass), d))
            m += b.mass
            C = add(C, scale(b.mass / m, d))
        for k in range(b.stop - 1, b.first - 1, -1):
            axis = vector(axes[k])
            lever = sub(C, p)
            f = scale(m, cross(axis, lever))
            n = add(sym_apply(J, axis), cross(lever, f))
            for j in range(k + 1):
                n_j = add(n, cross(sub(p, vector(pivots[j])), f))
                M[k, j] = dot(vector(axes[j]), n_j)
            M[k, k] += hinges[k].armature
    for k in range(len(hinges)):
        for j in range(k):
            M[j, k] = M[k, j]
