"""Slopes of forward dynamics in a plane, O(n²): `planar`, differentiated along the absolute angle of each link.

Where link k alone turns, r by d, d by −r, m c by h and h by −m c, its demands change at constant α and a by

    b = −α r − ω² d                   of the acceleration of the next hinge point
    f = M b − α m c − ω² h            M and g of what is beyond, as `planar` passes them inward
    n = g·b + d·M b − m c·a − r·f⁺    f⁺ the force that the next hinge transmits

and where its rate alone changes by b = −2 ω r, f = M b − 2 ω m c, n = g·b + d·M b; its acceleration by b = d,
f = M d + h, n = I + g·d + d·M d. A change of q_j by 1 turns all links from j on by σ_j: the same numbers for every
column, from j on. They go through the factors of M eight columns side by side,

    inward      n ← n + d·f + n_k        f ← f + f_k        T = σ r − n       n ← σ r − A T / D       f ← f + H T / D
    outward     α = T / D + (A / D) α_before − H·a / D      σ x = α − α_before      a ← a + α d + b_k
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import BASE, LINK, PlanarWork, in_plane, planar_workspace
from flexlink.kernels.derivatives.forward_derivatives import (
    VARIABLE,
    begin,
    joint_loads,
    keep_prescribed,
)
from flexlink.kernels.derivatives.inverse_derivatives import Arrays, keep_columns
from flexlink.kernels.forward.mass_plus_diagonal_plane import PlanePosture, turn_levers
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.tools.compiler import inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.finite import are_finite, is_finite
from flexlink.kernels.tools.lanes import LANES, at, put_at, vec, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.vec3 import scale

ROW = numbered(
    "inverse hx hy β γ",  # of a link: factors of M
    "Mxx Mxy Myy gx gy",  # what all beyond it passes inward
    "ω α ax ay fx fy",  # motion; force through the next hinge
    "changes:15 unused",  # a `CHANGE` of the angle, of the rate, of the acceleration
)
CHANGE = numbered("n fx fy bx by")


class PlanarDerivativesWork(NamedTuple):
    """Scratch of `derivatives_in_plane`, with the constants of a chain."""

    planar: PlanarWork
    solution: Any  # (2, n) T_EX and q̈
    posture: PlanePosture
    rows: Any  # (n, SIZE)
    turned: Any  # (⌈n/8⌉, 9, 8) row t: σ of the first t columns of a block, 0 of the others
    prescribed: Any  # (⌈n/8⌉, 9, 8) the same of the columns of prescribed joints
    r: Any  # (3, n, 8)
    x: Any  # (3, n, 8)


@kernel
def planar_derivatives_workspace(bodies, hinges, gravity):
    """Scratch of `derivatives_in_plane` for a chain."""
    n, planar = len(hinges), planar_workspace(bodies, hinges, gravity)
    levers, lanes, weights = (
        np.empty((2, n, 2)),
        np.empty((6, n, LANES)),
        np.empty((2, -(-n // LANES), LANES + 1, LANES)),
    )
    for block in range(weights.shape[1]):
        weigh(hinges, planar.links, block * LANES, weights[0, block], weights[1, block])
    posture = PlanePosture(planar.links, planar.prescribed, planar.trig, levers[0], levers[1])
    rows, r, x = np.empty((n, ROW.size)), lanes[:3], lanes[3:]
    return PlanarDerivativesWork(planar, np.empty((2, n)), posture, rows, weights[0], weights[1], r, x)


@kernel
def planar_derivatives(bodies, hinges, gravity, wrench, q, qd, tau, found):
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX into `found` (3, n, n) as `forward_derivatives`; whether all is finite."""
    work, slopes = planar_derivatives_workspace(bodies, hinges, gravity), (found[0], found[1], found[2])
    return derivatives_in_plane(Arrays(bodies, hinges, gravity), wrench, q, qd, tau, slopes, work)


