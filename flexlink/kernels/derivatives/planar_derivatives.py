"""Derivatives of planar forward dynamics, O(n²): `planar` differentiated with respect to the angle φ of each link.

A unit rotation of link k alone changes r by d, d by −r, m c by h and h by −m c (symbols of `planar_rne`). At constant α
and a, the following quantities change by

    b = −α r − ω² d                   acceleration of the next hinge point
    f = M b − α m c − ω² h            force; M is the translational inertia of all outboard links, from `planar`
    n = g·b + d·M b − m c·a − r·f⁺    moment; g: moment of outboard links per acceleration; f⁺: force of next hinge

A unit change of the rate gives b = −2 ω r, f = M b − 2 ω m c, n = g·b + d·M b. A unit change of the acceleration gives
b = d, f = M d + h, n = I + g·d + d·M d. A unit change of q_j rotates link j and all later links by σ_j, so all columns
share the same b, f, n; column j uses them from link j on. With joint torques r, the factors of the mass matrix then
give x, for eight columns of one state at once or, for many states, for one column of eight states at once:

    inward      n ← n + d·f + n_k        f ← f + f_k        T = σ r − n       n ← σ r − A T / D       f ← f + H T / D
    outward     α = T / D + (A / D) α_before − H·a / D      σ x = α − α_before      a ← a + α d + b_k
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import BASE, LINK, PlanarWork, in_plane, planar_workspace
from flexlink.kernels.derivatives.forward_derivatives import (
    VARIABLE,
    begin,
    force_loads,
    friction_derivative,
    joint_loads,
    keep_prescribed,
)
from flexlink.kernels.derivatives.inverse_derivatives import keep_columns
from flexlink.kernels.forces.elements import find_slopes, force_slopes_of, forces_of
from flexlink.kernels.forward.mass_plus_plane import PlanePosture, levers_alone, turn_levers
from flexlink.kernels.forward.solvers import forward_dynamics
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.finite import are_finite, is_finite
from flexlink.kernels.tools.lanes import LANES, at, put_at, put_lanes, vec, vec_of, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.vec3 import scale

ROW = numbered(
    "inverse hx hy β γ",  # factors of the mass matrix: 1 / D, H, A / D, 1 − A / D
    "Mxx Mxy Myy gx gy",  # M and g of all outboard links
    "ω α ax ay fx fy",  # motion; force through the next hinge
    "changes:15 unused",  # three `CHANGE`s: for a unit angle, rate and acceleration
)
CHANGE = numbered("n fx fy bx by")


class PlanarDerivativesWork(NamedTuple):
    """Scratch for one state with eight columns side by side, or for eight states side by side."""

    posture: PlanePosture
    rows: Any  # (n, SIZE)
    turned: Any  # (9, 8) row t: σ for the first t columns of a block, 0 for the others; None for eight states
    prescribed: Any  # (9, 8) the same, but 0 for joints that are not prescribed
    r: Any  # (3, n, 8)
    x: Any  # (3, n, 8)


class OneState(NamedTuple):
    """Scratch of `derivatives_in_plane`: of forward dynamics, of the columns, and of force elements."""

    planar: PlanarWork
    solution: Any  # (2, n) torques and q̈
    columns: PlanarDerivativesWork
    slopes: Any  # None for a plain chain


@kernel
def planar_derivatives_workspace(chain):
    """Scratch of `derivatives_in_plane` for a chain."""
    n, planar = len(chain.hinges), planar_workspace(chain)
    posture, lanes = levers_alone(planar, np.empty((2, n, 2))), np.empty((6, n, LANES))
    weights = np.zeros((2, LANES + 1, LANES))
    columns = PlanarDerivativesWork(posture, np.empty((n, ROW.size)), weights[0], weights[1], lanes[:3], lanes[3:])
    return OneState(planar, np.empty((2, n)), columns, force_slopes_of(chain, planar.forces))


@subroutine
def derivatives_in_plane(chain, wrench, q, qd, tau, found, work):
    """Write what `derivatives_in_space` writes; return whether all values are finite."""
    hinges, torque, qdd, columns = chain.hinges, work.solution[0], work.solution[1], work.columns
    begin(tau, torque, qdd)
    forward_dynamics(wrench, q, qd, torque, qdd, work.planar)
    if work.slopes is not None:
        find_slopes(work.slopes, q, qd)
    differentiate(work.planar.base, wrench, qd, columns)
    for first in range((len(q) - 1) // LANES * LANES, -1, -LANES):
        for variable in range(3):
            joint_loads(hinges, qd, variable, first, columns.r[variable])
            if work.slopes is not None and work.slopes.act and variable != VARIABLE.tau:
                force_loads(work.slopes.found[variable], first, columns.r[variable])
        weigh(hinges, first, columns)
        solve(first, columns)
        for variable in range(3):
            keep_columns(columns.x[variable], first, found[variable])
    keep_prescribed(hinges, found[VARIABLE.tau])
    return is_finite(q) and is_finite(qd) and is_finite(tau) and is_finite(qdd) and are_finite(found)


@recursion
def differentiate(base, wrench, qd, work):
    """Write the factors and the changes b, f, n of every link; forward dynamics must have run on this state."""
    turn_levers(work.posture)
    factor(work)
    move(base, wrench, qd, work)
    for k in range(len(work.rows)):
        write_changes(k, work)


@recursion
def factor(work):
    """Factor the mass matrix from the tip to the base, as in `planar`; store M and g of the links outboard."""
    links, prescribed, d, h = work.posture.links, work.posture.prescribed, work.posture.d, work.posture.h
    rows = work.rows
    o = zero_of(rows, 0, 0)
    Mxx = Mxy = Myy = j = gx = gy = o
    for k in range(len(rows) - 1, -1, -1):
        dx, dy, A, m = at(d, k, 0), at(d, k, 1), at(links, k, LINK.armature), at(links, k, LINK.mass)
        keep(rows, k, (Mxx, Mxy, Myy, gx, gy), ROW.Mxx)
        D = at(links, k, LINK.inertia) + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = at(h, k, 0) + gx + Mxx * dx + Mxy * dy, at(h, k, 1) + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        if prescribed[k]:
            j, gx, gy = D, Hx, Hy
        else:
            inverse = 1.0 / (D + A)
            β = A * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy = β * D, β * Hx, β * Hy
            keep(rows, k, (inverse, Hx, Hy, β, D * inverse), ROW.inverse)


@recursion
def move(base, wrench, qd, work):
    """Write absolute rates, accelerations (α from the solution of `planar`) and the forces that hinges transmit."""
    links, d, h, rows = work.posture.links, work.posture.d, work.posture.h, work.rows
    ω = zero_of(qd)
    ax, ay = in_plane(base, scale(-1.0, vec(base, BASE.gravity)))
    for k in range(len(rows)):
        ω, α = ω + at(links, k, LINK.sign) * at(qd, k), at(links, k, LINK.α)
        keep(rows, k, (ω, α, ax, ay), ROW.ω)
        dx, dy = at(d, k, 0), at(d, k, 1)
        ax, ay = ax + α * dx - ω * ω * dy, ay + α * dy + ω * ω * dx
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    for k in range(len(rows) - 1, -1, -1):
        keep(rows, k, (fx, fy), ROW.fx)
        ω, α, m = at(rows, k, ROW.ω), at(rows, k, ROW.α), at(links, k, LINK.mass)
        hx, hy = at(h, k, 0), at(h, k, 1)
        fx += m * at(rows, k, ROW.ax) + α * hx - ω * ω * hy
        fy += m * at(rows, k, ROW.ay) + α * hy + ω * ω * hx


@recursion
def write_changes(k, work):
    """Write b, f, n of link k for unit changes of angle, rate, acceleration; r = (d_y, −d_x), m c = (h_y, −h_x)."""
    rows, d, h = work.rows, work.posture.d, work.posture.h
    dx, dy, hx, hy = at(d, k, 0), at(d, k, 1), at(h, k, 0), at(h, k, 1)
    ω, α, I = at(rows, k, ROW.ω), at(rows, k, ROW.α), at(work.posture.links, k, LINK.inertia)
    ωω = ω * ω
    turned = -hy * at(rows, k, ROW.ax) + hx * at(rows, k, ROW.ay) - dy * at(rows, k, ROW.fx) + dx * at(rows, k, ROW.fy)
    bx, by, fx, fy = -α * dy - ωω * dx, α * dx - ωω * dy, -α * hy - ωω * hx, α * hx - ωω * hy
    write_change(rows, k, ROW.changes, dx, dy, bx, by, fx, fy, turned)
    bx, by, fx, fy = -2.0 * ω * dy, 2.0 * ω * dx, -2.0 * ω * hy, 2.0 * ω * hx
    write_change(rows, k, ROW.changes + CHANGE.size, dx, dy, bx, by, fx, fy, zero_of(rows, 0, 0))
    write_change(rows, k, ROW.changes + 2 * CHANGE.size, dx, dy, dx, dy, hx, hy, I)


@recursion
def write_change(rows, k, first, dx, dy, bx, by, fx, fy, n):
    """Write n, f and b to row k; n and f include the load of all outboard links due to b."""
    Mxx, Mxy, Myy = vec_of(rows, k, ROW.Mxx)
    Mbx, Mby = Mxx * bx + Mxy * by, Mxy * bx + Myy * by
    turned = n + at(rows, k, ROW.gx) * bx + at(rows, k, ROW.gy) * by + dx * Mbx + dy * Mby
    keep(rows, k, (turned, fx + Mbx, fy + Mby, bx, by), first)  # `CHANGE`


@recursion
def weigh(hinges, first, work):
    """Write σ of the first t columns of a block, t = 0 … 8, for all joints and for prescribed joints alone."""
    for j in range(LANES):
        k, σ, prescribed = first + j, 0.0, 0.0
        if k < len(hinges):
            σ = work.posture.links[k, LINK.sign]
            prescribed = σ * hinges[k].prescribed
        work.turned[LANES, j], work.prescribed[LANES, j] = σ, prescribed
    for t in range(LANES):
        for j in range(LANES):
            work.turned[t, j] = work.turned[LANES, j] if t > j else 0.0
            work.prescribed[t, j] = work.prescribed[LANES, j] if t > j else 0.0


@recursion
def solve(first, work):
    """Write x, the derivatives of q̈ by q, q̇ and T_EX, for a block of columns or, in eight states, for one column.

    The three recursions run interleaved. They are independent, so the processor can overlap their steps: none waits for
    the result of another.
    """
    o = zero_of(work.x, 0, 0)
    at_rest = o, o, o
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows) - 1, -1, -1):
        turned, prescribed = weights_of(k, first, work)
        angle = load(k, VARIABLE.q, turned, work, *angle)
        speed = load(k, VARIABLE.qd, turned, work, *speed)
        input = load(k, VARIABLE.tau, prescribed, work, *input)
    angle, speed, input = at_rest, at_rest, at_rest
    for k in range(len(work.rows)):
        turned, prescribed = weights_of(k, first, work)
        angle = turn(k, VARIABLE.q, turned, work, *angle)
        speed = turn(k, VARIABLE.qd, turned, work, *speed)
        input = turn(k, VARIABLE.tau, prescribed, work, *input)


@inlined
def weights_of(k, first, work):
    """σ of the columns of a block, or of the one column, that move link k; for all, and for prescribed joints alone."""
    if work.turned is not None:
        columns = max(0, min(LANES, k + 1 - first))
        return at(work.turned, columns), at(work.prescribed, columns)
    o, σ = zero_of(work.x, 0, 0), at(work.posture.links, first, LINK.sign)
    return (σ, σ if work.posture.prescribed[first] else o) if k >= first else (o, o)


@inlined
def load(k, variable, weight, work, n, fx, fy):
    """Return n and f inboard of link k, given n and f outboard of it; write T / D to x."""
    links, prescribed, d, rows = work.posture.links, work.posture.prescribed, work.posture.d, work.rows
    p = ROW.changes + variable * CHANGE.size
    n += at(d, k, 0) * fx + at(d, k, 1) * fy + at(rows, k, p + CHANGE.n) * weight
    fx, fy = fx + at(rows, k, p + CHANGE.fx) * weight, fy + at(rows, k, p + CHANGE.fy) * weight
    if not prescribed[k]:
        τ = at(links, k, LINK.sign) * at(work.r, variable, k)
        α = (τ - n) * at(rows, k, ROW.inverse)
        put_at(work.x, α, variable, k)
        n = at(rows, k, ROW.γ) * τ + at(rows, k, ROW.β) * n
        fx, fy = fx + at(rows, k, ROW.hx) * α, fy + at(rows, k, ROW.hy) * α
    return n, fx, fy


@inlined
def turn(k, variable, weight, work, before, ax, ay):
    """Return α of link k and a at its far end, from α and a inboard of it; write the q̈ of joint k to x."""
    links, prescribed, d, rows = work.posture.links, work.posture.prescribed, work.posture.d, work.rows
    p = ROW.changes + variable * CHANGE.size
    if prescribed[k]:
        put_at(work.x, zero_of(work.x, 0, 0), variable, k)
    else:
        pull = at(rows, k, ROW.hx) * ax + at(rows, k, ROW.hy) * ay
        α = at(work.x, variable, k) - at(rows, k, ROW.inverse) * pull
        put_at(work.x, at(links, k, LINK.sign) * (α - at(rows, k, ROW.γ) * before), variable, k)
        before = α + at(rows, k, ROW.β) * before
    ax = ax + before * at(d, k, 0) + at(rows, k, p + CHANGE.bx) * weight
    ay = ay + before * at(d, k, 1) + at(rows, k, p + CHANGE.by) * weight
    return before, ax, ay


@kernel
def planar_derivatives_of_many(chain, planar, wrench, q, qd, tau, found):
    """Write derivatives at states (b, n) with wrenches (b, 6) to `found` (3, b, n, n), eight states side by side.

    `planar` is scratch for eight copies of the chain. Returns whether all values are finite.
    """
    hinges, finite = chain.hinges, True
    n = len(hinges)
    slopes = None if chain.rare is None else np.zeros((2, n, n, LANES))  # of force elements
    state, acting, levers = np.empty((4, n, LANES)), np.empty((6, LANES)), np.empty((2, n, 2, LANES))
    lanes = np.zeros((6, n, LANES))
    posture = levers_alone(planar, levers)
    work = PlanarDerivativesWork(posture, np.empty((n, ROW.size, LANES)), None, None, lanes[:3], lanes[3:])
    for start in range(0, len(q), LANES):
        put_lanes(wrench, start, acting)
        put_lanes(q, start, state[0])
        put_lanes(qd, start, state[1])
        put_lanes(tau, start, state[2])
        state[3, :, :] = 0.0
        forward_dynamics(acting, state[0], state[1], state[2], state[3], planar)
        differentiate(planar.base, acting, state[1], work)
        if chain.rare is not None:
            find_slopes_of_eight(chain, q, qd, start, slopes)
        for j in range(n):
            put_joint_loads(hinges[j], j, state[1], work.r)
            if chain.rare is not None:
                put_force_loads(slopes, j, work.r)
            solve(j, work)
            if chain.rare is None:
                work.r[:, j, :] = 0.0
            else:
                work.r[:, :, :] = 0.0
            for lane in range(min(LANES, len(q) - start)):
                for variable in range(3):
                    for k in range(n):
                        found[variable, start + lane, k, j] = work.x[variable, k, lane]
        for i in range(start, min(start + LANES, len(q))):
            keep_prescribed(hinges, found[VARIABLE.tau, i])
            finite = are_finite((found[0, i], found[1, i], found[2, i])) and finite
    return finite


@recursion
def put_joint_loads(hinge, j, qd, r):
    """Write the torques of joint j in eight states due to a unit change of its angle, rate or drive torque."""
    for lane in range(LANES):
        r[VARIABLE.q, j, lane] = -hinge.stiffness
        r[VARIABLE.qd, j, lane] = -friction_derivative(hinge, qd[j, lane])
        r[VARIABLE.tau, j, lane] = 0.0 if hinge.prescribed else 1.0


@allocating
def find_slopes_of_eight(chain, q, qd, start, found):
    """Write the derivatives of element torques by q and q̇ to `found`, for up to eight states from `start` on."""
    slopes = force_slopes_of(chain, forces_of(chain))
    for lane in range(min(LANES, len(q) - start) if slopes.act else 0):
        find_slopes(slopes, q[start + lane], qd[start + lane])
        found[:, :, :, lane] = slopes.found


@recursion
def put_force_loads(slopes, j, r):
    """Subtract from r the derivatives of element torques by the angle and rate of joint j, for eight states."""
    for part in range(2):
        for k in range(r.shape[1]):
            for lane in range(LANES):
                r[part, k, lane] -= slopes[part, k, j, lane]
