"""Articulated bodies in a plane, O(n): all hinge axes parallel, so the hinges see motion normal to them only.

In inertial axes, with the acceleration a of the hinge point as the unknown, what a body and all beyond it demand of
the body before it is  f = M a + f₀ : the moment is the joint torque, known. Only M (2×2) and f₀ travel inward.
d = r turned by 90°, h = m c turned by 90°, φ and α absolute, D = inertia about the hinge point plus rotor A:

    outward     φ ← φ + σ q       ω ← ω + σ q̇
    inward      f₀ ← f₀ − M ω² r             H = h + M d            D = I + d·M d + A        T = σ τ − n − d·f₀
                M ← M + m 1 − H Hᵀ / D       f₀ ← f₀ − ω² m c + H T / D
    outward     α = (T − H·a) / D            σ q̈ = α − α_before    a ← a + α d − ω² r

A rotor's torque A q̈ is not known beforehand; it adds a moment that depends on motion: j α + g·a (zero if A = 0).
"""

import math

import numpy as np

from flexlink.kernels.compiler import inlined, kernel
from flexlink.kernels.joint_torques import elastic, friction
from flexlink.kernels.sincos import cos_sin_all
from flexlink.kernels.sym3 import sym_apply, symmetric
from flexlink.kernels.vec3 import (
    ZERO,
    X,
    Y,
    Z,
    add,
    add_scaled,
    cross,
    dot,
    pick,
    place,
    place_axes,
    put,
    scale,
    unit,
    vector,
)

LINK = np.dtype(
    [
        # fixed: vectors at q = 0
        ("sign", np.float64),  # σ: +1 or −1, axis along or against the plane's normal
        ("armature", np.float64),  # A
        ("mass", np.float64),
        ("inertia", np.float64),  # I about the hinge point, normal component
        ("x", np.float64),  # r: to the next hinge, of the last link to the tip
        ("y", np.float64),
        ("sx", np.float64),  # first moment m c
        ("sy", np.float64),
        # of the present state
        ("centripetal", np.float64),  # ω²
        ("torque", np.float64),  # σ τ, springs and friction taken off
        ("dx", np.float64),  # d
        ("dy", np.float64),
        ("ux", np.float64),  # H / D
        ("uy", np.float64),
        ("α", np.float64),  # T / D
        ("β", np.float64),  # A / D
    ],
    align=True,
)