@subroutine
def derivatives_in_plane(chain, wrench, q, qd, tau, found, work):
    """Write three arrays (n, n), on scratch that serves many states; whether all is finite."""
    n, hinges, torque, qdd = len(q), chain.hinges, work.solution[0], work.solution[1]
    begin(tau, torque, qdd)
    forward_dynamics(wrench, q, qd, torque, qdd, work.planar)
    turn_levers(work.posture)
    factor(work)
    move(work.planar.base, wrench, qd, work)
    for k in range(n):
        write_changes(k, work)
    for first in range((n - 1) // LANES * LANES, -1, -LANES):
        for variable in range(3):
            joint_loads(hinges, qd, variable, first, work.r[variable])
        solve(first, work.turned[first // LANES], work.prescribed[first // LANES], work)
        for variable in range(3):
            keep_columns(work.x[variable], first, found[variable])
    keep_prescribed(hinges, found[VARIABLE.tau])
    return is_finite(q) and is_finite(qd) and is_finite(tau) and is_finite(qdd) and are_finite(found)


@recursion
def factor(work):
    """M of the chain, link by link from the tip, as in `planar`, and what is beyond each link."""
    links, prescribed, d, h = work.posture.links, work.posture.prescribed, work.posture.d, work.posture.h
    rows = work.rows
    Mxx = Mxy = Myy = j = gx = gy = 0.0
    for k in range(len(rows) - 1, -1, -1):
        dx, dy, A, m = d[k, 0], d[k, 1], links[k, LINK.armature], links[k, LINK.mass]
        rows[k, ROW.Mxx], rows[k, ROW.Mxy], rows[k, ROW.Myy], rows[k, ROW.gx], rows[k, ROW.gy] = Mxx, Mxy, Myy, gx, gy
        D = links[k, LINK.inertia] + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = h[k, 0] + gx + Mxx * dx + Mxy * dy, h[k, 1] + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        if prescribed[k]:
            j, gx, gy = D, Hx, Hy
        else:
            inverse = 1.0 / (D + A)
            β = A * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy = β * D, β * Hx, β * Hy
            rows[k, ROW.inverse], rows[k, ROW.hx], rows[k, ROW.hy] = inverse, Hx, Hy
            rows[k, ROW.β], rows[k, ROW.γ] = β, D * inverse


@recursion
def move(base, wrench, qd, work):
    """Absolute rates and accelerations, α as `planar` has found it, and the forces that hinges transmit."""
    links, d, h, rows = work.posture.links, work.posture.d, work.posture.h, work.rows
    ω = 0.0
    ax, ay = in_plane(base, scale(-1.0, vec(base, BASE.gravity)))
    for k in range(len(rows)):
        ω, α = ω + links[k, LINK.sign] * qd[k], links[k, LINK.α]
        rows[k, ROW.ω], rows[k, ROW.α], rows[k, ROW.ax], rows[k, ROW.ay] = ω, α, ax, ay
        ax, ay = ax + α * d[k, 0] - ω * ω * d[k, 1], ay + α * d[k, 1] + ω * ω * d[k, 0]
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    for k in range(len(rows) - 1, -1, -1):
        rows[k, ROW.fx], rows[k, ROW.fy] = fx, fy
        ω, α, m = rows[k, ROW.ω], rows[k, ROW.α], links[k, LINK.mass]
        fx += m * rows[k, ROW.ax] + α * h[k, 0] - ω * ω * h[k, 1]
        fy += m * rows[k, ROW.ay] + α * h[k, 1] + ω * ω * h[k, 0]


@recursion
def write_changes(k, work):
    """What link k demands for a change of its angle, its rate, its acceleration; r = (d_y, −d_x), m c = (h_y, −h_x)."""
    row, d, h = work.rows[k], work.posture.d, work.posture.h
    dx, dy, hx, hy = d[k, 0], d[k, 1], h[k, 0], h[k, 1]
    ω, α = row[ROW.ω], row[ROW.α]
    ωω = ω * ω
    turned = -hy * row[ROW.ax] + hx * row[ROW.ay] - dy * row[ROW.fx] + dx * row[ROW.fy]
    bx, by, fx, fy = -α * dy - ωω * dx, α * dx - ωω * dy, -α * hy - ωω * hx, α * hx - ωω * hy
    write_change(row, ROW.changes, dx, dy, bx, by, fx, fy, turned)
    write_change(row, ROW.changes + CHANGE.size, dx, dy, -2.0 * ω * dy, 2.0 * ω * dx, -2.0 * ω * hy, 2.0 * ω * hx, 0.0)
    write_change(row, ROW.changes + 2 * CHANGE.size, dx, dy, dx, dy, hx, hy, work.posture.links[k, LINK.inertia])


@recursion
def write_change(row, first, dx, dy, bx, by, fx, fy, n):
    """Keep n, f, b, with what b demands of all beyond."""
    Mbx, Mby = row[ROW.Mxx] * bx + row[ROW.Mxy] * by, row[ROW.Mxy] * bx + row[ROW.Myy] * by
    row[first + CHANGE.n] = n + row[ROW.gx] * bx + row[ROW.gy] * by + dx * Mbx + dy * Mby
    row[first + CHANGE.fx], row[first + CHANGE.fy], row[first + CHANGE.bx] = fx + Mbx, fy + Mby, bx
    row[first + CHANGE.by] = by


@kernel
def weigh(hinges, links, first, turned, prescribed):
    """σ of the first columns of a block, and of those that are given alone."""
    for t in range(LANES + 1):
        for j in range(LANES):
            k = first + j
            turned[t, j] = links[k, LINK.sign] if t > j and k < len(hinges) else 0.0
            prescribed[t, j] = turned[t, j] * hinges[min(k, len(hinges) - 1)].prescribed


@recursion
def solve(first, by_column, given, work):
    """x of a block of columns, of all three kinds of changes: steps of one do not wait for those of another.

    `by_column`: σ of the columns that turn a link, `given`: of those whose acceleration does.
    """
    o = zero_of(work.x, 0, 0)
    at_rest = o, o, o
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows) - 1, -1, -1):
        columns = max(0, min(LANES, k + 1 - first))
        turned, prescribed = at(by_column, columns), at(given, columns)
        angle = load(k, VARIABLE.q, turned, work, *angle)
        speed = load(k, VARIABLE.qd, turned, work, *speed)
        input = load(k, VARIABLE.tau, prescribed, work, *input)
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows)):
        columns = max(0, min(LANES, k + 1 - first))
        turned, prescribed = at(by_column, columns), at(given, columns)
        angle = turn(k, VARIABLE.q, turned, work, *angle)
        speed = turn(k, VARIABLE.qd, turned, work, *speed)
        input = turn(k, VARIABLE.tau, prescribed, work, *input)


