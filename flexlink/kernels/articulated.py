"""Articulated bodies, O(n) (Featherstone 1983), in inertial axes, hinge groups of any number of axes at one point.

What a body and all beyond it demand at its hinge point, for angular acceleration α and acceleration a of the point:

    n = J α + H a + n₀          f = Hᵀ α + M a + f₀          (J, M symmetric 3×3)

Inward, one hinge axis e with rotor A and torque T after another is taken out, which leaves J e = Hᵀ e = 0 if A = 0:

    D = e·J e + A      q̈ = (T − e·n₀ − e·(J α + H a)) / D      J ← J − J e (J e)ᵀ/D, …

Behind a free group, three axes without rotors, the moment is known from the torques alone, t with e_k·t = τ_k: only M
and f₀ travel inward, and the body's own axes x_j are taken out, which stay perpendicular where hinges line up (gimbal
lock). If what is behind passes no J and H either, with d_j = x_j × r,

    h_j = m x_j × c + M d_j        J_jk = I_jk + d_j·M d_k        M ← M + m 1 − Σ h_j (J⁻¹)_jk h_kᵀ

and nothing is rotated but vectors. One source serves one chain and eight side by side (`lanes`).
"""

from flexlink.kernels.articulated_rows import (
    ALPHA,
    ARMATURE,
    AXES,
    AXIS,
    FACTORS,
    FIRST,
    FREE,
    H_D,
    HE,
    INVERSE,
    JE,
    MASS,
    MC,
    MOMENT,
    MOUNT,
    QUICK,
    REACH,
    STOP,
    T_NET,
    TORQUE,
    TURNED,
    ZETA,
    B,
    F,
    N,
    R,
    axes_of,
    inertia_of,
)
from flexlink.kernels.compiler import inlined, recursion
from flexlink.kernels.joint_torques import smooth_torque, take_off_dry_friction
from flexlink.kernels.lanes import at, put_at, put_vec_of, vec, vec_of, zero_of
from flexlink.kernels.sincos import cos_sin_all
from flexlink.kernels.sym3 import sym_add, sym_add_dyad, sym_apply, sym_from_axes
from flexlink.kernels.vec3 import add, add_scaled, combine, cross, dot, pick, place, scale, sub, turn_axes


@recursion
def articulated(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and tip wrench (6,); see `forward_dynamics`."""
    gravity, layout, axes, given, bodies, hinges, dry, flat, trig = work
    prepare(q, qd, tau, hinges, trig[0])
    take_off_dry_friction(hinges, dry, qd, TORQUE)
    cos_sin_all(flat[0], flat[1], flat[2])
    ω = outward(layout, axes, bodies, hinges, qd, trig[1], trig[2])
    inward(layout, given, bodies, hinges, wrench, qdd)
    accelerate(gravity, layout, given, bodies, hinges, tau, qdd)
    return dot(ω, vec(wrench, 3))


@inlined
def prepare(q, qd, tau, hinges, angles):
    """Angles in their place, and the torques that are left for the motion."""
    for k in range(len(q)):
        put_at(angles, at(q, k), k)
        put_at(hinges, smooth_torque(hinges, k, at(q, k), at(qd, k), at(tau, k)), k, TORQUE)


@inlined
def outward(layout, axes, bodies, hinges, qd, cosines, sines):
    """Axes, and the accelerations and forces that the rates alone ask for; returns the tip's angular velocity."""
    o = zero_of(qd)
    x, y, z = (1.0 + o, o, o), (o, 1.0 + o, o), (o, o, 1.0 + o)
    ω = (o, o, o)
    for i in range(len(layout)):
        if layout[i, TURNED]:
            x, y, z = (
                place(vec_of(bodies, i, MOUNT), x, y, z),
                place(vec_of(bodies, i, MOUNT + 3), x, y, z),
                place(vec_of(bodies, i, MOUNT + 6), x, y, z),
            )
        ζ = (o, o, o)
        for k in range(layout[i, FIRST], layout[i, STOP]):
            axis, rate = axes[k], at(qd, k)
            e = pick(axis, x, y, z)
            put_vec_of(hinges, e, k, AXIS)
            ζ = add_scaled(ζ, rate, cross(ω, e))
            ω = add_scaled(ω, rate, e)
            x, y, z = turn_axes(axis, at(cosines, k), at(sines, k), x, y, z)
        put_vec_of(bodies, x, i, AXES)
        put_vec_of(bodies, y, i, AXES + 3)
        put_vec_of(bodies, z, i, AXES + 6)
        put_vec_of(bodies, ζ, i, ZETA)
        r = place(vec_of(bodies, i, REACH), x, y, z)
        mc = place(vec_of(bodies, i, MOMENT), x, y, z)
        ωω = dot(ω, ω)
        put_vec_of(bodies, r, i, R)
        put_vec_of(bodies, mc, i, MC)
        put_vec_of(bodies, add_scaled(scale(dot(ω, r), ω), -ωω, r), i, B)
        put_vec_of(bodies, add_scaled(scale(dot(ω, mc), ω), -ωω, mc), i, F)
        ω_body = (dot(x, ω), dot(y, ω), dot(z, ω))
        put_vec_of(bodies, cross(ω_body, sym_apply(inertia_of(bodies, i), ω_body)), i, N)
    return ω


@inlined
def inward(layout, given, bodies, hinges, wrench, qdd):
    """What each body and all beyond it demand at its hinge point; J and H are zero behind a free group."""
    o = at(bodies, 0, MASS) * 0.0
    nothing = (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))
    (J, H), M = nothing, (o, o, o, o, o, o)
    f, n = (o - wrench[0], o - wrench[1], o - wrench[2]), (o - wrench[3], o - wrench[4], o - wrench[5])
    for i in range(len(layout) - 1, -1, -1):
        if layout[i, QUICK]:
            J_body, h, n_body, M, f = take_on_quickly(bodies, i, M, n, f)
            M, n, f = take_out_body_axes(bodies, i, hinges, layout[i, FIRST], J_body, h, n_body, M, f)
        else:
            J, H, M, n, f = take_on(bodies, i, J, H, M, n, f)
            if layout[i, FREE]:
                J_body, h, n_body = in_body_axes(bodies, i, J, H, n)
                M, n, f = take_out_body_axes(bodies, i, hinges, layout[i, FIRST], J_body, h, n_body, M, f)
                J, H = nothing
            else:
                for k in range(layout[i, STOP] - 1, layout[i, FIRST] - 1, -1):
                    if given[k]:
                        n, f = take_on_motion(hinges, k, at(qdd, k), J, H, n, f)
                    else:
                        J, H, M, n, f = take_out_hinge(hinges, k, J, H, M, n, f)
                ζ = vec_of(bodies, i, ZETA)
                n = add(n, sym_apply(J, ζ))
                f = add(f, place(ζ, H[0], H[1], H[2]))


