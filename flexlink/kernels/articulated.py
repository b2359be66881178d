"""Articulated bodies, O(n) (Featherstone 1983), in inertial axes, hinge groups of any number of axes at one point.

What a body and all beyond it demand at its hinge point, for angular acceleration α and acceleration a of the point:

    n = J α + H a + n₀          f = Hᵀ α + M a + f₀          (J, M symmetric 3×3)

Inward, one hinge axis e with rotor A and torque T after another is taken out:

    D = e·J e + A      q̈ = (T − e·n₀ − e·(J α + H a)) / D      J ← J − J e (J e)ᵀ/D, …

Behind a group of three axes without rotors the moment is known from the torques alone, t with e_k·t = τ_k: only M and
f₀ travel inward, and the body's own three axes x_j serve as the directions to take out, d_j = x_j × r, so that

    h_j = m x_j × c + M d_j        J_jk = I_jk + d_j·M d_k        M ← M + m 1 − Σ h_j (J⁻¹)_jk h_kᵀ

J is then a 3×3 matrix in body axes and nothing is rotated but vectors.
"""

import numpy as np

from flexlink.kernels.compiler import inlined, kernel
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.sincos import cos_sin_all
from flexlink.kernels.sym3 import (
    ZERO6,
    point_inertia,
    sym_add,
    sym_add_dyad,
    sym_apply,
    sym_from_axes,
    symmetric,
)
from flexlink.kernels.vec3 import (
    ZERO,
    X,
    Y,
    Z,
    add,
    add_scaled,
    combine,
    cross,
    dot,
    pick,
    place,
    place_axes,
    put,
    scale,
    sub,
    turn_axes,
    vector,
)

BODY_STATE = np.dtype(
    [
        # fixed, body axes
        ("free", np.int64),  # 1 if what the body passes inward is a force and a known moment only
        ("quick", np.int64),  # 1 if both the body and the one beyond it are free
        ("first", np.int64),
        ("stop", np.int64),
        ("turned", np.int64),
        ("R", np.float64, (3, 3)),
        ("mass", np.float64),
        ("moment", np.float64, (3,)),  # m c
        ("inertia", np.float64, (6,)),  # about the hinge point
        ("reach", np.float64, (3,)),  # r: to the next hinge point
        # of the present state, frame 0 unless said otherwise
        ("x", np.float64, (3,)),  # body axes
        ("y", np.float64, (3,)),
        ("z", np.float64, (3,)),
        ("r", np.float64, (3,)),
        ("mc", np.float64, (3,)),
        ("b", np.float64, (3,)),  # ω × (ω × r)
        ("ζ", np.float64, (3,)),  # Σ q̇_k ω × e_k
        ("n", np.float64, (3,)),  # ω × I ω, body axes
        ("f", np.float64, (3,)),  # m ω × (ω × c)
        ("h", np.float64, (3, 3)),  # quick: h_j / D_j after elimination
        ("g", np.float64, (3,)),
        ("α", np.float64, (3,)),
    ],
    align=True,
)
HINGE_STATE = np.dtype(
    [
        ("e", np.float64, (3,)),  # axis, frame 0
        ("armature", np.float64),
        ("torque", np.float64),
        ("Je", np.float64, (3,)),
        ("He", np.float64, (3,)),
        ("T", np.float64),
        ("inverse", np.float64),
    ],
    align=True,
)