@inlined
def load(k, variable, weight, work, n, fx, fy):
    """n and f before link k from those behind it; x keeps T / D."""
    links, prescribed, d, rows = work.posture.links, work.posture.prescribed, work.posture.d, work.rows
    p = ROW.changes + variable * CHANGE.size
    n += d[k, 0] * fx + d[k, 1] * fy + rows[k, p + CHANGE.n] * weight
    fx, fy = fx + rows[k, p + CHANGE.fx] * weight, fy + rows[k, p + CHANGE.fy] * weight
    if not prescribed[k]:
        τ = links[k, LINK.sign] * at(work.r, variable, k)
        α = (τ - n) * rows[k, ROW.inverse]
        put_at(work.x, α, variable, k)
        n = rows[k, ROW.γ] * τ + rows[k, ROW.β] * n
        fx, fy = fx + rows[k, ROW.hx] * α, fy + rows[k, ROW.hy] * α
    return n, fx, fy


@inlined
def turn(k, variable, weight, work, before, ax, ay):
    """α of link k, and a behind it, from those before it; x keeps its part of the joint."""
    links, prescribed, d, rows = work.posture.links, work.posture.prescribed, work.posture.d, work.rows
    p = ROW.changes + variable * CHANGE.size
    if prescribed[k]:
        put_at(work.x, zero_of(work.x, 0, 0), variable, k)
    else:
        pull = rows[k, ROW.hx] * ax + rows[k, ROW.hy] * ay
        α = at(work.x, variable, k) - rows[k, ROW.inverse] * pull
        put_at(work.x, links[k, LINK.sign] * (α - rows[k, ROW.γ] * before), variable, k)
        before = α + rows[k, ROW.β] * before
    ax = ax + before * d[k, 0] + rows[k, p + CHANGE.bx] * weight
    ay = ay + before * d[k, 1] + rows[k, p + CHANGE.by] * weight
    return before, ax, ay
