"""Articulated bodies, O(n) (Featherstone 1983), in working axes, hinge groups of any number of axes at one point.

What a body and all beyond it demand at its hinge point, for angular acceleration α and acceleration a of the point:

    n = J α + H a + n₀          f = Hᵀ α + M a + f₀          (J, M symmetric 3×3)

Inward, one hinge axis e with rotor A and torque T after another is taken out, which leaves J e = Hᵀ e = 0 if A = 0:

    D = e·J e + A      q̈ = (T − e·n₀ − e·(J α + H a)) / D      J ← J − J e (J e)ᵀ/D, …

Behind a triple, three axes without rotors, the moment is known from the torques alone, t with e_k·t = τ_k: only M and
f₀ travel inward, and the body's own axes x_j are taken out, which stay perpendicular where hinges line up (gimbal
lock). If what is behind passes no J and H either, with d_j = x_j × r,

    h_j = m x_j × c + M d_j        J_jk = I_jk + d_j·M d_k        M ← M + m 1 − Σ h_j (J⁻¹)_jk h_kᵀ

and nothing is rotated but vectors. Behind a pair, e₁ and e₂, two moments are known; x₁ = e₂, x₂ = e₁ are taken out in
the same way, and x₃ = t, normal to both, is left: J = j t tᵀ, H = t hᵀ, which adds to the next body inward

    h_j += t_j h        J_jk += j t_j t_k + t_j g_k + g_j t_k        t_j = x_j·t        g_j = h·d_j

`articulated_layout` says which way the hinges of a body are taken out, and where working axes begin that make a single
hinge's axis z; all vectors are in the working axes of their body. One source serves one chain and eight side by side
(`lanes`).
"""

from flexlink.kernels.bodies.joint_torques import smooth_torques, take_off_dry_friction
from flexlink.kernels.forward.articulated_groups import (
    in_axes_before,
    in_full,
    take_on,
    take_on_any,
    take_on_body,
    take_on_pair,
    take_out_along,
    take_out_hinge,
    take_out_pair,
    take_out_triple,
)
from flexlink.kernels.forward.articulated_layout import ALONG, ANEW, FIRST, PAIR, STOP, TIP, TRIPLE, TURNED, WAY
from flexlink.kernels.forward.articulated_rows import (
    ALPHA,
    ARMATURE,
    AXES,
    AXIS,
    BEFORE,
    BEGINS,
    FACTORS,
    H_D,
    HE,
    INERTIA,
    INVERSE,
    JE,
    MC,
    MOMENT,
    MOUNT,
    OWN_INERTIA,
    REACH,
    SENSE,
    T_NET,
    TORQUE,
    ZETA,
    B,
    F,
    N,
    R,
    axes_of,
    inertia_of,
    put_axes_of,
)
from flexlink.kernels.tools.compiler import inlined, recursion
from flexlink.kernels.tools.lanes import at, put_at, put_vec_of, vec, vec_of, zero_of
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.sym3 import sym_apply, sym_turn
from flexlink.kernels.tools.vec3 import add, add_along, add_scaled, cross, dot, pick, place, scale, sub, turn_axes


