"""Steps of the backward pass (`articulated`): transfer the articulated inertia to a body, then eliminate its hinges.

    group           transferred by                                       eliminated by
    slides          `propagate_inertia`                                  `eliminate_slides`
    hinges          `propagate_inertia`                                  `eliminate_joint`, for each
    along           `propagate_inertia`                                  `eliminate_along`
    pair            `propagate_body` and `add_pair`, or `propagate_any`  `eliminate_pair`
    triple          `propagate_body`, or `propagate_any`                 `eliminate_triple`

The first three groups use J and H in working axes. The others use components along the axes x_j of the body, which stay
perpendicular where hinge axes align: J_jk = x_j·J x_k, h_j = Hᵀ x_j, n_j = x_j·n.

Prismatic hinges are eliminated like revolute ones, but force and moment swap roles (`slides`).
"""

from flexlink.kernels.forward.articulated_branches import over_lever
from flexlink.kernels.forward.articulated_layout import GROUP
from flexlink.kernels.forward.articulated_rows import BODY_ROW, HINGE_ROW, RESTART, THIRD_HINGE, axes_of
from flexlink.kernels.tools.axes3 import combine, rotate
from flexlink.kernels.tools.compiler import inlined
from flexlink.kernels.tools.lanes import at, put_at, put_vec_of, vec_of, zero_of
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.sym3 import sym_add, sym_add_dyad, sym_apply, sym_from_axes, sym_of
from flexlink.kernels.tools.vec3 import add, add_scaled, cross, dot, scale, sub


@inlined
def propagate_inertia(bodies, i, outer, J, H, M, n, f):
    """J, H, M, n, f at the hinge point of body `i`, including its inertia, given them at the hinge point of `outer`."""
    x, y, z = axes_of(bodies, i, BODY_ROW.axes)
    r, mc, m = vec_of(bodies, outer, BODY_ROW.r), vec_of(bodies, i, BODY_ROW.mc), at(bodies, i, BODY_ROW.mass)
    n, f = with_bias(bodies, outer, H, M, n, f)
    n = add(add(n, cross(r, f)), rotate(vec_of(bodies, i, BODY_ROW.n), x, y, z))
    f = add(f, vec_of(bodies, i, BODY_ROW.f))
    o = zero_of(bodies, i, BODY_ROW.mass)
    ΔJ, (K1, K2, K3) = over_lever(o, r, H, M)
    J = sym_add(sym_add(J, sym_from_axes(x, y, z, sym_of(bodies, i, BODY_ROW.inertia))), ΔJ)
    H = add(K1, (o, -mc[2], mc[1])), add(K2, (mc[2], o, -mc[0])), add(K3, (-mc[1], mc[0], o))
    return J, H, (M[0] + m, M[1] + m, M[2] + m, M[3], M[4], M[5]), n, f


@inlined
def with_bias(bodies, i, H, M, n, f):
    """Add to n and f the terms of the acceleration b of hinge point `i` relative to the previous hinge point."""
    bias = vec_of(bodies, i, BODY_ROW.b)
    n = add(n, (dot(H[0], bias), dot(H[1], bias), dot(H[2], bias)))
    return n, add(f, sym_apply(M, bias))


@inlined
def swung(ω, r):
    """ω × (ω × r)."""
    return add_scaled(scale(dot(ω, r), ω), -dot(ω, ω), r)


