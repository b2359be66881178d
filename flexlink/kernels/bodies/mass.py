"""Mass matrix by four methods: the three of Walker & Orin (1982) that the paper names, and composite bodies.

columns     each column is the inverse dynamics of one unit joint acceleration, without the terms that vanish
lower       the same, but the backward pass stops at the moving joint; gives the column on and below the diagonal
upper       outboard bodies move as one rigid body, in body frames; gives the column on and above the diagonal
composite   the same composite bodies in inertial axes; a row needs only joint axes and points (Featherstone 2008, 6.2)

The first two methods work only for arms like the paper's: serial chains of revolute hinges. All four write M (n, n) and
return its trace. The code of the last method works for one state or for eight states side by side (`lanes`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.branches import fork_lanes, fork_rows
from flexlink.kernels.geometry.kinematics import KinematicsWork, kinematics, kinematics_workspace
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.address import records
from flexlink.kernels.tools.axes3 import cos_sin, cross_unit, turn, unit
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import (
    LANES,
    Turns,
    at,
    empty_lanes,
    keep_lanes,
    put_at,
    put_lanes,
    put_vec_of,
    vec_of,
    zero_of,
)
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.sym3 import (
    ZERO6,
    point_inertia,
    product_inertia,
    sym_add,
    sym_apply,
    sym_rotate,
    sym_turn,
    symmetric,
)
from flexlink.kernels.tools.vec3 import ZERO, add, apply, apply_transposed, cross, dot, scale, sub, vector


@inlined
def trace(M):
    """Trace Σ M_kk; if it is finite, every entry of M is finite, since |M_jk|² ≤ M_jj M_kk."""
    total = 0.0
    for k in range(len(M)):
        total += M[k, k]
    return total


@allocating
def turns_of(q):
    """Cosine, sine and value of every hinge coordinate, (n, 3)."""
    turns = np.empty((len(q), 3))
    for k in range(len(q)):
        turns[k, 0], turns[k, 1] = cos_sin(q[k])
        turns[k, 2] = q[k]
    return turns


@recursion
def column(chain, start, j, last, M, turns, loads):
    """Write column j of M, rows n − 1 … `last`, by Newton-Euler with q̈_j = 1; hinge j belongs to body `start`.

    Gravity, rates, gyroscopic terms, springs and the tip wrench are zero and omitted. Bodies inboard of hinge j are at
    rest. `turns` is the result of `turns_of(q)`; `loads` is scratch for the force and moment of every body.
    """
    bodies, hinges = chain.bodies, chain.hinges
    α, a = unit(hinges[j].axis), ZERO
    loads[:start] = 0.0
    for i in range(start, len(bodies)):
        b = bodies[i]
        first = j + 1
        if i > start:
            first = b.first
            a = add(a, cross(α, vector(b.translation)))
            if b.turned:
                α, a = apply_transposed(b.rotation, α), apply_transposed(b.rotation, a)
        for k in range(first, b.stop):
            axis, c, s = hinges[k].axis, turns[k, 0], turns[k, 1]
            α, a = turn(axis, c, -s, α), turn(axis, c, -s, a)
        F = scale(b.mass, add(a, cross(α, vector(b.center))))
        keep(loads, i, (F, add(apply(b.inertia, α), cross(vector(b.center), F))))
    f, n = ZERO, ZERO
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        f, n = added(loads, i, (f, n))
        for k in range(b.stop - 1, max(b.first, last) - 1, -1):
            axis, c, s = hinges[k].axis, turns[k, 0], turns[k, 1]
            M[k, j] = n[axis]
            f, n = turn(axis, c, s, f), turn(axis, c, s, n)
        if b.first <= last:
            break
        if b.turned:
            f, n = apply(b.rotation, f), apply(b.rotation, n)
        n = add(n, cross(vector(b.translation), f))
    M[j, j] += hinges[j].armature


@kernel
def mass_columns(chain, q, M):
    """Write M as n full columns (Walker-Orin method 1)."""
    turns, loads = turns_of(q), np.empty((len(chain.bodies), 6))
    for start in range(len(chain.bodies)):
        for j in range(chain.bodies[start].first, chain.bodies[start].stop):
            column(chain, start, j, 0, M, turns, loads)
    return trace(M)


@kernel
def mass_lower(chain, q, M):
    """Write each column of M from the diagonal down (Walker-Orin method 2)."""
    turns, loads = turns_of(q), np.empty((len(chain.bodies), 6))
    for start in range(len(chain.bodies)):
        for j in range(chain.bodies[start].first, chain.bodies[start].stop):
            column(chain, start, j, j, M, turns, loads)
            for k in range(j + 1, len(q)):
                M[j, k] = M[k, j]
    return trace(M)


@kernel
def mass_upper(chain, q, M):
    """Write each column of M from the diagonal up, by composite bodies in body frames (Walker-Orin method 3)."""
    bodies, hinges, turns = chain.bodies, chain.hinges, turns_of(q)
    m, h, J = 0.0, ZERO, ZERO6  # mass, first moment and inertia of this and all outboard bodies, about the hinge point
    beyond = np.zeros((0 if chain.rare is None else len(bodies), 10))  # m, h, J of branches that begin on each body
    M[:] = 0.0
    for start in range(len(bodies) - 1, -1, -1):
        b = bodies[start]
        if chain.rare is not None and b.fork > 0:
            m, h, J = added(beyond, start, (m, h, J))
        c = vector(b.center)
        m, h = m + b.mass, add(h, scale(b.mass, c))
        J = sym_add(J, sym_add(symmetric(b.inertia), point_inertia(b.mass, c)))
        for j in range(b.stop - 1, b.first - 1, -1):
            axis = hinges[j].axis
            if chain.rare is not None and axis >= SLIDES:
                f, n = scale(m, unit(axis - SLIDES)), cross(h, unit(axis - SLIDES))
            else:
                f, n = cross(unit(axis), h), sym_apply(J, unit(axis))
            k, i = j, start
            while i >= 0:
                while k >= bodies[i].first:
                    if chain.rare is not None and hinges[k].axis >= SLIDES:
                        M[k, j] = M[j, k] = f[hinges[k].axis - SLIDES]
                        n = sub(n, scale(turns[k, 2], cross_unit(f, hinges[k].axis - SLIDES, 0.0)))
                    else:
                        M[k, j] = M[j, k] = n[hinges[k].axis]
                        c, s = turns[k, 0], turns[k, 1]
                        f, n = turn(hinges[k].axis, c, s, f), turn(hinges[k].axis, c, s, n)
                    k -= 1
                if bodies[i].turned:
                    f, n = apply(bodies[i].rotation, f), apply(bodies[i].rotation, n)
                n = add(n, cross(vector(bodies[i].translation), f))
                i = bodies[i].parent - 1
                k = bodies[i].stop - 1
            M[j, j] += hinges[j].armature
            if chain.rare is not None and axis >= SLIDES:
                r = scale(turns[j, 2], unit(axis - SLIDES))
                J = sym_add(J, sym_add(product_inertia(h, r), point_inertia(m, r)))
                h = add(h, scale(m, r))
            else:
                h, J = turn(axis, turns[j, 0], turns[j, 1], h), sym_turn(axis, turns[j, 0], turns[j, 1], J)
        if b.turned:
            h, J = apply(b.rotation, h), sym_rotate(b.rotation, J)
        r = vector(b.translation)
        J = sym_add(J, sym_add(product_inertia(h, r), point_inertia(m, r)))
        h = add(h, scale(m, r))
        if chain.rare is not None and b.begins:
            if b.parent > 0:
                keep(beyond, b.parent - 1, added(beyond, b.parent - 1, (m, h, J)))
            m, h, J = 0.0, ZERO, ZERO6
    return trace(M)


class CompositeWork(NamedTuple):
    """Scratch of `composite`."""

    placed: KinematicsWork
    pivots: Any  # hinge point of every hinge
    masses: Any  # (rows,) masses m of the branches; None for a plain chain
    forks: Any  # (rows, 9) centres C and inertias J of the branches; None for a plain chain
    starts: Any  # (bodies,) index of the first body of each body's branch


@kernel
def composite_workspace(chain):
    """Scratch of `composite` for a chain."""
    return CompositeWork(
        kinematics_workspace(chain), np.empty((len(chain.hinges), 3)), fork_rows(chain), fork_rows(chain, 9),
        starts_of_branches(chain.bodies),
    )  # fmt: skip


@allocating
def starts_of_branches(bodies):
    """Index of the first body of each body's branch, (bodies,)."""
    starts = np.zeros(len(bodies), np.int64)
    for i in range(1, len(bodies)):
        starts[i] = i if bodies[i].begins else starts[i - 1]
    return starts