@recursion
def articulated(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and tip wrench (6,); see `forward_dynamics`."""
    layout, given, bodies, hinges, trig = work.layout, work.given, work.bodies, work.hinges, work.trig
    power = prepare(q, qd, tau, hinges, trig[0])
    lost = take_off_dry_friction(hinges, work.dry, qd, TORQUE)
    cos_sin_all(work.flat[0], work.flat[1], work.flat[2])
    f, n, turning = outward(layout, work.axes, bodies, hinges, wrench, qd, trig[1], trig[2])
    inward(layout, work.axes, given, bodies, hinges, n, f, qdd, trig[1])
    return turning + accelerate(work.gravity, layout, given, bodies, hinges, qd, tau, qdd, power) - lost


@inlined
def prepare(q, qd, tau, hinges, angles):
    """Angles in their place, torques that are left for the motion; returns the power of drive and viscous friction."""
    power = zero_of(q)
    for k in range(len(q)):
        put_at(angles, at(q, k), k)
        working, torque = smooth_torques(hinges, k, at(q, k), at(qd, k), at(tau, k))
        put_at(hinges, torque, k, TORQUE)
        power += working * at(qd, k)
    return power


@inlined
def outward(layout, axes, bodies, hinges, wrench, qd, cosines, sines):
    """Axes, and what the rates alone ask for; returns −wrench in the last working axes, and its moment's power m·ω."""
    o = zero_of(qd)
    zero = (o, o, o)
    f, n = sub(zero, vec(wrench, 0)), sub(zero, vec(wrench, 3))
    x, y, z = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o)
    ω = (o, o, o)
    for i in range(len(layout)):
        if layout[i, TURNED]:
            u, v, w = axes_of(bodies, i, MOUNT)
            x, y, z = place(u, x, y, z), place(v, x, y, z), place(w, x, y, z)
        if layout[i, ANEW]:
            x, y, z = begin_axes(bodies, i, x, y, z)
            u, v, w = axes_of(bodies, i, BEFORE)
            ω, f, n = components(ω, u, v, w), components(f, u, v, w), components(n, u, v, w)
        ζ = (o, o, o)
        for k in range(layout[i, FIRST], layout[i, STOP]):
            axis, rate = axes[k], at(qd, k)
            e = pick(axis, x, y, z)
            put_vec_of(hinges, e, k, AXIS)
            ζ = add_scaled(ζ, rate, cross(ω, e))
            ω = add_scaled(ω, rate, e)
            x, y, z = turn_axes(axis, at(cosines, k), at(sines, k), x, y, z)
        put_vec_of(bodies, ζ, i, ZETA)
        put_body(bodies, i, ω, x, y, z)
        if layout[i, WAY] == PAIR:
            u, v, w = pair_axes(bodies, i, hinges, layout[i, FIRST], axes, cosines, sines)
            put_axes(bodies, i, ω, u, v, w)
        else:
            put_axes(bodies, i, ω, x, y, z)
    return f, n, -dot(n, ω)


@inlined
def put_body(bodies, i, ω, x, y, z):
    """Keep r and m c of body `i` with axes x, y, z, and what its rate ω asks for."""
    r, mc, ωω = place(vec_of(bodies, i, REACH), x, y, z), place(vec_of(bodies, i, MOMENT), x, y, z), dot(ω, ω)
    put_vec_of(bodies, r, i, R)
    put_vec_of(bodies, mc, i, MC)
    put_vec_of(bodies, add_scaled(scale(dot(ω, r), ω), -ωω, r), i, B)
    put_vec_of(bodies, add_scaled(scale(dot(ω, mc), ω), -ωω, mc), i, F)


@inlined
def put_axes(bodies, i, ω, x, y, z):
    """Keep the axes along which body `i` is taken on, and ω × I ω along them."""
    put_axes_of(bodies, x, y, z, i, AXES)
    ω = components(ω, x, y, z)
    put_vec_of(bodies, cross(ω, sym_apply(inertia_of(bodies, i, INERTIA), ω)), i, N)


@inlined
def components(a, x, y, z):
    """Components of a along x, y, z."""
    return dot(x, a), dot(y, a), dot(z, a)


@inlined
def begin_axes(bodies, i, x, y, z):
    """Axes of body `i` before its hinge, in those that begin here: unit vectors; keeps x, y, z, which they are.

    Of chains side by side where they do not begin in all, the others go on in their axes: kept are unit vectors.
    """
    μ = at(bodies, i, BEGINS)
    ν = 1.0 - μ
    u, v, w = mixed(μ, x, y, z, ν)
    put_axes_of(bodies, u, v, w, i, BEFORE)
    return mixed(ν, x, y, z, μ)


@inlined
def mixed(μ, x, y, z, ν):
    """μ x, μ y, μ z plus ν times the unit vectors."""
    return add_along(0, ν, scale(μ, x)), add_along(1, ν, scale(μ, y)), add_along(2, ν, scale(μ, z))