@inlined
def eliminate_joint(hinges, k, again, J, H, M, n, f):
    """J, H, M, n, f inboard of a hinge, from their values outboard; `again`: the next hinge outward has the same axis.

    In that case, as at the motor of an elastic gear, J e is exactly A / D times the J e of the next hinge outward: the
    contribution of its rotor, or zero. Computed as a difference, J e would contain the rounding error of the arm's
    inertia, which may exceed the rotor's inertia.
    """
    e = vec_of(hinges, k, HINGE_ROW.axis)
    Je, He = sym_apply(J, e), rotate(e, H[0], H[1], H[2])
    if again:
        left = at(hinges, k + 1, HINGE_ROW.armature) * at(hinges, k + 1, HINGE_ROW.inverse)
        Je, He = scale(left, vec_of(hinges, k + 1, HINGE_ROW.Je)), scale(left, vec_of(hinges, k + 1, HINGE_ROW.He))
    T, inverse = at(hinges, k, HINGE_ROW.torque) - dot(e, n), 1.0 / (dot(e, Je) + at(hinges, k, HINGE_ROW.armature))
    keep(hinges, k, (Je, He, T, inverse), HINGE_ROW.Je)  # q̈ is computed from these in the forward pass
    u = scale(inverse, Je)
    J, M = sym_add_dyad(J, -inverse, Je), sym_add_dyad(M, -inverse, He)
    H = (add_scaled(H[0], -u[0], He), add_scaled(H[1], -u[1], He), add_scaled(H[2], -u[2], He))
    n, f = add_scaled(n, T, u), add_scaled(f, T * inverse, He)
    # Along e only the rotor's part remains. Subtract the rounding error, which matters where the other terms are small.
    rotor = at(hinges, k, HINGE_ROW.armature) * inverse
    ρ = sub(sym_apply(J, e), scale(rotor, Je))
    η = sub(rotate(e, H[0], H[1], H[2]), scale(rotor, He))
    ρ = add_scaled(ρ, -0.5 * dot(e, ρ), e)
    J = (
        J[0] - 2.0 * e[0] * ρ[0], J[1] - 2.0 * e[1] * ρ[1], J[2] - 2.0 * e[2] * ρ[2],
        J[3] - (e[1] * ρ[2] + e[2] * ρ[1]), J[4] - (e[0] * ρ[2] + e[2] * ρ[0]), J[5] - (e[0] * ρ[1] + e[1] * ρ[0]),
    )  # fmt: skip
    H = (add_scaled(H[0], -e[0], η), add_scaled(H[1], -e[1], η), add_scaled(H[2], -e[2], η))
    ν = at(hinges, k, HINGE_ROW.torque) - rotor * T - dot(e, n)
    return J, H, M, add_scaled(n, ν, e), f


@inlined
def eliminate_along(hinges, k, J, H, M, n, f):
    """`eliminate_joint` for a hinge along the working axis z; the remainder along z is exact."""
    Je, He, τ, A = (J[4], J[3], J[2]), H[2], at(hinges, k, HINGE_ROW.torque), at(hinges, k, HINGE_ROW.armature)
    T, inverse = τ - n[2], 1.0 / (J[2] + A)
    keep(hinges, k, (Je, He, T, inverse), HINGE_ROW.Je)
    u, v, rotor = inverse * J[4], inverse * J[3], inverse * A
    J = (J[0] - u * J[4], J[1] - v * J[3], rotor * J[2], rotor * J[3], rotor * J[4], J[5] - u * J[3])
    H = add_scaled(H[0], -u, He), add_scaled(H[1], -v, He), scale(rotor, He)
    n = n[0] + T * u, n[1] + T * v, τ - rotor * T
    return J, H, sym_add_dyad(M, -inverse, He), n, add_scaled(f, T * inverse, He)


@inlined
def propagate_prescribed(hinges, k, acceleration, J, H, n, f):
    """Return n, f inboard of a hinge with prescribed q̈; stores J e, Hᵀ e and e·n to compute its torque."""
    e = vec_of(hinges, k, HINGE_ROW.axis)
    Je, He = sym_apply(J, e), rotate(e, H[0], H[1], H[2])
    keep(hinges, k, (Je, He, dot(e, n)), HINGE_ROW.Je)
    return add_scaled(n, acceleration, Je), add_scaled(f, acceleration, He)


@inlined
def missing_torque(hinges, k, acceleration, α, a):
    """Torque of a hinge with given q̈, e·(J α + H a + n) + A q̈, minus the torques of drive, spring and friction."""
    Je, He = vec_of(hinges, k, HINGE_ROW.Je), vec_of(hinges, k, HINGE_ROW.He)
    moment = dot(Je, α) + dot(He, a) + at(hinges, k, HINGE_ROW.T)
    return moment + at(hinges, k, HINGE_ROW.armature) * acceleration - at(hinges, k, HINGE_ROW.torque)


@inlined
def in_axes_before(bodies, i, J, H, M, n, f):
    """Convert J, H, M, n, f to the working axes that apply inboard of body `i`, where the axes restart."""
    x, y, z = axes_of(bodies, i, RESTART.axes_before)
    p, q, r = rotate(H[0], x, y, z), rotate(H[1], x, y, z), rotate(H[2], x, y, z)
    H = combine(x[0], p, y[0], q, z[0], r), combine(x[1], p, y[1], q, z[1], r), combine(x[2], p, y[2], q, z[2], r)
    return sym_from_axes(x, y, z, J), H, sym_from_axes(x, y, z, M), rotate(n, x, y, z), rotate(f, x, y, z)