@kernel
def mass_composite(chain, q, M):
    """Write M by composite bodies in inertial axes; return its trace."""
    composite(chain, q, M, composite_workspace(chain))
    return trace(M)


def mass_matrix(address, q, M):
    """Write M (n, n), initially zero; return whether q has n finite values and M is finite."""
    chain, work = records(address)
    if len(q) != len(M):
        return False
    composite(chain, q, M, work)
    return is_finite(q) and math.isfinite(trace(M))


@recursion
def composite(chain, q, M, work):
    """Write M by composite bodies in inertial axes; q are angles (n,), or the `Turns` of eight states for M (n, n, 8).

    Let all bodies outboard of hinge k, at p_k, have mass m, centre C and inertia J about C. A unit acceleration of the
    hinge requires f = m axis_k × (C − p_k) and n = J axis_k + (C − p_k) × f, or, if hinge k is prismatic, f = m axis_k
    and n = (C − p_k) × f. For each hinge j ≤ k on the path to the base, M_jk = axis_j · (n + (p_k − p_j) × f), or
    M_jk = axis_j · f if hinge j is prismatic.
    """
    bodies, hinges = chain.bodies, chain.hinges
    kinematics(chain, q, work.placed)
    rotations, points, axes, pivots = work.placed.rotations, work.placed.points, work.placed.axes, work.pivots
    for i in range(len(bodies)):
        for k in range(bodies[i].first, bodies[i].stop):
            put_vec_of(pivots, vec_of(points, i, 0), k, 0)
    o = zero_of(points, 0, 0)
    if work.forks is not None and rarely(len(work.forks) > 0):
        work.masses[:] = 0.0
        work.forks[:] = 0.0
        M[:] = 0.0  # entries for joints on different branches stay zero
    m, C, J = 0.0, (o, o, o), (o, o, o, o, o, o)
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        p = vec_of(points, i, 0)
        if chain.rare is not None and rarely(b.fork > 0):
            m, C, J = together(m, C, J, work.masses[b.fork], *kept(work.forks, b.fork, (C, J)))
        J = sym_add(J, sym_rotate(rotations[i], symmetric(b.inertia)))
        if b.mass > 0.0:
            d = sub(add(p, apply(rotations[i], vector(b.center))), C)
            J = sym_add(J, point_inertia(m * b.mass / (m + b.mass), d))
            m += b.mass
            C = add(C, scale(b.mass / m, d))
        for k in range(b.stop - 1, b.first - 1, -1):
            axis = vec_of(axes, k, 0)
            lever = sub(C, p)
            if chain.rare is not None and rarely(hinges[k].axis >= SLIDES):
                f = scale(m, axis)
                n = cross(lever, f)
            else:
                f = scale(m, cross(axis, lever))
                n = add(sym_apply(J, axis), cross(lever, f))
            start, stop = work.starts[i], k + 1
            while True:
                for j in range(bodies[start].first, stop):
                    if chain.rare is not None and rarely(hinges[j].axis >= SLIDES):
                        put_at(M, dot(vec_of(axes, j, 0), f), k, j)
                    else:
                        n_j = add(n, cross(sub(p, vec_of(pivots, j, 0)), f))
                        put_at(M, dot(vec_of(axes, j, 0), n_j), k, j)
                inward = bodies[start].parent - 1
                if inward < 0:
                    break
                start, stop = work.starts[inward], bodies[inward].stop
            put_at(M, at(M, k, k) + hinges[k].armature, k, k)
        if chain.rare is not None and rarely(b.begins):
            if b.slot > 0:
                m, C, J = together(m, C, J, work.masses[b.slot], *kept(work.forks, b.slot, (C, J)))
                work.masses[b.slot] = m
                keep(work.forks, b.slot, (C, J))
            m, C, J = 0.0, (o, o, o), (o, o, o, o, o, o)
    for k in range(len(hinges)):
        for j in range(k):
            put_at(M, at(M, k, j), j, k)