@inlined
def pair_axes(bodies, i, hinges, k, axes, cosines, sines):
    """e₂, e₁, e₂ × e₁ of a pair of hinges Y, Z or Z, Y; turns the body's inertia into them."""
    e1, e2 = vec_of(hinges, k, AXIS), vec_of(hinges, k + 1, AXIS)
    c, s, I = at(cosines, k + 1), at(sines, k + 1), inertia_of(bodies, i, OWN_INERTIA)
    if axes[k + 1] == 2:
        xx, yy, zz, yz, xz, xy = sym_turn(2, c, s, I)
        first, second = (zz, yy, xx), (-xy, -xz, yz)
    else:
        xx, yy, zz, yz, xz, xy = sym_turn(1, c, s, I)
        first, second = (yy, zz, xx), (xz, xy, yz)
    put_vec_of(bodies, first, i, INERTIA)
    put_vec_of(bodies, second, i, INERTIA + 3)
    return e2, e1, cross(e2, e1)


@inlined
def inward(layout, axes, given, bodies, hinges, n, f, qdd, cosines):
    """What each body and all beyond it demand at its hinge point, from the n and f that the tip demands."""
    o = zero_of(qdd)
    zero = (o, o, o)
    J, H, M = (o, o, o, o, o, o), (zero, zero, zero), (o, o, o, o, o, o)
    j, h, t = o, zero, zero  # J = j t tᵀ and H = t hᵀ of a pair behind
    behind = TIP
    for i in range(len(layout) - 1, -1, -1):
        way, k = layout[i, WAY], layout[i, FIRST]
        if way == TRIPLE:
            c = at(cosines, k + 1) * at(hinges, k + 2, SENSE)
            if behind > PAIR:
                M, n, f = take_out_triple(bodies, i, hinges, k, c, *take_on_body(bodies, i, M, n, f))
            else:
                J, H = in_full(o, behind, J, H, j, h, t)
                M, n, f = take_out_triple(bodies, i, hinges, k, c, *take_on_any(bodies, i, J, H, M, n, f))
        elif way == PAIR:
            if behind > PAIR:  # nothing is passed
                j, h = o, zero
            if behind >= PAIR:
                body = take_on_pair(bodies, i, j, h, t, *take_on_body(bodies, i, M, n, f))
                j, h, t, M, n, f = take_out_pair(bodies, i, hinges, k, *body)
            else:
                j, h, t, M, n, f = take_out_pair(bodies, i, hinges, k, *take_on_any(bodies, i, J, H, M, n, f))
        elif way != TIP:
            J, H = in_full(o, behind, J, H, j, h, t)
            J, H, M, n, f = through_hinges(layout, i, axes, given, bodies, hinges, qdd, J, H, M, n, f)
        behind = way


@inlined
def through_hinges(layout, i, axes, given, bodies, hinges, qdd, J, H, M, n, f):
    """J, H, M, n, f before body `i`, whose hinges go one after another; where q̈ is given, it adds to n and f."""
    J, H, M, n, f = take_on(bodies, i, J, H, M, n, f)
    if layout[i, WAY] == ALONG:
        J, H, M, n, f = take_out_along(hinges, layout[i, FIRST], J, H, M, n, f)
    else:
        for k in range(layout[i, STOP] - 1, layout[i, FIRST] - 1, -1):
            if given[k]:
                n, f = take_on_motion(hinges, k, at(qdd, k), J, H, n, f)
            else:
                again = k + 1 < layout[i, STOP] and axes[k] == axes[k + 1] and not given[k + 1]
                J, H, M, n, f = take_out_hinge(hinges, k, again, J, H, M, n, f)
    ζ = vec_of(bodies, i, ZETA)
    n, f = add(n, sym_apply(J, ζ)), add(f, place(ζ, H[0], H[1], H[2]))
    if layout[i, ANEW]:
        J, H, M, n, f = in_axes_before(bodies, i, J, H, M, n, f)
    return J, H, M, n, f