@kernel
def articulated_workspace(bodies, hinges):
    """Scratch of `articulated` with the chain's constants."""
    state = np.zeros(len(bodies), BODY_STATE)
    for i in range(len(bodies)):
        b, w = bodies[i], state[i]
        w.first, w.stop, w.turned, w.mass = b.first, b.stop, b.turned, b.mass
        w.R[:] = b.rotation
        put(w.moment, scale(b.mass, vector(b.center)))
        inertia = sym_add(symmetric(b.inertia), point_inertia(b.mass, vector(b.center)))
        for j in range(6):
            w.inertia[j] = inertia[j]
        if i > 0:
            put(state[i - 1].reach, vector(b.translation))
        w.free = passes_known_moment(b, hinges, i + 1 == len(bodies))
    for i in range(len(bodies) - 1):
        state[i].quick = state[i].free and state[i + 1].free
    padded = -(-len(hinges) // 8) * 8  # whole vectors of angles
    joints = np.zeros(len(hinges), HINGE_STATE)
    for k in range(len(hinges)):
        joints[k].armature = hinges[k].armature
    return state, joints, np.zeros(padded), np.empty(padded), np.empty(padded)


@kernel
def passes_known_moment(body, hinges, last):
    """Whether the moment that a body passes inward follows from torques alone: three free axes, or no inertia."""
    if last and body.first == body.stop:
        return body.mass == 0.0 and not np.any(body.inertia)
    for k in range(body.first, body.stop):
        if hinges[k].armature != 0.0 or (k > body.first and hinges[k].axis == hinges[k - 1].axis):
            return False
    return body.stop - body.first == 3


@kernel
def articulated(chain, wrench, q, qd, tau, qdd, work):
    """Write q̈ (n,) for drive torques `tau` (n,) and tip wrench (6,)."""
    bodies, hinges, angles, cosines, sines = work
    angles[: len(q)] = q
    cos_sin_all(angles, cosines, sines)
    for k in range(len(q)):
        hinges[k].torque = tau[k] - elastic(chain.hinges[k], q[k]) - friction(chain.hinges[k], qd[k])
    outward(chain, bodies, hinges, qd, cosines, sines)
    inward(bodies, hinges, wrench)
    accelerate(chain.gravity, bodies, hinges, qdd)


@kernel
def outward(chain, bodies, hinges, qd, cosines, sines):
    """Axes, and the accelerations and forces that the rates alone ask for."""
    x, y, z = X, Y, Z
    ω = ZERO
    for i in range(len(bodies)):
        b = bodies[i]
        if b.turned:
            x, y, z = place_axes(b.R, x, y, z)
        ζ = ZERO
        for k in range(b.first, b.stop):
            axis = chain.hinges[k].axis
            e = pick(axis, x, y, z)
            put(hinges[k].e, e)
            ζ = add_scaled(ζ, qd[k], cross(ω, e))
            ω = add_scaled(ω, qd[k], e)
            x, y, z = turn_axes(axis, cosines[k], sines[k], x, y, z)
        put(b.x, x)
        put(b.y, y)
        put(b.z, z)
        put(b.ζ, ζ)
        r = place(vector(b.reach), x, y, z)
        mc = place(vector(b.moment), x, y, z)
        ωω = dot(ω, ω)
        put(b.r, r)
        put(b.mc, mc)
        put(b.b, add_scaled(scale(dot(ω, r), ω), -ωω, r))
        put(b.f, add_scaled(scale(dot(ω, mc), ω), -ωω, mc))
        ω_body = (dot(x, ω), dot(y, ω), dot(z, ω))
        put(b.n, cross(ω_body, sym_apply(b.inertia, ω_body)))


@kernel
def inward(bodies, hinges, wrench):
    """What each body and all beyond it demand at its hinge point; J and H stay zero behind a free body."""
    J, H, M = ZERO6, (ZERO, ZERO, ZERO), ZERO6
    f, n = (-wrench[0], -wrench[1], -wrench[2]), (-wrench[3], -wrench[4], -wrench[5])
    for i in range(len(bodies) - 1, -1, -1):
        b = bodies[i]
        if b.quick:
            M, n, f = take_out_body_axes(b, hinges, M, n, f)
        else:
            J, H, M, n, f = take_on(b, J, H, M, n, f)
            for k in range(b.stop - 1, b.first - 1, -1):
                J, H, M, n, f = take_out_hinge(hinges[k], J, H, M, n, f)
            if b.free:
                J, H = ZERO6, (ZERO, ZERO, ZERO)
            else:
                ζ = vector(b.ζ)
                n = add(n, sym_apply(J, ζ))
                f = add(f, place(ζ, H[0], H[1], H[2]))


@kernel
def take_out_body_axes(b, hinges, M, n, f):
    """M, n, f before a free body from those behind it."""
    x, y, z, r, mc = vector(b.x), vector(b.y), vector(b.z), vector(b.r), vector(b.mc)
    I = b.inertia
    f = add(f, sym_apply(M, vector(b.b)))
    t = known_moment(hinges[b.first], hinges[b.first + 1], hinges[b.first + 2])
    rest = sub(t, n)
    d1, d2, d3 = cross(x, r), cross(y, r), cross(z, r)
    T1 = dot(x, rest) - b.n[0] - dot(d1, f)
    T2 = dot(y, rest) - b.n[1] - dot(d2, f)
    T3 = dot(z, rest) - b.n[2] - dot(d3, f)
    M1, M2, M3 = sym_apply(M, d1), sym_apply(M, d2), sym_apply(M, d3)
    J11, J22, J33 = I[0] + dot(d1, M1), I[1] + dot(d2, M2), I[2] + dot(d3, M3)
    J23, J13, J12 = I[3] + dot(d2, M3), I[4] + dot(d1, M3), I[5] + dot(d1, M2)
    h1, h2, h3 = add(cross(x, mc), M1), add(cross(y, mc), M2), add(cross(z, mc), M3)
    M = (M[0] + b.mass, M[1] + b.mass, M[2] + b.mass, M[3], M[4], M[5])
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
    put(b.h[0], scale(i1, h1))
    put(b.h[1], scale(i2, h2))
    put(b.h[2], scale(i3, h3))
    put(b.g, (l12, l13, l23))
    put(b.α, (α1, α2, α3))
    M = sym_add_dyad(sym_add_dyad(sym_add_dyad(M, -i1, h1), -i2, h2), -i3, h3)
    f = add(add(f, vector(b.f)), combine(α1, h1, α2, h2, α3, h3))
    return M, t, f


@inlined
def known_moment(first, second, third):
    """t with e_k·t = τ_k; neighbouring axes are perpendicular. Keeps e₁*, e₁*·e₁ = 1, normal to the others."""
    e1, e2, e3 = vector(first.e), vector(second.e), vector(third.e)
    normal = cross(e2, e3)
    dual = scale(1.0 / dot(normal, e1), normal)
    put(first.Je, dual)
    third.T = dot(e1, e3)
    return combine(first.torque - third.T * third.torque, dual, second.torque, e2, third.torque, e3)


@kernel
def take_on(b, J, H, M, n, f):
    """J, H, M, n, f at the body's hinge point, body included, from those at the next hinge point."""
    x, y, z, r, mc = vector(b.x), vector(b.y), vector(b.z), vector(b.r), vector(b.mc)
    bias = vector(b.b)
    n = add(n, (dot(H[0], bias), dot(H[1], bias), dot(H[2], bias)))
    f = add(f, sym_apply(M, bias))
    n = add(add(n, cross(r, f)), place(vector(b.n), x, y, z))
    f = add(f, vector(b.f))
    d1, d2, d3 = (0.0, -r[2], r[1]), (r[2], 0.0, -r[0]), (-r[1], r[0], 0.0)  # unit vectors × r
    K1, K2, K3 = add(H[0], sym_apply(M, d1)), add(H[1], sym_apply(M, d2)), add(H[2], sym_apply(M, d3))
    J = sym_add(J, sym_from_axes(x, y, z, b.inertia))
    J = sym_add(J, (
        dot(d1, H[0]) + dot(d1, K1), dot(d2, H[1]) + dot(d2, K2), dot(d3, H[2]) + dot(d3, K3),
        dot(d3, H[1]) + dot(d2, K3), dot(d3, H[0]) + dot(d1, K3), dot(d2, H[0]) + dot(d1, K2),
    ))  # fmt: skip
    H = (
        add(K1, (0.0, -mc[2], mc[1])), add(K2, (mc[2], 0.0, -mc[0])), add(K3, (-mc[1], mc[0], 0.0)),
    )  # fmt: skip
    M = (M[0] + b.mass, M[1] + b.mass, M[2] + b.mass, M[3], M[4], M[5])
    return J, H, M, n, f


@kernel
def take_out_hinge(hinge, J, H, M, n, f):
    """J, H, M, n, f before a hinge from those behind it."""
    e = vector(hinge.e)
    Je, He = sym_apply(J, e), place(e, H[0], H[1], H[2])
    T = hinge.torque - dot(e, n)
    inverse = 1.0 / (dot(e, Je) + hinge.armature)
    put(hinge.Je, Je)
    put(hinge.He, He)
    hinge.T, hinge.inverse = T, inverse
    u = scale(inverse, Je)
    J, M = sym_add_dyad(J, -inverse, Je), sym_add_dyad(M, -inverse, He)
    H = (add_scaled(H[0], -u[0], He), add_scaled(H[1], -u[1], He), add_scaled(H[2], -u[2], He))
    return J, H, M, add_scaled(n, T, u), add_scaled(f, T * inverse, He)


@kernel
def accelerate(gravity, bodies, hinges, qdd):
    """Absolute accelerations, and their differences at the hinges."""
    α, a = ZERO, scale(-1.0, vector(gravity))
    for i in range(len(bodies)):
        b = bodies[i]
        k = b.first
        before = add(α, vector(b.ζ))
        if b.quick:
            α3 = b.α[2] - dot(b.h[2], a)
            α2 = b.α[1] - dot(b.h[1], a) - b.g[2] * α3
            α1 = b.α[0] - dot(b.h[0], a) - b.g[0] * α2 - b.g[1] * α3
            α = combine(α1, vector(b.x), α2, vector(b.y), α3, vector(b.z))
            step = sub(α, before)
            qdd[k] = dot(hinges[k].Je, step)
            qdd[k + 1] = dot(hinges[k + 1].e, step)
            qdd[k + 2] = dot(hinges[k + 2].e, step) - hinges[k + 2].T * qdd[k]
        else:
            α = before
            for k in range(b.first, b.stop):
                hinge = hinges[k]
                qdd[k] = hinge.inverse * (hinge.T - dot(hinge.Je, α) - dot(hinge.He, a))
                α = add_scaled(α, qdd[k], vector(hinge.e))
        a = add(add(a, cross(α, vector(b.r))), vector(b.b))
