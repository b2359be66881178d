"""Products (λ² M + λ C + K) x in O(n), for small motion x exp(λt) of a chain about a state with constant rates.

K = ∂(T_GC + T_FL)/∂q, C = ∂(T_GC + T_FR)/∂q̇. A motion x_k of hinge k changes the motion of all outboard bodies by the
δa, η, δω of `inverse_derivatives`, and their orientation by δφ. The sum y of these changes is passed outward:

    hinge k         y ← y + j_k x_k         y = (δa, δφ, η, δω)         j_k = ∂y/∂q_k + λ ∂y/∂q̇_k + λ² ∂y/∂q̈_k
    next body       δa ← δa + η × r + 2 δω × ṙ

A backward pass sums force and moment at each hinge point. A revolute hinge also rotates the load that it transmits, by
(e × f, e × n) x_k; a prismatic hinge shifts it, by (0, e × f) x_k.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.derivatives.inverse_derivatives import (
    BODY_MOTION,
    HINGE_MOTION,
    MotionWork,
    motion_workspace,
    of_hinge,
    outward,
    own_spin,
    spin,
)
from flexlink.kernels.geometry.branches import fork_rows
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import X, Y, Z
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import put_vec_of, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sym3 import sym_apply, sym_of
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale

UNITS = (X, Y, Z)
PARTS = numbered("δa:3 δφ:3 η:3 δω:3")
"""Entries of y, and columns of the matrices A that multiply y."""
HINGE = numbered("e:3 moved:6 j:12 c:6 p:12 D w eb")
"""Columns of a hinge: axis e; e × f and e × n; j; then c, p, D, w and e·b of the elimination."""


class SmallMotion(NamedTuple):
    """A chain in a state, with scratch, and the factors that `factor` writes."""

    chain: Any
    cells: Any  # `Cells` of coupled springs, for `factor` and `solve`; None without couplings
    motion: MotionWork
    tip: Any  # (2, 3) force and moment of fixed direction at the tip; 0 for a follower
    moving: Any  # (1,) bool: at least one rate is not zero
    hinges: Any  # (n, HINGE)
    demands: Any  # (bodies, 6) scratch
    A: Any  # (12, 6) scratch
    forks: Any  # (rows, 12, 6) scratch at forks: A, or y, or force and moment
    size: Any  # (1,) number of leading entries of y that cause loads
    given: Any  # (n,) bool: the x of the hinge is given, so the hinge is not eliminated


@kernel
def small_motion(chain):
    """Scratch for a chain; `set_state` sets its state."""
    n, m = len(chain.hinges), len(chain.bodies)
    return SmallMotion(
        chain, None, motion_workspace(chain), np.zeros((2, 3)), np.zeros(1, np.bool_), np.zeros((n, HINGE.size)),
        np.empty((m, 6)), np.empty((12, 6)), fork_rows(chain, 12, 6), np.zeros(1, np.int64), np.zeros(n, np.bool_),
    )  # fmt: skip


@kernel
def set_state(work, wrench, follower, q, qd):
    """Set the state: angles and constant rates (n,), wrench (6,) in frame 0, or in the tip frame if `follower`."""
    chain, motion, rows = work.chain, work.motion, work.hinges
    force, moment = outward(chain, wrench, follower, q, qd, np.zeros(len(q)), None, motion)
    f = t = ZERO
    if work.forks is not None:
        work.forks[:, 0] = 0.0
    for i in range(len(chain.bodies) - 1, -1, -1):
        b = chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, t = added(work.forks[b.fork], 0, (f, t))
        if b.loaded:
            f, t = scale(-1.0, force), scale(-1.0, moment)
        f, t = added(motion.bodies, i, (f, t), BODY_MOTION.F)
        for k in range(b.first, b.stop):
            e = of_hinge(motion.hinges, k, HINGE_MOTION.e)
            slides = wrench_part(chain, k) == 0
            keep(rows, k, (e, ZERO if slides else cross(e, f), cross(e, f if slides else t)), HINGE.e)
        t = add(t, cross(vec_of(motion.bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            keep(work.forks[b.slot], 0, added(work.forks[b.slot], 0, (f, t)))
            f = t = ZERO
    dead = 0.0 if follower else 1.0
    put_vec_of(work.tip, scale(dead, force), 0, 0)
    put_vec_of(work.tip, scale(dead, moment), 1, 0)
    work.moving[0] = False
    for k in range(len(qd)):
        work.moving[0] = work.moving[0] or qd[k] != 0.0


@recursion
def weigh(work, by_angle, by_rate, by_acceleration):
    """Write j of every hinge for the matrix by_angle K + by_rate C + by_acceleration M."""
    rows, motion = work.hinges, work.motion.hinges
    for k in range(len(rows)):
        e, δω = vec_of(rows, k, HINGE.e), of_hinge(motion, k, HINGE_MOTION.δω)
        η = scale(by_angle, of_hinge(motion, k, HINGE_MOTION.η))
        η = add_scaled(add_scaled(η, 2.0 * by_rate, δω), by_acceleration, e)
        δa, δω = scale(by_angle, of_hinge(motion, k, HINGE_MOTION.δa)), add_scaled(scale(by_angle, δω), by_rate, e)
        keep(rows, k, (δa, scale(by_angle, e), η, δω), HINGE.j)  # `PARTS`
    if work.motion.slides is not None:
        weigh_slides(work, by_angle, by_rate, by_acceleration)
    work.size[0] = PARTS.size if work.moving[0] else PARTS.δω if by_acceleration != 0.0 else PARTS.η


@recursion
def weigh_slides(work, by_angle, by_rate, by_acceleration):
    """Overwrite j of the prismatic hinges."""
    rows, motion = work.hinges, work.motion.hinges
    for k in work.motion.slides:
        δa = add_scaled(
            scale(by_angle, of_hinge(motion, k, HINGE_MOTION.δa)), by_acceleration, vec_of(rows, k, HINGE.e)
        )
        δa = add_scaled(δa, 2.0 * by_rate, of_hinge(motion, k, HINGE_MOTION.δv))
        keep(rows, k, (δa, ZERO, ZERO, ZERO), HINGE.j)  # `PARTS`


@inlined
def wrench_part(chain, k):
    """Index in (f, n) of the vector whose component along e loads hinge k: 0 (f) if prismatic, 3 (n) if revolute."""
    if chain.rare is not None and chain.hinges[k].axis >= SLIDES:
        return 0
    return 3


@inlined
def by_acceleration(bodies, m, i, δa):
    """Force and moment that body i requires for an acceleration δa of its hinge point."""
    return scale(m, δa), cross(vec_of(bodies, i, BODY_MOTION.mc), δa)


@inlined
def by_turning(bodies, i, η):
    """Force and moment that body i requires for the entry η of y."""
    return cross(η, vec_of(bodies, i, BODY_MOTION.mc)), sym_apply(sym_of(bodies, i, BODY_MOTION.I), η)


@inlined
def by_spin(bodies, i, δω):
    """Force and moment that body i requires for the entry δω of y."""
    ω, I = vec_of(bodies, i, BODY_MOTION.ω), sym_of(bodies, i, BODY_MOTION.I)
    return scale(2.0, cross(δω, cross(ω, vec_of(bodies, i, BODY_MOTION.mc)))), spin(own_spin(ω, I), δω)


@inlined
def add_column(A, column, f, n):
    """A[column] += (f, n)."""
    keep(A, column, added(A, column, (f, n)))


@recursion
def keep_motion(forks, row, δa, δφ, η, δω):
    """Store y at a fork, where its branches continue from it."""
    keep(forks[row], 0, (δa, δφ))
    keep(forks[row], 1, (η, δω))


@recursion
def kept_motion(forks, row):
    """Return the y stored at a fork."""
    return kept(forks[row], 0, (ZERO, ZERO)) + kept(forks[row], 1, (ZERO, ZERO))


@inlined
def hinge_acceleration(bodies, i, δa, η, δω):
    """δa at the hinge point of body i, from δa at the hinge point of the parent body."""
    r, u = vec_of(bodies, i, BODY_MOTION.r), vec_of(bodies, i, BODY_MOTION.u)
    return add(δa, add(cross(η, r), scale(2.0, cross(δω, u))))


@inlined
def beyond_hinge(rows, k, x, δa, δφ, η, δω):
    """Return y + j_k x, the y outboard of hinge k."""
    return (
        add_scaled(δa, x, vec_of(rows, k, HINGE.j + PARTS.δa)), add_scaled(δφ, x, vec_of(rows, k, HINGE.j + PARTS.δφ)),
        add_scaled(η, x, vec_of(rows, k, HINGE.j + PARTS.η)), add_scaled(δω, x, vec_of(rows, k, HINGE.j + PARTS.δω)),
    )  # fmt: skip


@kernel
def multiply(work, weights, κ, x, product):
    """Write (weights[0] K + weights[1] C + weights[2] M) x for x (columns, n); `κ` (n,) as for `factor`."""
    weigh(work, weights[0], weights[1], weights[2])
    for column in range(len(x)):
        body_loads(work, x[column])
        answer(work, weights[0], κ, x[column], product[column])


@kernel
def mass_products(chain, q, x, product):
    """Write M x for x (columns, n), computed in body axes, so the twist of a straight slender arm loses no digits."""
    zero, wrench, work = np.zeros(len(q)), np.zeros(6), rne_workspace(chain)
    for column in range(len(x)):
        rne(chain, ZERO, wrench, q, zero, x[column], product[column], work)


@recursion
def body_loads(work, x):
    """Forward pass: write the load that every body requires for x; at the tip, add the change of the wrench."""
    rows, bodies, demands = work.hinges, work.motion.bodies, work.demands
    δa = δφ = η = δω = ZERO
    if work.forks is not None and len(work.forks) > 0:
        keep_motion(work.forks, 0, δa, δφ, η, δω)
    for i in range(len(bodies)):
        b = work.chain.bodies[i]
        if work.forks is not None and b.begins:
            δa, δφ, η, δω = kept_motion(work.forks, b.slot)
        δa = hinge_acceleration(bodies, i, δa, η, δω)
        for k in range(b.first, b.stop):
            δa, δφ, η, δω = beyond_hinge(rows, k, x[k], δa, δφ, η, δω)
        f, n = by_acceleration(bodies, b.mass, i, δa)
        of_η, of_δω = by_turning(bodies, i, η), by_spin(bodies, i, δω)
        keep(demands, i, (add(f, add(of_η[0], of_δω[0])), add(n, add(of_η[1], of_δω[1]))))
        if b.loaded:
            add_column(demands, i, cross(δφ, vec_of(work.tip, 0, 0)), cross(δφ, vec_of(work.tip, 1, 0)))
        if work.forks is not None and b.fork > 0:
            keep_motion(work.forks, b.fork, δa, δφ, η, δω)


@recursion
def answer(work, by_angle, κ, x, product):
    """Backward pass: sum forces and moments, and write κ x + e·n (prismatic: e·f) of every hinge to `product`."""
    rows, bodies, demands = work.hinges, work.motion.bodies, work.demands
    f = n = ZERO
    if work.forks is not None:
        work.forks[:, 0] = 0.0
    for i in range(len(bodies) - 1, -1, -1):
        b = work.chain.bodies[i]
        if work.forks is not None and b.fork > 0:
            f, n = added(work.forks[b.fork], 0, (f, n))
        f, n = added(demands, i, (f, n))
        for k in range(b.stop - 1, b.first - 1, -1):
            product[k] = κ[k] * x[k] + dot(vec_of(rows, k, HINGE.e), n if wrench_part(work.chain, k) else f)
            f = add_scaled(f, by_angle * x[k], vec_of(rows, k, HINGE.moved))
            n = add_scaled(n, by_angle * x[k], vec_of(rows, k, HINGE.moved + 3))
        n = add(n, cross(vec_of(bodies, i, BODY_MOTION.r), f))
        if work.forks is not None and b.begins:
            keep(work.forks[b.slot], 0, added(work.forks[b.slot], 0, (f, n)))
            f = n = ZERO