@inlined
def take_on_quickly(bodies, i, M, n, f):
    """J and n in body axes, Hᵀ x_j, M and f at the hinge point, body included, where J = H = 0 at the next one."""
    x, y, z = axes_of(bodies, i)
    r, mc, m, I = vec_of(bodies, i, R), vec_of(bodies, i, MC), at(bodies, i, MASS), inertia_of(bodies, i)
    f = add(f, sym_apply(M, vec_of(bodies, i, B)))
    d1, d2, d3 = cross(x, r), cross(y, r), cross(z, r)
    n = add((dot(x, n) + dot(d1, f), dot(y, n) + dot(d2, f), dot(z, n) + dot(d3, f)), vec_of(bodies, i, N))
    M1, M2, M3 = sym_apply(M, d1), sym_apply(M, d2), sym_apply(M, d3)
    J = (
        I[0] + dot(d1, M1), I[1] + dot(d2, M2), I[2] + dot(d3, M3),
        I[3] + dot(d2, M3), I[4] + dot(d1, M3), I[5] + dot(d1, M2),
    )  # fmt: skip
    h = add(cross(x, mc), M1), add(cross(y, mc), M2), add(cross(z, mc), M3)
    M = (M[0] + m, M[1] + m, M[2] + m, M[3], M[4], M[5])
    return J, h, n, M, add(f, vec_of(bodies, i, F))


@inlined
def in_body_axes(bodies, i, J, H, n):
    """J and n in axes of body `i`, and Hᵀ x_j."""
    x, y, z = axes_of(bodies, i)
    Jx, Jy, Jz = sym_apply(J, x), sym_apply(J, y), sym_apply(J, z)
    J = dot(x, Jx), dot(y, Jy), dot(z, Jz), dot(y, Jz), dot(x, Jz), dot(x, Jy)
    return J, (place(x, *H), place(y, *H), place(z, *H)), (dot(x, n), dot(y, n), dot(z, n))


