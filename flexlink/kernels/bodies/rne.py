"""Recursive Newton-Euler in body frames (Luh, Walker & Paul 1980; Featherstone 2008, chapter 5).

    forward     ω ← Rᵀω + e q̇        α ← Rᵀα + e q̈ + Rᵀω × e q̇        a ← Rᵀ(a + α × r + ω × (ω × r))
    body        F = m (a + α × c + ω × (ω × c))        N = I α + ω × I ω + c × F
    backward    f ← f + F        n ← n + N        τ = e·n + armature q̈        n ← R n + r × R f

R and r are the rotation and translation from the previous frame to this one, e is the hinge axis, a the acceleration of
the frame origin, c the centre of mass and I the inertia about c. In the forward pass, a prismatic joint adds to a
α × e q + ω × (ω × e q) + 2 ω × e q̇ + e q̈; in the backward pass, it gives τ = e·f + armature q̈ and n ← n + e q × f.
Gravity enters as an acceleration −g of the base. The forward pass rotates the tip wrench into the tip frame. The
same code works for one state and for eight states side by side (`lanes`).
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.branches import fork_lanes, fork_rows
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.address import records
from flexlink.kernels.tools.axes3 import add_along, cross_unit, turn
from flexlink.kernels.tools.compiler import inlined, kernel, subroutine
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.lanes import (
    LANES,
    Turns,
    at,
    cos_sin_of,
    empty_lanes,
    keep_lanes,
    position_of,
    put_at,
    put_lanes,
    vec,
    zero_of,
)
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import add, apply, apply_transposed, cross, dot, scale, sub, vector


class RneWork(NamedTuple):
    """Scratch of `rne`."""

    turns: Any  # (n, 2) cosine and sine of every revolute hinge; displacement of a prismatic one
    loads: Any  # (bodies, 6) force and moment of every body
    forks: Any  # (rows, 15) ω, α, a and the tip wrench where branches begin; None for a plain chain


@kernel
def rne_workspace(chain):
    """Scratch of `rne` for a chain."""
    return RneWork(np.empty((len(chain.hinges), 2)), np.empty((len(chain.bodies), 6)), fork_rows(chain, 15))


def inverse_dynamics(address, wrench, q, qd, qdd, tau):
    """Write τ = M q̈ + T_GC; return whether the state has n finite values each and τ is finite."""
    chain, work = records(address)
    n = len(tau)
    if not (len(q) == n and len(qd) == n and len(qdd) == n):
        return False
    rne(chain, vector(chain.gravity), wrench, q, qd, qdd, tau, work)
    return is_finite(q) and is_finite(qd) and is_finite(qdd) and is_finite(tau)


@kernel
def inverse_dynamics_of_many(chain, wrench, q, qd, qdd):
    """Return τ (b, n) of many states (b, n) with tip wrenches (b, 6), eight states side by side."""
    b, n = q.shape
    tau, state, acting, trig = np.empty((b, n)), empty_lanes((4, n)), empty_lanes((6,)), empty_lanes((2, n))
    angles, flat, turns = state[0].reshape(-1), trig.reshape(2, n * LANES), Turns(trig[0], trig[1], state[0])
    work = RneWork(empty_lanes((n, 2)), empty_lanes((len(chain.bodies), 6)), fork_lanes(chain, 15))
    for start in range(0, b, LANES):
        put_lanes(wrench, start, acting)
        put_lanes(q, start, state[0])
        put_lanes(qd, start, state[1])
        put_lanes(qdd, start, state[2])
        cos_sin_all(angles, flat[0], flat[1])
        rne(chain, vector(chain.gravity), acting, turns, state[1], state[2], state[3], work)
        keep_lanes(state[3], start, tau)
    return tau


@subroutine
def rne(chain, gravity, wrench, q, qd, qdd, tau, work):
    """Write τ = M q̈ + T_GC to `tau` (n,); return the power m·ω [W]. `gravity`, a tuple, and `wrench` are in frame 0.

    For eight states side by side, `q` are their `Turns`, and the other state arrays have shape (…, 8).
    """
    bodies, hinges = chain.bodies, chain.hinges
    turns, loads, forks = work

    o = zero_of(qd)
    ω = α = (o, o, o)
    a = scale(-1.0 + o, gravity)
    f_tip, n_tip = vec(wrench, 0), vec(wrench, 3)
    if work.forks is not None and rarely(len(forks) > 0):
        keep(forks, 0, (ω, α, a, f_tip, n_tip))
    power = o
    for i in range(len(bodies)):
        b = bodies[i]
        if chain.rare is not None and rarely(b.begins):
            ω, α, a, f_tip, n_tip = kept(forks, b.slot, (ω, α, a, f_tip, n_tip))
        r = vector(b.translation)
        a = add(a, add(cross(α, r), cross(ω, cross(ω, r))))
        if b.turned:
            ω, α = apply_transposed(b.rotation, ω), apply_transposed(b.rotation, α)
            a = apply_transposed(b.rotation, a)
            f_tip, n_tip = apply_transposed(b.rotation, f_tip), apply_transposed(b.rotation, n_tip)
        for k in range(b.first, b.stop):
            axis = hinges[k].axis
            if chain.rare is not None and rarely(axis >= SLIDES):
                a = slide(axis - SLIDES, position_of(q, k), at(qd, k), at(qdd, k), ω, α, a)
                put_at(turns, position_of(q, k) + o, k, 0)
                continue
            c, s = cos_sin_of(q, k)
            keep(turns, k, (c, s))
            ω = turn(axis, c, -s, ω)
            α = add_along(axis, at(qdd, k), add(turn(axis, c, -s, α), scale(at(qd, k), cross_unit(ω, axis, o))))
            ω = add_along(axis, at(qd, k), ω)
            a = turn(axis, c, -s, a)
            f_tip, n_tip = turn(axis, c, -s, f_tip), turn(axis, c, -s, n_tip)
        c = vector(b.center)
        F = scale(b.mass, add(a, add(cross(α, c), cross(ω, cross(ω, c)))))
        N = add(add(apply(b.inertia, α), cross(ω, apply(b.inertia, ω))), cross(c, F))
        if b.loaded:
            F, N, power = sub(F, f_tip), sub(N, n_tip), dot(n_tip, ω)
        if chain.rare is not None and rarely(b.fork > 0):
            keep(forks, b.fork, (ω, α, a, f_tip, n_tip))
        keep(loads, i, (F, N))

    f = n = (o, o, o)
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        f, n = added(loads, i, (f, n))
        for k in range(b.stop - 1, b.first - 1, -1):
            axis = hinges[k].axis
            if chain.rare is not None and rarely(axis >= SLIDES):
                put_at(tau, f[axis - SLIDES] + hinges[k].armature * at(qdd, k), k)
                n = sub(n, scale(at(turns, k, 0), cross_unit(f, axis - SLIDES, o)))
                continue
            c, s = at(turns, k, 0), at(turns, k, 1)
            put_at(tau, n[axis] + hinges[k].armature * at(qdd, k), k)
            f, n = turn(axis, c, s, f), turn(axis, c, s, n)
        if b.turned:
            f, n = apply(b.rotation, f), apply(b.rotation, n)
        n = add(n, cross(vector(b.translation), f))
        if chain.rare is not None and rarely(b.begins):
            if b.parent > 0:
                keep(loads, b.parent - 1, added(loads, b.parent - 1, (f, n)))
            f = n = (o, o, o)
    return power


@inlined
def slide(axis, q, qd, qdd, ω, α, a):
    """Acceleration of the point after a prismatic hinge, from the acceleration a of the point before it."""
    o = 0.0 * q
    ωe = cross_unit(ω, axis, o)
    return add_along(axis, qdd, add(a, add(scale(q, add(cross_unit(α, axis, o), cross(ω, ωe))), scale(2.0 * qd, ωe))))