@kernel
def planar_workspace(bodies, hinges):
    """Scratch of `planar` with the chain's constants: plane (u, v, normal), links, angles and their cos and sin."""
    n = len(hinges)
    plane, links = np.zeros((3, 3)), np.zeros(n, LINK)
    x, y, z = X, Y, Z
    to_body = ZERO  # from the hinge of the present link to the present body's origin
    k = -1
    for i in range(len(bodies)):
        b = bodies[i]
        to_body = add(to_body, place(vector(b.translation), x, y, z))
        x, y, z = place_axes(b.rotation, x, y, z)
        if k >= 0:
            links[k].x, links[k].y = in_plane(plane, to_body)
        for j in range(b.first, b.stop):
            axis = pick(hinges[j].axis, x, y, z)
            if k < 0:
                span_plane(axis, plane)
            k, to_body = j, ZERO
            links[k].sign = np.sign(dot(axis, vector(plane[2])))
            links[k].armature = hinges[k].armature
        if k >= 0:
            cx, cy = in_plane(plane, add(to_body, place(vector(b.center), x, y, z)))
            normal = (dot(x, vector(plane[2])), dot(y, vector(plane[2])), dot(z, vector(plane[2])))
            links[k].mass += b.mass
            links[k].sx += b.mass * cx
            links[k].sy += b.mass * cy
            links[k].inertia += dot(normal, sym_apply(symmetric(b.inertia), normal)) + b.mass * (cx * cx + cy * cy)
    padded = -(-n // 8) * 8  # whole vectors of angles
    return plane, links, np.zeros(padded), np.empty(padded), np.empty(padded)


@kernel
def span_plane(normal, plane):
    """Write the rows u, v, normal, right-handed; u and v are coordinate axes if they can be."""
    least = 0
    for k in range(1, 3):
        if abs(normal[k]) < abs(normal[least]):
            least = k
    u = add_scaled(unit(least), -normal[least], normal)
    u = scale(1.0 / math.sqrt(dot(u, u)), u)
    put(plane[0], u)
    put(plane[1], cross(normal, u))
    put(plane[2], normal)


@inlined
def in_plane(plane, a):
    """Components of a along u and v."""
    return dot(vector(plane[0]), a), dot(vector(plane[1]), a)


@kernel
def planar(chain, wrench, q, qd, tau, qdd, work):
    """Write q̈ (n,) for drive torques `tau` (n,) and tip wrench (6,)."""
    plane, links, angles, cosines, sines = work
    outward(chain, q, qd, tau, links, angles)
    cos_sin_all(angles, cosines, sines)
    inward(plane, wrench, links, cosines, sines)
    accelerate(in_plane(plane, vector(chain.gravity)), links, qdd)


@inlined
def outward(chain, q, qd, tau, links, angles):
    """Absolute angles and rates, and the torques that are left for the motion."""
    φ, ω = 0.0, 0.0
    for k in range(len(q)):
        b, hinge = links[k], chain.hinges[k]
        φ += b.sign * q[k]
        ω += b.sign * qd[k]
        angles[k] = φ
        b.centripetal = ω * ω
        b.torque = b.sign * (tau[k] - elastic(hinge, q[k]) - friction(hinge, qd[k]))


@inlined
def inward(plane, wrench, links, cosines, sines):
    """What each link and all beyond it demand at the link's hinge point: M, f₀ and the moment n."""
    Mxx, Mxy, Myy = 0.0, 0.0, 0.0
    j, gx, gy = 0.0, 0.0, 0.0
    fx, fy = in_plane(plane, (-wrench[0], -wrench[1], -wrench[2]))
    n = -dot(vector(plane[2]), (wrench[3], wrench[4], wrench[5]))
    for k in range(len(links) - 1, -1, -1):
        b = links[k]
        c, s, w, A = cosines[k], sines[k], b.centripetal, b.armature
        dx, dy = -s * b.x - c * b.y, c * b.x - s * b.y
        hx, hy = -s * b.sx - c * b.sy, c * b.sx - s * b.sy
        ax, ay = -w * dy, w * dx
        D = (b.inertia + A + j + 2.0 * (dx * gx + dy * gy)) + dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = hx + gx + Mxx * dx + Mxy * dy, hy + gy + Mxy * dx + Myy * dy
        inverse = 1.0 / D
        n += gx * ax + gy * ay
        fx, fy = fx + (Mxx * ax + Mxy * ay), fy + (Mxy * ax + Myy * ay)
        T = b.torque - n - dx * fx - dy * fy
        Mxx, Mxy, Myy = Mxx + b.mass - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy + b.mass - Hy * Hy * inverse
        ux, uy, α, β = Hx * inverse, Hy * inverse, T * inverse, A * inverse
        j, gx, gy = A * (1.0 - β), β * Hx, β * Hy
        fx, fy, n = fx - w * hy + Hx * α, fy + w * hx + Hy * α, b.torque - A * α
        b.dx, b.dy, b.ux, b.uy, b.α, b.β = dx, dy, ux, uy, α, β


@inlined
def accelerate(gravity, links, qdd):
    """Absolute accelerations, and their differences at the hinges."""
    ax, ay = -gravity[0], -gravity[1]
    α_before = 0.0
    for k in range(len(links)):
        b = links[k]
        α = (b.α + b.β * α_before) - b.ux * ax - b.uy * ay
        qdd[k] = b.sign * (α - α_before)
        ax, ay = ax + α * b.dx - b.centripetal * b.dy, ay + α * b.dy + b.centripetal * b.dx
        α_before = α
