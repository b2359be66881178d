"""Derivatives of inverse dynamics with respect to all angles, rates and accelerations, O(n²) (Carpentier & Mansard
2018; Singh, Russell & Wensing 2022), in axes of frame 0 and with moments about the hinge points.

A rotation of hinge j carries all outboard bodies along. In the frame of these bodies, the motion inboard of hinge j
rotates the opposite way. So do the vectors fixed in frame 0: gravity and the tip wrench w = (F, m). Let ω, α and a (the
acceleration of the hinge point p_j less gravity) be the motion inboard of hinge j. The acceleration of a material point
x outboard of it then changes by

    δa(x) = δa_j + η_j × (x − p_j) + 2 δω_j × (v_x − v_j)

    along q_j       δa_j = a × e_j      δω_j = ω × e_j      η_j = α × e_j + ω × δω_j      δF = F × e_j      δm = m × e_j
    along q̇_j       δa_j = 0            δω_j = e_j          η_j = 2 ω × e_j
    along q̈_j       δa_j = 0            δω_j = 0            η_j = e_j

A prismatic hinge translates the outboard bodies and the wrench without a rotation:

    along q_j       δa = α × e_j + ω × (ω × e_j)        along q̇_j       δa = 2 ω × e_j        along q̈_j       δa = e_j

The change of the load on all bodies outboard of hinge i, about p_i, follows from sums over these bodies, their
composite. With u = v_x − v_i, ρ = x − p_i and δa at p_i,

    m       s = Σ m ρ       I = Σ m (ρ·ρ 1 − ρ ρᵀ)       P = Σ m u       G = Σ m u ρᵀ
    δf_i = m δa + η × s + 2 δω × P                δn_i = s × δa + I η + 2 (tr G δω − G δω)

The derivatives of the torques outboard of the joint that moves, j ≤ i, and inboard of it, are

    ∂τ_i/∂q_j = e_i·(δn_i − δm_j − d_i × δF_j)        d_i = p_tip − p_i
    ∂τ_j/∂q_i = e_j·(n* + (p_i − p_j) × f*)           f* = δf_i − δF_i + e_i × f_i
                                                      n* = δn_i − δm_i − d_i × δF_i + e_i × n_i

with f_i, n_i the force and moment that hinge i transmits. A change of a rate rotates nothing: f* and n* then lack their
last terms. A follower wrench rotates with the arm: δF = δm = 0. The torque of a prismatic hinge is e·f in place of e·n,
and its displacement changes the lever arm of its load: f* = δf_i, n* = δn_i + e_i × f_i. Eight joints j are computed
side by side (`lanes`) as if all were revolute; the results of the few that slide are then overwritten.

A joint moves only the bodies outboard of it, so derivatives between joints on different branches are 0.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.geometry.branches import fork_rows
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.axes3 import X, Y, Z, cos_sin, pick, place_axes, rotate, turn_axes
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion, subroutine
from flexlink.kernels.tools.finite import are_finite
from flexlink.kernels.tools.lanes import LANES, at, put_at, put_eight, vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import added, keep, kept
from flexlink.kernels.tools.sym3 import (
    ZERO6,
    point_inertia,
    product_inertia,
    sym_add,
    sym_apply,
    sym_from_axes,
    sym_of,
    symmetric,
)
from flexlink.kernels.tools.vec3 import ZERO, add, add_scaled, cross, dot, scale, sub, vector

HINGE_MOTION = numbered("e:3 p:3 v:3 δa:3 η:3 δω:3 δF:3 δm:3 δv:3")
"""Columns of a hinge: axis e, point p, its velocity v, and the changes above; if prismatic, only δa and δv = ω × e."""
BODY_MOTION = numbered("r:3 u:3 mc:3 ω:3 F:3 N:3 I:6 p:3 v:3")
"""Columns of a body: r from the parent body and u = dr/dt, m c, ω, the force F and moment N of its motion, its inertia
I about the hinge point, and position p and velocity v of this point."""
COMPOSITE = numbered("m s:3 I:6 P:3 G:9 f:3 n:3 d:3 loaded")
"""Columns of a branch: its composite, f, n, the vector d to the loaded tip, and 1 if the wrench acts on it."""


class MotionWork(NamedTuple):
    """Results of `outward`, in frame 0."""

    hinges: Any  # (⌈n/8⌉, HINGE, 8)
    bodies: Any  # (bodies, BODY)
    slides: Any  # indices of the prismatic hinges; None for a plain chain
    forks: Any  # (rows, COMPOSITE) state in `outward`, composites in `inward`; None for a plain chain


class InverseDerivativesWork(NamedTuple):
    """Scratch of `inverse_derivatives`; ∂τ_i/∂x_j, j ≤ i, is at index [j // 8, i, j % 8]."""

    by_angle: Any  # (⌈n/8⌉, n, 8)
    by_rate: Any
    by_acceleration: Any  # M
    by_angle_inner: Any  # ∂τ_j/∂x_i, j < i
    by_rate_inner: Any
    motion: MotionWork


@allocating
def motion_workspace(chain):
    """Scratch of `outward` for a chain."""
    blocks = -(-len(chain.hinges) // LANES)
    return MotionWork(
        np.zeros((blocks, HINGE_MOTION.size, LANES)), np.empty((len(chain.bodies), BODY_MOTION.size)),
        sliding_hinges(chain), fork_rows(chain, COMPOSITE.size),
    )  # fmt: skip


@allocating
def sliding_hinges(chain):
    """Indices of the prismatic hinges, ascending; None for a plain chain."""
    return None if chain.rare is None else np.flatnonzero(chain.hinges["axis"] >= SLIDES)


@kernel
def derivatives_workspace(chain):
    """Scratch of `inverse_derivatives` for a chain."""
    n = len(chain.hinges)
    slopes = np.empty((5, -(-n // LANES), n, LANES))
    return InverseDerivativesWork(slopes[0], slopes[1], slopes[2], slopes[3], slopes[4], motion_workspace(chain))


@kernel
def load_slopes(chain, wrench, follower, q, qd, qdd, found):
    """Write the derivatives to `found` (3, n, n); the wrench (6,) is in frame 0, or in the tip frame if `follower`."""
    return slopes_under(
        chain, wrench, follower, q, qd, qdd, (found[0], found[1], found[2]), derivatives_workspace(chain)
    )


@subroutine
def inverse_derivatives(chain, wrench, q, qd, qdd, found, work):
    """Write the three derivatives to the arrays `found`, (n, n) each; return whether all are finite."""
    return slopes_under(chain, wrench, False, q, qd, qdd, found, work)


@recursion
def slopes_under(chain, wrench, follower, q, qd, qdd, found, work):
    """Write the three derivatives under a fixed or follower wrench; return whether all values are finite."""
    force, moment = outward(chain, wrench, follower, q, qd, qdd, None, work.motion)
    inward(chain, force, moment, work)
    keep_slopes(work.by_angle, work.by_angle_inner, found[0])
    keep_slopes(work.by_rate, work.by_rate_inner, found[1])
    keep_slopes(work.by_acceleration, work.by_acceleration, found[2])
    if work.motion.forks is not None and len(work.motion.forks) > 0:
        for variable in range(3):
            part_branches(chain.bodies, found[variable])
    return are_finite(found)


@recursion
def keep_slopes(outer, inner, found):
    """Copy ∂τ_i/∂x_j, j ≤ i, from `outer` and ∂τ_j/∂x_i, j < i, from `inner` to the matrix `found` (n, n)."""
    for block in range(len(outer) - 1, -1, -1):
        keep_columns(outer[block], block * LANES, found)
    for i in range(len(found)):
        for j in range(i):
            found[j, i] = inner[j // LANES, i, j % LANES]


@recursion
def part_branches(bodies, slopes):
    """Set the derivatives between joints on different branches to 0."""
    for i in range(len(bodies)):
        number = i + 1
        while number > 0:
            before = bodies[number - 1].parent
            stop = bodies[before - 1].stop if before > 0 else 0
            for j in range(stop, bodies[number - 1].first):
                for k in range(bodies[i].first, bodies[i].stop):
                    slopes[k, j] = slopes[j, k] = 0.0
            number = before


@recursion
def keep_columns(x, first, found):
    """Copy the block x (n, 8) to the columns of `found` from `first` on; the last block must be copied first.

    Eight numbers of a row are stored at once. Numbers past the last column are overwritten by the next row or block.
    """
    n, elements = len(x), found.reshape(-1)
    for k in range(n):
        offset = k * n + first
        if offset + LANES <= n * n:
            put_eight(elements, at(x, k), offset)
        else:
            for lane in range(min(LANES, n - first)):
                elements[offset + lane] = x[k, lane]


@recursion
def outward(chain, wrench, follower, q, qd, qdd, solved, work):
    """Write the motion of bodies and hinges to `work`; return force and moment of the wrench in frame 0.

    `solved` contains α and a of the bodies (bodies, 6) if forward dynamics has found them, otherwise it is None. A sum
    of q̈ would lose digits where the q̈ of light segments nearly cancel, as in the α of a heavy outboard body.
    """
    rows = work.bodies
    force, moment = vector(wrench), (wrench[3], wrench[4], wrench[5])
    dead = 0.0 if follower else 1.0
    x, y, z = X, Y, Z
    p = v = ω = α = ZERO
    a = scale(-1.0, vector(chain.gravity))
    f_tip, n_tip = force, moment
    if work.forks is not None and len(work.forks) > 0:
        keep(work.forks, 0, (x, y, z, p, v, ω, α, a))
    for i in range(len(chain.bodies)):
        b = chain.bodies[i]
        if chain.rare is not None and b.begins:
            x, y, z, p, v, ω, α, a = kept(work.forks, b.slot, (x, y, z, p, v, ω, α, a))
        r = rotate(vector(b.translation), x, y, z)
        u = cross(ω, r)
        p, v, a = add(p, r), add(v, u), add(a, add(cross(α, r), cross(ω, u)))
        if b.turned:
            x, y, z = place_axes(b.rotation, x, y, z)
        if chain.rare is not None and b.first < b.stop and chain.hinges[b.first].axis >= SLIDES:
            slid, w = sum_along(chain.hinges, b, q, x, y, z), sum_along(chain.hinges, b, qd, x, y, z)
            t = add(cross(ω, slid), w)
            r, u, p, v = add(r, slid), add(u, t), add(p, slid), add(v, t)
            a = add(add(a, sum_along(chain.hinges, b, qdd, x, y, z)), add(cross(α, slid), cross(ω, add(t, w))))
        if solved is not None:
            a = vec_of(solved, i, 3)
        for k in range(b.first, b.stop):
            axis = chain.hinges[k].axis
            if chain.rare is not None and axis >= SLIDES:
                put_slide(work.hinges, k, pick(axis - SLIDES, x, y, z), p, v, ω, α)
                continue
            e = pick(axis, x, y, z)
            δω = cross(ω, e)
            δa, η = cross(a, e), add(cross(α, e), cross(ω, δω))
            δF, δm = scale(dead, cross(force, e)), scale(dead, cross(moment, e))
            keep(work.hinges[k // LANES].T, k % LANES, (e, p, v, δa, η, δω, δF, δm))  # `HINGE_MOTION`
            ω, α = add_scaled(ω, qd[k], e), add_scaled(add_scaled(α, qdd[k], e), qd[k], δω)
            c, s = cos_sin(q[k])
            x, y, z = turn_axes(axis, c, s, x, y, z)
        if solved is not None:
            α = vec_of(solved, i, 0)
        center = rotate(vector(b.center), x, y, z)
        mc = scale(b.mass, center)
        I = sym_add(sym_from_axes(x, y, z, symmetric(b.inertia)), point_inertia(b.mass, center))
        F = add(scale(b.mass, a), add(cross(α, mc), cross(ω, cross(ω, mc))))
        N = add(cross(mc, a), add(sym_apply(I, α), cross(ω, sym_apply(I, ω))))
        keep(rows, i, (r, u, mc, ω, F, N, I, p, v))  # `BODY_MOTION`
        if chain.rare is not None and b.fork > 0:
            keep(work.forks, b.fork, (x, y, z, p, v, ω, α, a))
        if b.loaded and follower:
            f_tip, n_tip = rotate(force, x, y, z), rotate(moment, x, y, z)
    return f_tip, n_tip


@recursion
def sum_along(hinges, body, q, x, y, z):
    """Σ e q over the hinges of a body with prismatic hinges."""
    total = ZERO
    for k in range(body.first, body.stop):
        total = add_scaled(total, q[k], pick(hinges[k].axis - SLIDES, x, y, z))
    return total


@recursion
def put_slide(rows, k, e, p, v, ω, α):
    """Write the columns of prismatic hinge k."""
    δv = cross(ω, e)
    δa = add(cross(α, e), cross(ω, δv))
    keep(rows[k // LANES].T, k % LANES, (e, p, v, δa, ZERO, ZERO, ZERO, ZERO, δv))  # `HINGE_MOTION`


@inlined
def of_hinge(rows, k, first):
    """Return the 3-vector of hinge `k` in the columns from `first` on."""
    block, lane = k // LANES, k % LANES
    return rows[block, first, lane], rows[block, first + 1, lane], rows[block, first + 2, lane]


@inlined
def spin(G, a):
    """2 (tr G a − G a); G is a tuple of its columns."""
    trace = G[0][0] + G[1][1] + G[2][2]
    return scale(2.0, sub(scale(trace, a), rotate(a, G[0], G[1], G[2])))


@inlined
def spin_transposed(G, a):
    """2 (tr G a − Gᵀ a); G is a tuple of its columns."""
    trace = G[0][0] + G[1][1] + G[2][2]
    return scale(2.0, sub(scale(trace, a), (dot(G[0], a), dot(G[1], a), dot(G[2], a))))


@inlined
def add_dyad(G, a, b):
    """G + a bᵀ, both as tuples of columns."""
    return add_scaled(G[0], b[0], a), add_scaled(G[1], b[1], a), add_scaled(G[2], b[2], a)


@inlined
def own_spin(ω, I):
    """Columns of G = Σ m (ω × ρ) ρᵀ = ω̃ (½ tr(I) 1 − I) of one body."""
    half = 0.5 * (I[0] + I[1] + I[2])
    return (
        cross(ω, (half - I[0], -I[5], -I[4])), cross(ω, (-I[5], half - I[1], -I[3])),
        cross(ω, (-I[4], -I[3], half - I[2])),
    )  # fmt: skip


@recursion
def inward(chain, force, moment, work):
    """Backward pass: add up the composite from the tips to the base, and write the derivatives at each hinge."""
    rows, forks = work.motion.bodies, work.motion.forks
    if work.motion.forks is not None:
        forks[:] = 0.0
    m, s, I, P, G = 0.0, ZERO, ZERO6, ZERO, (ZERO, ZERO, ZERO)
    f = n = d = ZERO
    loaded = 0.0
    for i in range(len(chain.bodies) - 1, -1, -1):
        b, mc, ω = chain.bodies[i], vec_of(rows, i, BODY_MOTION.mc), vec_of(rows, i, BODY_MOTION.ω)
        r = vec_of(rows, i, BODY_MOTION.r)
        if chain.rare is not None and b.fork > 0:
            m, s, I, P, G, f, n, d, loaded = added(forks, b.fork, (m, s, I, P, G, f, n, d, loaded))
        if b.loaded:
            f, n, d, loaded = scale(-1.0, force), scale(-1.0, moment), ZERO, 1.0
        own = sym_of(rows, i, BODY_MOTION.I)
        turned = own_spin(ω, own)
        m, s, I, P = m + b.mass, add(s, mc), sym_add(I, own), add(P, cross(ω, mc))
        G = add(G[0], turned[0]), add(G[1], turned[1]), add(G[2], turned[2])
        f, n = add(f, vec_of(rows, i, BODY_MOTION.F)), add(n, vec_of(rows, i, BODY_MOTION.N))
        for k in range(b.stop - 1, b.first - 1, -1):
            if chain.rare is not None and loaded == 0.0:
                keep(work.motion.hinges[k // LANES].T, k % LANES, (ZERO, ZERO), HINGE_MOTION.δF)  # no wrench outboard
            if chain.rare is not None and chain.hinges[k].axis >= SLIDES:
                derivatives_of_slide(k, m, s, P, f, loaded, work)
            else:
                derivatives_of_turn(k, m, s, I, P, G, f, n, d, loaded, work)
            work.by_acceleration[k // LANES, k, k % LANES] += chain.hinges[k].armature
        if b.parent > 0:
            u = vec_of(rows, i, BODY_MOTION.u)
            t = add_scaled(s, m, r)
            G, P = add_dyad(add_dyad(G, P, r), u, t), add_scaled(P, m, u)
            I, s = sym_add(I, sym_add(product_inertia(s, r), point_inertia(m, r))), t
            n, d = add(n, cross(r, f)), add_scaled(d, loaded, r)
        if chain.rare is not None and b.begins:
            keep(forks, b.slot, added(forks, b.slot, (m, s, I, P, G, f, n, d, loaded)))
            m, s, I, P, G, loaded = 0.0, ZERO, ZERO6, ZERO, (ZERO, ZERO, ZERO), 0.0
            f = n = d = ZERO


@recursion
def derivatives_of_turn(i, m, s, I, P, G, f, n, d, loaded, work):
    """Write the derivatives at revolute hinge i, from the composite of all bodies outboard of it."""
    hinges = work.motion.hinges
    e, δa = of_hinge(hinges, i, HINGE_MOTION.e), of_hinge(hinges, i, HINGE_MOTION.δa)
    η, δω = of_hinge(hinges, i, HINGE_MOTION.η), of_hinge(hinges, i, HINGE_MOTION.δω)
    δF, δm = of_hinge(hinges, i, HINGE_MOTION.δF), of_hinge(hinges, i, HINGE_MOTION.δm)
    # coefficients of δa, η, δω, δF, δm in e·δn
    by_a, by_η, by_ω, by_F = cross(e, s), sym_apply(I, e), spin_transposed(G, e), cross(e, d)
    by_m = e if loaded > 0.0 else ZERO
    f_q = sub(add(add(scale(m, δa), cross(η, s)), add(scale(2.0, cross(δω, P)), cross(e, f))), δF)
    n_q = add(add(cross(s, δa), sym_apply(I, η)), add(spin(G, δω), cross(e, n)))
    n_q = sub(n_q, add(δm, cross(d, δF)))
    f_qd = scale(2.0, add(cross(δω, s), cross(e, P)))
    n_qd = add(scale(2.0, sym_apply(I, δω)), spin(G, e))
    put_row(i, by_a, by_η, by_ω, by_F, by_m, f_q, n_q, f_qd, n_qd, work)


@subroutine
def derivatives_of_slide(i, m, s, P, f, loaded, work):
    """Write the derivatives at prismatic hinge i, from the composite of all bodies outboard of it."""
    hinges = work.motion.hinges
    e, δa = of_hinge(hinges, i, HINGE_MOTION.e), of_hinge(hinges, i, HINGE_MOTION.δa)
    by_a, by_η, by_ω, by_F = scale(m, e), cross(s, e), scale(2.0, cross(P, e)), scale(loaded, e)
    f_q, n_q = scale(m, δa), add(cross(s, δa), cross(e, f))
    δa_qd = scale(2.0, of_hinge(hinges, i, HINGE_MOTION.δv))
    put_row(i, by_a, by_η, by_ω, by_F, ZERO, f_q, n_q, scale(m, δa_qd), cross(s, δa_qd), work)


@inlined
def put_row(i, by_a, by_η, by_ω, by_F, by_m, f_q, n_q, f_qd, n_qd, work):
    """Write the derivatives between joint i and all joints j ≤ i, eight at a time, as if all j were revolute.

    `by_*` are the coefficients of δa, η, δω, δF, δm in the torque of joint i. `f_*` and `n_*` are its f* and n*.
    """
    hinges = work.motion.hinges
    p, v = of_hinge(hinges, i, HINGE_MOTION.p), of_hinge(hinges, i, HINGE_MOTION.v)
    for b in range(i // LANES + 1):
        e_j, δω_j = vec_of(hinges, b, HINGE_MOTION.e), vec_of(hinges, b, HINGE_MOTION.δω)
        Δp, Δv = sub(p, vec_of(hinges, b, HINGE_MOTION.p)), sub(v, vec_of(hinges, b, HINGE_MOTION.v))
        by_η_j, by_ω_j = add(by_η, cross(Δp, by_a)), add(by_ω, scale(2.0, cross(Δv, by_a)))
        δa_j, η_j = vec_of(hinges, b, HINGE_MOTION.δa), vec_of(hinges, b, HINGE_MOTION.η)
        outer = dot(by_a, δa_j) + dot(by_η_j, η_j) + dot(by_ω_j, δω_j)
        outer -= dot(by_m, vec_of(hinges, b, HINGE_MOTION.δm)) + dot(by_F, vec_of(hinges, b, HINGE_MOTION.δF))
        lever = cross(e_j, Δp)
        put_at(work.by_angle, outer, b, i)
        put_at(work.by_angle_inner, dot(e_j, n_q) + dot(lever, f_q), b, i)
        put_at(work.by_rate, 2.0 * dot(by_η_j, δω_j) + dot(by_ω_j, e_j), b, i)
        put_at(work.by_rate_inner, dot(e_j, n_qd) + dot(lever, f_qd), b, i)
        put_at(work.by_acceleration, dot(by_η_j, e_j), b, i)
    if work.motion.slides is not None and len(work.motion.slides) > 0:
        put_slides(i, by_a, f_q, f_qd, work)


@subroutine
def put_slides(i, by_a, f_q, f_qd, work):
    """Overwrite the derivatives between joint i and the prismatic joints j ≤ i."""
    hinges, slides = work.motion.hinges, work.motion.slides
    for number in range(len(slides)):
        j = slides[number]
        if j <= i:
            b, lane = j // LANES, j % LANES
            e_j, δv_j = of_hinge(hinges, j, HINGE_MOTION.e), of_hinge(hinges, j, HINGE_MOTION.δv)
            work.by_angle_inner[b, i, lane], work.by_rate_inner[b, i, lane] = dot(e_j, f_q), dot(e_j, f_qd)
            work.by_rate[b, i, lane], work.by_acceleration[b, i, lane] = 2.0 * dot(by_a, δv_j), dot(by_a, e_j)