@inlined
def propagate_body(bodies, i, outer, M, n, f):
    """J, h, n along the axes of body `i`, M, f at its hinge point, with its inertia; J = H = 0 at the next point."""
    x, y, z = axes_of(bodies, i, BODY_ROW.axes)
    r, mc, m = vec_of(bodies, outer, BODY_ROW.r), vec_of(bodies, i, BODY_ROW.mc), at(bodies, i, BODY_ROW.mass)
    I = sym_of(bodies, i, BODY_ROW.inertia)
    f = add(f, sym_apply(M, vec_of(bodies, outer, BODY_ROW.b)))
    d1, d2, d3 = cross(x, r), cross(y, r), cross(z, r)
    n = add((dot(x, n) + dot(d1, f), dot(y, n) + dot(d2, f), dot(z, n) + dot(d3, f)), vec_of(bodies, i, BODY_ROW.n))
    M1, M2, M3 = sym_apply(M, d1), sym_apply(M, d2), sym_apply(M, d3)
    J = (
        I[0] + dot(d1, M1), I[1] + dot(d2, M2), I[2] + dot(d3, M3),
        I[3] + dot(d2, M3), I[4] + dot(d1, M3), I[5] + dot(d1, M2),
    )  # fmt: skip
    h = add(cross(x, mc), M1), add(cross(y, mc), M2), add(cross(z, mc), M3)
    M = M[0] + m, M[1] + m, M[2] + m, M[3], M[4], M[5]
    return J, h, n, M, add(f, vec_of(bodies, i, BODY_ROW.f))


@inlined
def add_pair(bodies, i, outer, j, h, t, J, h_body, n, M, f):
    """Add the terms of J = j t tᵀ and H = t hᵀ at the next hinge point to the result of `propagate_body`."""
    x, y, z = axes_of(bodies, i, BODY_ROW.axes)
    r = vec_of(bodies, outer, BODY_ROW.r)
    s = dot(h, vec_of(bodies, outer, BODY_ROW.b))
    t1, t2, t3 = dot(x, t), dot(y, t), dot(z, t)
    g1, g2, g3 = dot(cross(x, r), h), dot(cross(y, r), h), dot(cross(z, r), h)
    p1, p2, p3 = j * t1 + g1, j * t2 + g2, j * t3 + g3
    J = sym_add(J, (
        t1 * (p1 + g1), t2 * (p2 + g2), t3 * (p3 + g3),
        t2 * p3 + g2 * t3, t1 * p3 + g1 * t3, t1 * p2 + g1 * t2,
    ))  # fmt: skip
    h1, h2, h3 = h_body
    h_body = add_scaled(h1, t1, h), add_scaled(h2, t2, h), add_scaled(h3, t3, h)
    return J, h_body, add_scaled(n, s, (t1, t2, t3)), M, f


@inlined
def propagate_any(bodies, i, outer, J, H, M, n, f):
    """`propagate_body` for any J and H at the next hinge point."""
    x, y, z = axes_of(bodies, i, BODY_ROW.axes)
    J, H, M, n, f = propagate_inertia(bodies, i, outer, J, H, M, n, f)
    Jx, Jy, Jz = sym_apply(J, x), sym_apply(J, y), sym_apply(J, z)
    J = dot(x, Jx), dot(y, Jy), dot(z, Jz), dot(y, Jz), dot(x, Jz), dot(x, Jy)
    return J, (rotate(x, *H), rotate(y, *H), rotate(z, *H)), (dot(x, n), dot(y, n), dot(z, n)), M, f


@inlined
def in_full(o, outer, J, H, j, h, t):
    """Full J and H of the next body outward, by its group: j t tᵀ and t hᵀ for a pair, zero (o) for a triple or tip."""
    if outer > GROUP.pair:
        return (o, o, o, o, o, o), ((o, o, o), (o, o, o), (o, o, o))
    if outer == GROUP.pair:
        u = scale(j, t)
        J = u[0] * t[0], u[1] * t[1], u[2] * t[2], u[1] * t[2], u[0] * t[2], u[0] * t[1]
        return J, (scale(t[0], h), scale(t[1], h), scale(t[2], h))
    return J, H


