"""Gradient of w·τ with respect to q and q̇ at constant w and q̈, O(n): recursive Newton-Euler in reverse.

w·τ is the power of all loads if the joints had the rates w: Σ (U·F + Ω·N), with the angular rate Ω of a body and the
velocity U of its hinge point. With the other symbols of `inverse_derivatives`, all in axes of frame 0,

    outward     Ω ← Ω + e w     U ← U + Ω × r
    body        P = m U + Ω × m c                                  = Σ m U_x          factor of a change of a
                L = m c × U + I Ω                                  = Σ ρ × m U_x      factor of η
                C = 2 (ω × m c) × U + (tr I 1 − 2 I)(ω × Ω)        = Σ 2 u × m U_x    factor of δω
    inward      n ← n + r × f     L ← L + r × P     C ← C + 2 u × P
    turn        ∂/∂q = e·(n × Ω + f × U − g) + δa·P + η·L + δω·C   ∂/∂q̇ = 2 δω·L + e·C
    slide       ∂/∂q = e·(f × Ω) + δa·P                            ∂/∂q̇ = 2 (ω × e)·P

Ω and U are those inboard of the hinge; f, n, P, L, C those of all bodies outboard of it. g = U_tip × F + Ω_tip × m of
the tip wrench, whose direction is constant.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.derivatives.inverse_derivatives import (
    BODY_MOTION,
    HINGE_MOTION,
    MotionWork,
    motion_workspace,
    of_hinge,
    outward,
)
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.lanes import vec_of
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sym3 import sym_apply, sym_of
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale, sub


class LoadGradientWork(NamedTuple):
    """Scratch of `gradient_in_space`."""

    motion: MotionWork
    inboard: Any  # (n, 3) Ω inboard of every hinge
    moved: Any  # (bodies, 6) Ω and U of every body
    sums: Any  # (bodies, 18) f, n, P, L, C, g


@kernel
def load_gradient_workspace(chain):
    """Scratch of `gradient_in_space` for a chain."""
    m = len(chain.bodies)
    return LoadGradientWork(
        motion_workspace(chain), np.empty((len(chain.hinges), 3)), np.empty((m, 6)), np.empty((m, 18))
    )


@recursion
def gradient_in_space(chain, wrench, q, qd, qdd, w, by_angle, by_rate, work):
    """Write ∂(w·τ)/∂q and ∂(w·τ)/∂q̇ (n,), under the tip wrench (6,) in frame 0."""
    force, moment = outward(chain, wrench, False, q, qd, qdd, None, work.motion)
    move(chain, force, moment, w, work)
    add_up(chain, by_angle, by_rate, work)


@recursion
def move(chain, force, moment, w, work):
    """Write Ω, U and the own sums of every body."""
    rows, hinges, moved = work.motion.bodies, work.motion.hinges, work.moved
    for i in range(len(chain.bodies)):
        b, Ω, U = chain.bodies[i], ZERO, ZERO
        if b.parent > 0:
            Ω, U = kept(moved, b.parent - 1, (Ω, U))
        U = add(U, cross(Ω, vec_of(rows, i, BODY_MOTION.r)))
        for k in range(b.first, b.stop):
            keep(work.inboard, k, Ω)
            if chain.rare is not None and chain.hinges[k].axis >= SLIDES:
                U = add_scaled(U, w[k], of_hinge(hinges, k, HINGE_MOTION.e))
            else:
                Ω = add_scaled(Ω, w[k], of_hinge(hinges, k, HINGE_MOTION.e))
        keep(moved, i, (Ω, U))
        mc, ω, I = vec_of(rows, i, BODY_MOTION.mc), vec_of(rows, i, BODY_MOTION.ω), sym_of(rows, i, BODY_MOTION.I)
        f, n, turning = vec_of(rows, i, BODY_MOTION.F), vec_of(rows, i, BODY_MOTION.N), cross(ω, Ω)
        P = add_scaled(cross(Ω, mc), b.mass, U)
        L = add(cross(mc, U), sym_apply(I, Ω))
        C = add_scaled(scale(I[0] + I[1] + I[2], turning), 2.0, sub(cross(cross(ω, mc), U), sym_apply(I, turning)))
        g = ZERO
        if b.loaded:
            f, n, g = sub(f, force), sub(n, moment), add(cross(U, force), cross(Ω, moment))
        keep(work.sums, i, (f, n, P, L, C, g))


@recursion
def add_up(chain, by_angle, by_rate, work):
    """Add up the sums from the tips to the base, and write both derivatives of every hinge."""
    rows, hinges, sums = work.motion.bodies, work.motion.hinges, work.sums
    for i in range(len(chain.bodies) - 1, -1, -1):
        b, (f, n, P, L, C, g) = chain.bodies[i], kept(sums, i, (ZERO, ZERO, ZERO, ZERO, ZERO, ZERO))
        lever = sub(cross(f, vec_of(work.moved, i, 3)), g)
        for k in range(b.first, b.stop):
            e, Ω = of_hinge(hinges, k, HINGE_MOTION.e), vec_of(work.inboard, k, 0)
            by_angle[k] = dot(of_hinge(hinges, k, HINGE_MOTION.δa), P)
            if chain.rare is not None and chain.hinges[k].axis >= SLIDES:
                by_angle[k] += dot(e, cross(f, Ω))
                by_rate[k] = 2.0 * dot(of_hinge(hinges, k, HINGE_MOTION.δv), P)
            else:
                η, δω = of_hinge(hinges, k, HINGE_MOTION.η), of_hinge(hinges, k, HINGE_MOTION.δω)
                by_angle[k] += dot(e, add(cross(n, Ω), lever)) + dot(η, L) + dot(δω, C)
                by_rate[k] = 2.0 * dot(δω, L) + dot(e, C)
        if b.parent > 0:
            r, u = vec_of(rows, i, BODY_MOTION.r), vec_of(rows, i, BODY_MOTION.u)
            n, L, C = add(n, cross(r, f)), add(L, cross(r, P)), add_scaled(C, 2.0, cross(u, P))
            keep(sums, b.parent - 1, added(sums, b.parent - 1, (f, n, P, L, C, g)))
