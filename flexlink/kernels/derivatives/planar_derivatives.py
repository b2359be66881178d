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

from flexlink.kernels.bodies.plane import ALPHA as FOUND
from flexlink.kernels.bodies.plane import ARMATURE, GRAVITY, INERTIA, MASS, SIGN, in_plane, planar_workspace
from flexlink.kernels.derivatives.forward_derivatives import ANGLE, INPUT, SPEEDS, ask_joints, keep_columns, keep_given
from flexlink.kernels.forward.mass_plus_diagonal_plane import PlanePosture, turn_levers
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import LANES, at, put_at, vec, zero_of
from flexlink.kernels.tools.vec3 import scale

# Numbers of a link: factors of M; what is beyond passes inward; motion; force through the next hinge; then n, f, b of
# the three kinds of changes.
INVERSE, HX, HY, BETA, GAMMA, MXX, MXY, MYY, GX, GY, OMEGA, ALPHA, AX, AY, FX, FY, PUSH = range(17)
PUSHES, SIZE = 5, 32
PN, PX, PY, BX, BY = range(5)


class PlanarSlopesWork(NamedTuple):
    """Scratch of `all_planar_slopes`."""

    posture: PlanePosture
    rows: Any  # (n, SIZE)
    turned: Any  # (9, 8) row t: σ of the first t columns of a block, 0 of the others
    given: Any  # (9, 8) the same of the columns of prescribed joints
    r: Any  # (3, n, 8)
    x: Any  # (3, n, 8)