@inlined
def take_out_body_axes(bodies, i, hinges, k, J, h, n, M, f):
    """M, n, f before a free group, whose hinges start at `k`, from J, Hᵀ x_j and n of `in_body_axes`: J = L D Lᵀ."""
    x, y, z = axes_of(bodies, i)
    t = known_moment(hinges, k)
    T1, T2, T3 = dot(x, t) - n[0], dot(y, t) - n[1], dot(z, t) - n[2]
    J11, J22, J33, J23, J13, J12 = J
    h1, h2, h3 = h
    i1 = 1.0 / J11
    l12, l13 = J12 * i1, J13 * i1
    h2, h3 = add_scaled(h2, -l12, h1), add_scaled(h3, -l13, h1)
    T2, T3 = T2 - l12 * T1, T3 - l13 * T1
    J22, J23, J33 = J22 - l12 * J12, J23 - l13 * J12, J33 - l13 * J13
    i2 = 1.0 / J22
    l23 = J23 * i2
    h3, T3 = add_scaled(h3, -l23, h2), T3 - l23 * T2
    i3 = 1.0 / (J33 - l23 * J23)
    α1, α2, α3 = i1 * T1, i2 * T2, i3 * T3
    put_vec_of(bodies, scale(i1, h1), i, H_D)
    put_vec_of(bodies, scale(i2, h2), i, H_D + 3)
    put_vec_of(bodies, scale(i3, h3), i, H_D + 6)
    put_vec_of(bodies, (l12, l13, l23), i, FACTORS)
    put_vec_of(bodies, (α1, α2, α3), i, ALPHA)
    M = sym_add_dyad(sym_add_dyad(sym_add_dyad(M, -i1, h1), -i2, h2), -i3, h3)
    return M, t, add(f, combine(α1, h1, α2, h2, α3, h3))


@inlined
def known_moment(hinges, k):
    """t with e_j·t = τ_j for the three axes from `k`, neighbours perpendicular; keeps e₁*: e₁*·e₁ = 1, others 0."""
    e1, e2, e3 = vec_of(hinges, k, AXIS), vec_of(hinges, k + 1, AXIS), vec_of(hinges, k + 2, AXIS)
    τ1, τ2, τ3 = at(hinges, k, TORQUE), at(hinges, k + 1, TORQUE), at(hinges, k + 2, TORQUE)
    normal = cross(e2, e3)
    dual = scale(1.0 / dot(normal, e1), normal)
    e13 = dot(e1, e3)
    put_vec_of(hinges, dual, k, JE)
    put_at(hinges, e13, k + 2, T_NET)
    return combine(τ1 - e13 * τ3, dual, τ2, e2, τ3, e3)


@inlined
def take_on(bodies, i, J, H, M, n, f):
    """J, H, M, n, f at the body's hinge point, body included, from those at the next hinge point."""
    x, y, z = axes_of(bodies, i)
    r, mc, m, bias = vec_of(bodies, i, R), vec_of(bodies, i, MC), at(bodies, i, MASS), vec_of(bodies, i, B)
    n = add(n, (dot(H[0], bias), dot(H[1], bias), dot(H[2], bias)))
    f = add(f, sym_apply(M, bias))
    n = add(add(n, cross(r, f)), place(vec_of(bodies, i, N), x, y, z))
    f = add(f, vec_of(bodies, i, F))
    o = 0.0 * m
    d1, d2, d3 = (o, -r[2], r[1]), (r[2], o, -r[0]), (-r[1], r[0], o)  # unit vectors × r
    K1, K2, K3 = add(H[0], sym_apply(M, d1)), add(H[1], sym_apply(M, d2)), add(H[2], sym_apply(M, d3))
    J = sym_add(J, sym_from_axes(x, y, z, inertia_of(bodies, i)))
    J = sym_add(J, (
        dot(d1, H[0]) + dot(d1, K1), dot(d2, H[1]) + dot(d2, K2), dot(d3, H[2]) + dot(d3, K3),
        dot(d3, H[1]) + dot(d2, K3), dot(d3, H[0]) + dot(d1, K3), dot(d2, H[0]) + dot(d1, K2),
    ))  # fmt: skip
    H = (
        add(K1, (o, -mc[2], mc[1])), add(K2, (mc[2], o, -mc[0])), add(K3, (-mc[1], mc[0], o)),
    )  # fmt: skip
    M = (M[0] + m, M[1] + m, M[2] + m, M[3], M[4], M[5])
    return J, H, M, n, f