@inlined
def together(m, C, J, m_other, C_other, J_other):
    """Mass, centre of mass, and inertia about this centre, of two bodies combined into one."""
    if m + m_other == 0.0:
        return 0.0, C, sym_add(J, J_other)
    d = sub(C_other, C)
    J = sym_add(sym_add(J, J_other), point_inertia(m * m_other / (m + m_other), d))
    return m + m_other, add(C, scale(m_other / (m + m_other), d)), J


@kernel
def mass_of_many(chain, q):
    """Mass matrices M (b, n, n) of many states q (b, n), by composite bodies, eight states side by side."""
    b, n, m = len(q), len(chain.hinges), len(chain.bodies)
    found, M, trig = np.empty((b, n, n)), empty_lanes((n, n)), empty_lanes((3, n))
    placed = KinematicsWork(empty_lanes((m, 3, 3)), empty_lanes((m, 3)), empty_lanes((n, 3)))
    forks, starts = fork_lanes(chain, 9), starts_of_branches(chain.bodies)
    work = CompositeWork(placed, empty_lanes((n, 3)), fork_rows(chain), forks, starts)
    turns = Turns(trig[1], trig[2], trig[0])
    rows, elements, flat = found.reshape(b, n * n), M.reshape(n * n, LANES), trig.reshape(3, n * LANES)
    for start in range(0, b, LANES):
        put_lanes(q, start, trig[0])
        cos_sin_all(flat[0], flat[1], flat[2])
        composite(chain, turns, M, work)
        keep_lanes(elements, start, rows)
    return found