@kernel
def all_planar_slopes(bodies, hinges, gravity, wrench, q, qd, tau, found):
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX into `found` (3, n, n) as `all_forward_slopes`; whether all is finite."""
    n, planar = len(q), planar_workspace(bodies, hinges, gravity)
    qdd, levers, lanes = np.zeros(n), np.empty((2, n, 2)), np.empty((6, n, LANES))
    forward_dynamics(wrench, q, qd, tau.copy(), qdd, planar)
    posture = PlanePosture(planar.links, planar.given, planar.trig, levers[0], levers[1])
    weights = np.zeros((2, LANES + 1, LANES))
    work = PlanarSlopesWork(posture, np.empty((n, SIZE)), weights[0], weights[1], lanes[:3], lanes[3:])
    turn_levers(posture)
    factor(work)
    move(planar.base, wrench, qd, work)
    for k in range(n):
        push(k, work)
    for first in range(0, n, LANES):
        for part in range(3):
            ask_joints(hinges, qd, part, first, work.r[part])
        weigh(hinges, first, work)
        solve(first, work)
        for part in range(3):
            keep_columns(work.x[part], first, found[part])
    keep_given(hinges, found)
    return is_finite(q) and is_finite(qd) and is_finite(tau) and is_finite(qdd) and is_finite(found.reshape(-1))


@recursion
def factor(work):
    """M of the chain, link by link from the tip, as in `planar`, and what is beyond each link."""
    links, given, d, h, rows = work.posture.links, work.posture.given, work.posture.d, work.posture.h, work.rows
    Mxx = Mxy = Myy = j = gx = gy = 0.0
    for k in range(len(rows) - 1, -1, -1):
        dx, dy, A, m = d[k, 0], d[k, 1], links[k, ARMATURE], links[k, MASS]
        rows[k, MXX], rows[k, MXY], rows[k, MYY], rows[k, GX], rows[k, GY] = Mxx, Mxy, Myy, gx, gy
        D = links[k, INERTIA] + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = h[k, 0] + gx + Mxx * dx + Mxy * dy, h[k, 1] + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        if given[k]:
            j, gx, gy = D, Hx, Hy
        else:
            inverse = 1.0 / (D + A)
            β = A * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy = β * D, β * Hx, β * Hy
            rows[k, INVERSE], rows[k, HX], rows[k, HY] = inverse, Hx, Hy
            rows[k, BETA], rows[k, GAMMA] = β, D * inverse


@recursion
def move(base, wrench, qd, work):
    """Absolute rates and accelerations, α as `planar` has found it, and the forces that hinges transmit."""
    links, d, h, rows = work.posture.links, work.posture.d, work.posture.h, work.rows
    ω = 0.0
    ax, ay = in_plane(base, scale(-1.0, vec(base, GRAVITY)))
    for k in range(len(rows)):
        ω, α = ω + links[k, SIGN] * qd[k], links[k, FOUND]
        rows[k, OMEGA], rows[k, ALPHA], rows[k, AX], rows[k, AY] = ω, α, ax, ay
        ax, ay = ax + α * d[k, 0] - ω * ω * d[k, 1], ay + α * d[k, 1] + ω * ω * d[k, 0]
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    for k in range(len(rows) - 1, -1, -1):
        rows[k, FX], rows[k, FY] = fx, fy
        ω, α, m = rows[k, OMEGA], rows[k, ALPHA], links[k, MASS]
        fx += m * rows[k, AX] + α * h[k, 0] - ω * ω * h[k, 1]
        fy += m * rows[k, AY] + α * h[k, 1] + ω * ω * h[k, 0]


@recursion
def push(k, work):
    """What link k demands for a change of its angle, its rate, its acceleration; r = (d_y, −d_x), m c = (h_y, −h_x)."""
    row, d, h = work.rows[k], work.posture.d, work.posture.h
    dx, dy, hx, hy = d[k, 0], d[k, 1], h[k, 0], h[k, 1]
    ω, α = row[OMEGA], row[ALPHA]
    ωω = ω * ω
    turned = -hy * row[AX] + hx * row[AY] - dy * row[FX] + dx * row[FY]
    demand(row, PUSH, dx, dy, -α * dy - ωω * dx, α * dx - ωω * dy, -α * hy - ωω * hx, α * hx - ωω * hy, turned)
    demand(row, PUSH + PUSHES, dx, dy, -2.0 * ω * dy, 2.0 * ω * dx, -2.0 * ω * hy, 2.0 * ω * hx, 0.0)
    demand(row, PUSH + 2 * PUSHES, dx, dy, dx, dy, hx, hy, work.posture.links[k, INERTIA])


@recursion
def demand(row, first, dx, dy, bx, by, fx, fy, n):
    """Keep n, f, b, with what b demands of all beyond."""
    Mbx, Mby = row[MXX] * bx + row[MXY] * by, row[MXY] * bx + row[MYY] * by
    row[first + PN] = n + row[GX] * bx + row[GY] * by + dx * Mbx + dy * Mby
    row[first + PX], row[first + PY], row[first + BX], row[first + BY] = fx + Mbx, fy + Mby, bx, by


@recursion
def weigh(hinges, first, work):
    """σ of the first columns of a block, and of those that are given alone."""
    for j in range(LANES):
        k, σ, given = first + j, 0.0, 0.0
        if k < len(hinges):
            σ = work.posture.links[k, SIGN]
            given = σ * hinges[k].prescribed
        work.turned[LANES, j], work.given[LANES, j] = σ, given
    for t in range(LANES):
        for j in range(LANES):
            work.turned[t, j] = work.turned[LANES, j] if t > j else 0.0
            work.given[t, j] = work.given[LANES, j] if t > j else 0.0


@recursion
def solve(first, work):
    """x of a block of columns, of all three kinds of changes: steps of one do not wait for those of another."""
    o = zero_of(work.turned)
    at_rest = o, o, o
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows) - 1, -1, -1):
        turned, given = weights_of(k, first, work)
        angle = load(k, ANGLE, turned, work, *angle)
        speed = load(k, SPEEDS, turned, work, *speed)
        input = load(k, INPUT, given, work, *input)
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows)):
        turned, given = weights_of(k, first, work)
        angle = turn(k, ANGLE, turned, work, *angle)
        speed = turn(k, SPEEDS, turned, work, *speed)
        input = turn(k, INPUT, given, work, *input)


@inlined
def weights_of(k, first, work):
    """σ of the columns of a block that turn link k, and of those whose acceleration does."""
    columns = max(0, min(LANES, k + 1 - first))
    return at(work.turned, columns), at(work.given, columns)


@inlined
def load(k, part, weight, work, n, fx, fy):
    """n and f before link k from those behind it; x keeps T / D."""
    links, given, d, rows, p = work.posture.links, work.posture.given, work.posture.d, work.rows, PUSH + part * PUSHES
    n += d[k, 0] * fx + d[k, 1] * fy + rows[k, p + PN] * weight
    fx, fy = fx + rows[k, p + PX] * weight, fy + rows[k, p + PY] * weight
    if not given[k]:
        τ = links[k, SIGN] * at(work.r, part, k)
        α = (τ - n) * rows[k, INVERSE]
        put_at(work.x, α, part, k)
        n = rows[k, GAMMA] * τ + rows[k, BETA] * n
        fx, fy = fx + rows[k, HX] * α, fy + rows[k, HY] * α
    return n, fx, fy


@inlined
def turn(k, part, weight, work, before, ax, ay):
    """α of link k, and a behind it, from those before it; x keeps its part of the joint."""
    links, given, d, rows, p = work.posture.links, work.posture.given, work.posture.d, work.rows, PUSH + part * PUSHES
    if given[k]:
        put_at(work.x, zero_of(work.turned), part, k)
    else:
        pull = rows[k, HX] * ax + rows[k, HY] * ay
        α = at(work.x, part, k) - rows[k, INVERSE] * pull
        put_at(work.x, links[k, SIGN] * (α - rows[k, GAMMA] * before), part, k)
        before = α + rows[k, BETA] * before
    ax = ax + before * d[k, 0] + rows[k, p + BX] * weight
    ay = ay + before * d[k, 1] + rows[k, p + BY] * weight
    return before, ax, ay
