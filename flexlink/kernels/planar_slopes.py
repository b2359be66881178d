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

from flexlink.kernels.compiler import kernel, recursion
from flexlink.kernels.finite import is_finite
from flexlink.kernels.forward import forward_dynamics
from flexlink.kernels.forward_slopes import INPUT, ask_joints, keep_columns, keep_given
from flexlink.kernels.lanes import LANES, at, put_at, vec, zero_of
from flexlink.kernels.planar import ARMATURE, GRAVITY, INERTIA, MASS, SIGN, in_plane, planar_workspace
from flexlink.kernels.shifted_plane import PlanePosture, place_in_plane
from flexlink.kernels.vec3 import scale

# Numbers of a link: factors of M; what is beyond passes inward; motion; force through the next hinge; then n, f, b of
# the three kinds of changes.
INVERSE, HX, HY, BETA, MXX, MXY, MYY, GX, GY, OMEGA, ALPHA, AX, AY, FX, FY, PUSH = range(16)
PUSHES, SIZE = 5, 31
PN, PX, PY, BX, BY = range(5)


class PlanarSlopesWork(NamedTuple):
    """Scratch of `all_planar_slopes`."""

    posture: PlanePosture
    rows: Any  # (n, SIZE)
    weights: Any  # (9, 8) σ of the first columns of a block, 0 of the others
    r: Any  # (n, 8)
    x: Any  # (n, 8)


@kernel
def all_planar_slopes(chain, wrench, q, qd, tau, found):
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX into `found` (3, n, n) as `all_forward_slopes`; whether all is finite."""
    n, planar = len(q), planar_workspace(chain.bodies, chain.hinges, chain.gravity)
    qdd = np.zeros(n)
    forward_dynamics(wrench, q, qd, tau.copy(), qdd, planar)
    posture = PlanePosture(planar.links, planar.given, planar.trig, np.empty((n, 2)), np.empty((n, 2)))
    work = PlanarSlopesWork(
        posture, np.empty((n, SIZE)), np.zeros((LANES + 1, LANES)), np.empty((n, LANES)), np.empty((n, LANES))
    )
    place_in_plane(q, posture)
    factor(work)
    move(planar.base, wrench, qd, qdd, work)
    for k in range(n):
        push(k, work)
    for part in range(3):
        for first in range(0, n, LANES):
            ask_joints(chain.hinges, qd, part, first, work.r)
            weigh(chain.hinges, part, first, work)
            solve(part, first, work)
            keep_columns(work.x, first, found[part])
    keep_given(chain.hinges, found)
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
            j, gx, gy = A * (1.0 - β), β * Hx, β * Hy
            rows[k, INVERSE], rows[k, HX], rows[k, HY], rows[k, BETA] = inverse, Hx, Hy, β


@recursion
def move(base, wrench, qd, qdd, work):
    """Absolute rates and accelerations, and the forces that hinges transmit."""
    links, d, h, rows = work.posture.links, work.posture.d, work.posture.h, work.rows
    ω = α = 0.0
    ax, ay = in_plane(base, scale(-1.0, vec(base, GRAVITY)))
    for k in range(len(rows)):
        ω, α = ω + links[k, SIGN] * qd[k], α + links[k, SIGN] * qdd[k]
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
def weigh(hinges, part, first, work):
    """Row t of `weights`: σ of the first t columns of a block, of accelerations only where they are given."""
    for j in range(LANES):
        k, σ = first + j, 0.0
        if k < len(hinges) and (part != INPUT or hinges[k].prescribed):
            σ = work.posture.links[k, SIGN]
        for t in range(LANES + 1):
            work.weights[t, j] = σ if t > j else 0.0


@recursion
def solve(part, first, work):
    """x of a block of columns."""
    links, given, d, rows = work.posture.links, work.posture.given, work.posture.d, work.rows
    p = PUSH + part * PUSHES
    o = zero_of(work.x)
    fx = fy = n = o
    for k in range(len(rows) - 1, -1, -1):
        weight = at(work.weights, max(0, min(LANES, k + 1 - first)))
        n += d[k, 0] * fx + d[k, 1] * fy + rows[k, p + PN] * weight
        fx, fy = fx + rows[k, p + PX] * weight, fy + rows[k, p + PY] * weight
        if not given[k]:
            τ = links[k, SIGN] * at(work.r, k)
            α = (τ - n) * rows[k, INVERSE]
            put_at(work.x, α, k)
            n = τ - links[k, ARMATURE] * α
            fx, fy = fx + rows[k, HX] * α, fy + rows[k, HY] * α
    ax = ay = before = o
    for k in range(len(rows)):
        weight = at(work.weights, max(0, min(LANES, k + 1 - first)))
        if given[k]:
            put_at(work.x, o, k)
        else:
            pull = rows[k, HX] * ax + rows[k, HY] * ay
            α = at(work.x, k) + rows[k, BETA] * before - rows[k, INVERSE] * pull
            put_at(work.x, links[k, SIGN] * (α - before), k)
            before = α
        ax = ax + before * d[k, 0] + rows[k, p + BX] * weight
        ay = ay + before * d[k, 1] + rows[k, p + BY] * weight