@inlined
def take_out_hinge(hinges, k, J, H, M, n, f):
    """J, H, M, n, f before a hinge from those behind it."""
    e = vec_of(hinges, k, AXIS)
    Je, He = sym_apply(J, e), place(e, H[0], H[1], H[2])
    T, inverse = at(hinges, k, TORQUE) - dot(e, n), 1.0 / (dot(e, Je) + at(hinges, k, ARMATURE))
    put_vec_of(hinges, Je, k, JE)
    put_vec_of(hinges, He, k, HE)
    put_at(hinges, T, k, T_NET)
    put_at(hinges, inverse, k, INVERSE)
    u = scale(inverse, Je)
    J, M = sym_add_dyad(J, -inverse, Je), sym_add_dyad(M, -inverse, He)
    H = (add_scaled(H[0], -u[0], He), add_scaled(H[1], -u[1], He), add_scaled(H[2], -u[2], He))
    n, f = add_scaled(n, T, u), add_scaled(f, T * inverse, He)
    # Along e only the rotor is left. Rounding leaves more, which matters where the rest is small: take it off.
    rotor = at(hinges, k, ARMATURE) * inverse
    ρ = sub(sym_apply(J, e), scale(rotor, Je))
    η = sub(place(e, H[0], H[1], H[2]), scale(rotor, He))
    ρ = add_scaled(ρ, -0.5 * dot(e, ρ), e)
    J = (
        J[0] - 2.0 * e[0] * ρ[0], J[1] - 2.0 * e[1] * ρ[1], J[2] - 2.0 * e[2] * ρ[2],
        J[3] - (e[1] * ρ[2] + e[2] * ρ[1]), J[4] - (e[0] * ρ[2] + e[2] * ρ[0]), J[5] - (e[0] * ρ[1] + e[1] * ρ[0]),
    )  # fmt: skip
    H = (add_scaled(H[0], -e[0], η), add_scaled(H[1], -e[1], η), add_scaled(H[2], -e[2], η))
    ν = at(hinges, k, TORQUE) - rotor * T - dot(e, n)
    return J, H, M, add_scaled(n, ν, e), f


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
def torque_taken(hinges, k, tau, acceleration, α, a):
    """Drive torque of a hinge whose q̈ is given: e·(J α + H a + n) + A q̈, and spring and friction on top."""
    moment = dot(vec_of(hinges, k, JE), α) + dot(vec_of(hinges, k, HE), a) + at(hinges, k, T_NET)
    return moment + at(hinges, k, ARMATURE) * acceleration + (tau - at(hinges, k, TORQUE))


@inlined
def accelerate(gravity, layout, given, bodies, hinges, tau, qdd):
    """Absolute accelerations, and their differences at the hinges; where these are given, the torque they take."""
    o = zero_of(qdd)
    α, a = (o, o, o), scale(-1.0, vec(gravity, 0))
    for i in range(len(layout)):
        before = add(α, vec_of(bodies, i, ZETA))
        if layout[i, FREE]:
            α = free_acceleration(bodies, i, a)
            spread(hinges, layout[i, FIRST], sub(α, before), qdd)
        else:
            α = before
            for k in range(layout[i, FIRST], layout[i, STOP]):
                if not given[k]:
                    demand = dot(vec_of(hinges, k, JE), α) + dot(vec_of(hinges, k, HE), a)
                    put_at(qdd, at(hinges, k, INVERSE) * (at(hinges, k, T_NET) - demand), k)
                α = add_scaled(α, at(qdd, k), vec_of(hinges, k, AXIS))
                if given[k]:
                    put_at(tau, torque_taken(hinges, k, at(tau, k), at(qdd, k), α, a), k)
        a = add(add(a, cross(α, vec_of(bodies, i, R))), vec_of(bodies, i, B))


@inlined
def free_acceleration(bodies, i, a):
    """Angular acceleration of free body `i` from the acceleration of its hinge point: Lᵀ α = D⁻¹ (T − h·a)."""
    α1, α2, α3 = vec_of(bodies, i, ALPHA)
    l12, l13, l23 = vec_of(bodies, i, FACTORS)
    x, y, z = axes_of(bodies, i)
    α3 = α3 - dot(vec_of(bodies, i, H_D + 6), a)
    α2 = α2 - dot(vec_of(bodies, i, H_D + 3), a) - l23 * α3
    α1 = α1 - dot(vec_of(bodies, i, H_D), a) - l12 * α2 - l13 * α3
    return combine(α1, x, α2, y, α3, z)


@inlined
def spread(hinges, k, step, qdd):
    """q̈ of the three axes from `k`, from the step of angular acceleration over the group."""
    first = dot(vec_of(hinges, k, JE), step)
    put_at(qdd, first, k)
    put_at(qdd, dot(vec_of(hinges, k + 1, AXIS), step), k + 1)
    put_at(qdd, dot(vec_of(hinges, k + 2, AXIS), step) - at(hinges, k + 2, T_NET) * first, k + 2)