@inlined
def take_on_motion(hinges, k, acceleration, J, H, n, f):
    """n, f before a hinge whose q̈ is given; keeps J e, Hᵀ e and e·n for the torque that it takes."""
    e = vec_of(hinges, k, AXIS)
    Je, He = sym_apply(J, e), place(e, H[0], H[1], H[2])
    put_vec_of(hinges, Je, k, JE)
    put_vec_of(hinges, He, k, HE)
    put_at(hinges, dot(e, n), k, T_NET)
    return add_scaled(n, acceleration, Je), add_scaled(f, acceleration, He)


@inlined
def torque_lacking(hinges, k, acceleration, α, a):
    """What a hinge whose q̈ is given takes, e·(J α + H a + n) + A q̈, beyond what drive, spring and friction give it."""
    moment = dot(vec_of(hinges, k, JE), α) + dot(vec_of(hinges, k, HE), a) + at(hinges, k, T_NET)
    return moment + at(hinges, k, ARMATURE) * acceleration - at(hinges, k, TORQUE)


@inlined
def accelerate(gravity, layout, given, bodies, hinges, qd, tau, qdd, power):
    """Absolute accelerations, and their differences at the hinges; where these are given, the torque they take.

    Returns the power with that of these torques. The rows of the bodies keep α for ζ and a, with −g, for b.
    """
    o = zero_of(qdd)
    α, a = (o, o, o), scale(-1.0, vec(gravity, 0))
    for i in range(len(layout)):
        way, first = layout[i, WAY], layout[i, FIRST]
        if layout[i, ANEW]:
            u, v, w = axes_of(bodies, i, BEFORE)
            α, a = components(α, u, v, w), components(a, u, v, w)
        before = add(α, vec_of(bodies, i, ZETA))
        x, y, z = axes_of(bodies, i, AXES)
        if way == TRIPLE:
            α1, α2, α3 = along_group(bodies, i, at(bodies, i, ALPHA + 2) - dot(vec_of(bodies, i, H_D + 6), a), a)
            α = place((α1, α2, α3), x, y, z)
            spread(hinges, first, sub(α, before), qdd)
        elif way == PAIR:
            α1, α2, α3 = along_group(bodies, i, dot(z, before), a)
            α = place((α1, α2, α3), x, y, z)
            put_at(qdd, α2 - dot(y, before), first)
            put_at(qdd, α1 - dot(x, before), first + 1)
        else:
            α = before
            for k in range(first, layout[i, STOP]):
                if not given[k]:
                    demand = dot(vec_of(hinges, k, JE), α) + dot(vec_of(hinges, k, HE), a)
                    put_at(qdd, at(hinges, k, INVERSE) * (at(hinges, k, T_NET) - demand), k)
                α = add_scaled(α, at(qdd, k), vec_of(hinges, k, AXIS))
                if given[k]:
                    more = torque_lacking(hinges, k, at(qdd, k), α, a)
                    put_at(tau, at(tau, k) + more, k)
                    power += at(qd, k) * more
        b = vec_of(bodies, i, B)
        put_vec_of(bodies, α, i, ZETA)
        put_vec_of(bodies, a, i, B)
        a = add(add(a, cross(α, vec_of(bodies, i, R))), b)
    return power


@inlined
def along_group(bodies, i, α3, a):
    """α along the axes of body `i` from its part α₃ and the acceleration of the hinge point: Lᵀ α = D⁻¹ (T − h·a)."""
    l12, l13, l23 = vec_of(bodies, i, FACTORS)
    α2 = at(bodies, i, ALPHA + 1) - dot(vec_of(bodies, i, H_D + 3), a) - l23 * α3
    α1 = at(bodies, i, ALPHA) - dot(vec_of(bodies, i, H_D), a) - l12 * α2 - l13 * α3
    return α1, α2, α3


@inlined
def spread(hinges, k, step, qdd):
    """q̈ of the triple from `k`, from the step of angular acceleration over it."""
    first = dot(vec_of(hinges, k, JE), step)
    put_at(qdd, first, k)
    put_at(qdd, dot(vec_of(hinges, k + 1, AXIS), step), k + 1)
    put_at(qdd, dot(vec_of(hinges, k + 2, AXIS), step) - at(hinges, k + 2, T_NET) * first, k + 2)
