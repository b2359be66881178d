"""Recursive Newton-Euler in body frames (Luh, Walker & Paul 1980; Featherstone 2008, chapter 5).

    forward     ω ← Rᵀω + e q̇        α ← Rᵀα + e q̈ + Rᵀω × e q̇        a ← Rᵀ(a + α × r + ω × (ω × r))
    body        F = m (a + α × c + ω × (ω × c))        N = I α + ω × I ω + c × F
    backward    f ← f + F        n ← n + N        τ = e·n + armature q̈        n ← R n + r × R f

Gravity is an upward acceleration −g of the base; the tip wrench is carried outward to the tip frame.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.tools.compiler import kernel, subroutine
from flexlink.kernels.tools.vec3 import (
    ZERO,
    add,
    add_along,
    apply,
    apply_transposed,
    cos_sin,
    cross,
    cross_unit,
    dot,
    scale,
    turn,
    vector,
)


class RneWork(NamedTuple):
    """Scratch of `rne`."""

    turns: Any  # cosine and sine of every hinge
    loads: Any  # force and moment of every body


@kernel
def rne_workspace(chain):
    """Scratch of `rne` for a chain."""
    return RneWork(np.empty((len(chain.hinges), 2)), np.empty((len(chain.bodies), 2, 3)))


@kernel
def inverse_dynamics(chain, wrench, q, qd, qdd):
    """τ = M q̈ + T_GC in a new array (n,), under the chain's gravity."""
    tau = np.empty(len(q))
    rne(chain, vector(chain.gravity), wrench, q, qd, qdd, tau, rne_workspace(chain))
    return tau


@subroutine
def rne(chain, gravity, wrench, q, qd, qdd, tau, work):
    """Inverse dynamics τ = M q̈ + T_GC, written to `tau` (n,); `gravity` tuple and `wrench` (6,) in frame 0.

    Returns the power m·ω of the moment on the tip [W].
    """
    bodies, hinges = chain.bodies, chain.hinges
    turns, loads = work

    ω = α = ZERO
    a = scale(-1.0, gravity)
    f_tip, n_tip = vector(wrench), (wrench[3], wrench[4], wrench[5])
    for i in range(len(bodies)):
        b = bodies[i]
        r = vector(b.translation)
        a = add(a, add(cross(α, r), cross(ω, cross(ω, r))))
        if b.turned:
            ω = apply_transposed(b.rotation, ω)
            α = apply_transposed(b.rotation, α)
            a = apply_transposed(b.rotation, a)
            f_tip = apply_transposed(b.rotation, f_tip)
            n_tip = apply_transposed(b.rotation, n_tip)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            c, s = cos_sin(q[k])
            turns[k, 0], turns[k, 1] = c, s
            ω = turn(axis, c, -s, ω)
            α = add_along(axis, qdd[k], add(turn(axis, c, -s, α), scale(qd[k], cross_unit(ω, axis))))
            ω = add_along(axis, qd[k], ω)
            a = turn(axis, c, -s, a)
            f_tip = turn(axis, c, -s, f_tip)
            n_tip = turn(axis, c, -s, n_tip)
        c = vector(b.center)
        F = scale(b.mass, add(a, add(cross(α, c), cross(ω, cross(ω, c)))))
        N = add(add(apply(b.inertia, α), cross(ω, apply(b.inertia, ω))), cross(c, F))
        loads[i, 0, 0], loads[i, 0, 1], loads[i, 0, 2] = F
        loads[i, 1, 0], loads[i, 1, 1], loads[i, 1, 2] = N

    power = dot(n_tip, ω)
    f, n = scale(-1.0, f_tip), scale(-1.0, n_tip)
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        f = add(f, vector(loads[i, 0]))
        n = add(n, vector(loads[i, 1]))
        for k in range(b.stop - 1, b.first - 1, -1):
            axis = hinges[k].axis
            c, s = turns[k, 0], turns[k, 1]
            tau[k] = n[axis] + hinges[k].armature * qdd[k]
            f = turn(axis, c, s, f)
            n = turn(axis, c, s, n)
        if b.turned:
            f = apply(b.rotation, f)
            n = apply(b.rotation, n)
        n = add(n, cross(vector(b.translation), f))
    return power