@inlined
def eliminate_two(bodies, i, J, h, T, M, f):
    """J₃₃, h₃, T₃, M, f after elimination of the axes x₁ and x₂: the first steps of J = L D Lᵀ."""
    J11, J22, J33, J23, J13, J12 = J
    h1, h2, h3 = h
    T1, T2, T3 = T
    i1 = 1.0 / J11
    l12, l13 = J12 * i1, J13 * i1
    h2, h3 = add_scaled(h2, -l12, h1), add_scaled(h3, -l13, h1)
    T2, T3 = T2 - l12 * T1, T3 - l13 * T1
    J22, J23, J33 = J22 - l12 * J12, J23 - l13 * J12, J33 - l13 * J13
    i2 = 1.0 / J22
    l23 = J23 * i2
    h3, T3 = add_scaled(h3, -l23, h2), T3 - l23 * T2
    α1, α2 = i1 * T1, i2 * T2
    keep(bodies, i, (scale(i1, h1), scale(i2, h2)), BODY_ROW.h_D)
    keep(bodies, i, (l12, l13, l23, α1, α2), BODY_ROW.factors)
    keep(bodies, i, (i1, i2), BODY_ROW.inverses)
    M = sym_add_dyad(sym_add_dyad(M, -i1, h1), -i2, h2)
    return J33 - l23 * J23, h3, T3, M, add(f, add_scaled(scale(α1, h1), α2, h2))


@inlined
def eliminate_pair(bodies, i, hinges, k, J, h, n, M, f):
    """j, h, t, M, n, f inboard of a pair of hinges `k`, `k` + 1: x₁ = e₂ and x₂ = e₁ are eliminated, x₃ = t remains."""
    e2, e1, t = axes_of(bodies, i, BODY_ROW.axes)
    τ1, τ2 = at(hinges, k, HINGE_ROW.torque), at(hinges, k + 1, HINGE_ROW.torque)
    j, h, T, M, f = eliminate_two(bodies, i, J, h, (τ2 - n[0], τ1 - n[1], -n[2]), M, f)
    turning = dot(t, vec_of(bodies, i, BODY_ROW.ζ))
    return j, h, t, M, combine(τ1, e1, τ2, e2, j * turning - T, t), add_scaled(f, turning, h)


@inlined
def eliminate_triple(bodies, i, hinges, k, c, J, h, n, M, f):
    """M, n, f inboard of a triple of hinges from `k`; c = e₁·e₂×e₃. The moment follows from the torques alone."""
    x, y, z = axes_of(bodies, i, BODY_ROW.axes)
    t = known_moment(hinges, k, c)
    T = dot(x, t) - n[0], dot(y, t) - n[1], dot(z, t) - n[2]
    D, h, T3, M, f = eliminate_two(bodies, i, J, h, T, M, f)
    inverse = 1.0 / D
    α3 = inverse * T3
    put_vec_of(bodies, scale(inverse, h), i, BODY_ROW.h_D + 6)
    put_at(bodies, α3, i, BODY_ROW.α + 2)
    put_at(bodies, inverse, i, BODY_ROW.inverses + 2)
    return sym_add_dyad(M, -inverse, h), t, add_scaled(f, α3, h)


@inlined
def known_moment(hinges, k, c):
    """Solve e_j·t = τ_j for three axes with e₁·e₂ = e₂·e₃ = 0; store e₁* with e₁*·e₁ = 1 and e₁*·e₂ = e₁*·e₃ = 0.

    The triple product e₁·e₂×e₃ is consistent with the rounded axes; `c`, computed as ± the cosine of the middle angle,
    keeps its relative accuracy near gimbal lock. The two are averaged with weights c² (product) and s² (cosine).
    """
    e1, e2 = vec_of(hinges, k, HINGE_ROW.axis), vec_of(hinges, k + 1, HINGE_ROW.axis)
    e3 = vec_of(hinges, k + 2, HINGE_ROW.axis)
    τ1, τ2 = at(hinges, k, HINGE_ROW.torque), at(hinges, k + 1, HINGE_ROW.torque)
    τ3 = at(hinges, k + 2, HINGE_ROW.torque)
    normal, e13 = cross(e2, e3), dot(e1, e3)
    dual = scale(1.0 / (c * (c * dot(normal, e1) + e13 * e13)), normal)
    put_vec_of(hinges, dual, k, HINGE_ROW.Je)
    put_at(hinges, e13, k + 2, THIRD_HINGE.e13)
    return combine(τ1 - e13 * τ3, dual, τ2, e2, τ3, e3)
