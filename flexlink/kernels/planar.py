"""Articulated bodies in a plane, O(n): all hinge axes parallel, so the hinges see motion normal to them only.

In inertial axes, with the acceleration a of the hinge point as the unknown, what a body and all beyond it demand of
the body before it is  f = M a + f₀ : the moment is the joint torque, known. Only M (2×2) and f₀ travel inward.
d = r turned by 90°, h = m c turned by 90°, φ and α absolute, D = inertia about the hinge point plus rotor A; where φ is
large, it is the sum of angles less whole turns, so that they keep all digits:

    outward     φ ← φ + σ q       ω ← ω + σ q̇
    inward      f₀ ← f₀ − M ω² r             H = h + M d            D = I + d·M d + A        T = σ τ − n − d·f₀
                M ← M + m 1 − H Hᵀ / D       f₀ ← f₀ − ω² m c + H T / D
    outward     α = (T − H·a) / D            σ q̈ = α − α_before    a ← a + α d − ω² r

A rotor's torque A q̈ is not known beforehand; it adds a moment that depends on motion, j α + g·a (zero if A = 0), with
j = A (1 − A/D), and 1 − A/D as (D − A)/D, of which a large rotor takes no digits. One source serves one chain and eight
side by side (`lanes`).
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.compiler import inlined, kernel, recursion
from flexlink.kernels.joint_torques import (
    COULOMB,
    JOINT,
    dry_joints,
    given_joints,
    put_joint,
    smooth_torques,
    take_off_dry_friction,
)
from flexlink.kernels.lanes import LANES, at, put_at, vec, zero_of
from flexlink.kernels.sincos import cos_sin_all, less_whole_turns
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

# Numbers of a link, after those of its joint. Fixed: σ, rotor A, mass, I about the hinge point, r to the next hinge (of
# the last link to the tip) and m c at q = 0. Of the state: ω², τ, d, H / D, T / D, A / D, 1 − A / D.
SIGN, ARMATURE, MASS, INERTIA, RX, RY, SX, SY, RATE2, TORQUE, DX, DY, UX, UY, ALPHA, BETA, GAMMA = range(
    JOINT, JOINT + 17
)
SIZE = JOINT + 17
# Numbers of the base: plane u, v, normal (right-handed) and gravity, in frame 0.
U, V, NORMAL, GRAVITY = 0, 3, 6, 9


class PlanarWork(NamedTuple):
    """Scratch of `planar`, with the constants of a chain, or of eight."""

    base: Any
    links: Any
    given: Any
    dry: Any
    flat: Any  # angles, cosines and sines, for the loop over all of them
    trig: Any  # the same memory, for the links


@kernel
def planar_workspace(bodies, hinges, gravity):
    """Scratch of `planar` with the chain's constants."""
    n = len(hinges)
    base, links = np.zeros(12), np.zeros((n, SIZE))
    put(base[GRAVITY:], vector(gravity))
    x, y, z = X, Y, Z
    to_body = ZERO  # from the hinge of the present link to the present body's origin
    k = -1
    for i in range(len(bodies)):
        b = bodies[i]
        to_body = add(to_body, place(vector(b.translation), x, y, z))
        x, y, z = place_axes(b.rotation, x, y, z)
        if k >= 0:
            links[k, RX], links[k, RY] = in_plane(base, to_body)
        for j in range(b.first, b.stop):
            axis = pick(hinges[j].axis, x, y, z)
            if k < 0:
                span_plane(axis, base)
            k, to_body = j, ZERO
            links[k, SIGN] = np.sign(dot(axis, vec(base, NORMAL)))
            put_joint(links, k, hinges[k])
            links[k, ARMATURE] = hinges[k].armature
        if k >= 0:
            cx, cy = in_plane(base, add(to_body, place(vector(b.center), x, y, z)))
            normal = (dot(x, vec(base, NORMAL)), dot(y, vec(base, NORMAL)), dot(z, vec(base, NORMAL)))
            links[k, MASS] += b.mass
            links[k, SX] += b.mass * cx
            links[k, SY] += b.mass * cy
            links[k, INERTIA] += dot(normal, sym_apply(symmetric(b.inertia), normal)) + b.mass * (cx * cx + cy * cy)
    trig = np.zeros((3, -(-n // LANES) * LANES))  # angles, cosines, sines; whole vectors of angles
    return PlanarWork(base, links, given_joints(hinges), dry_joints(links[:, COULOMB]), trig, trig)


@kernel
def planar_lanes_workspace(bodies, hinges, gravity):
    """The same for eight chains side by side, arrays of shape (8, bodies), (8, n), (8, 3)."""
    n = hinges.shape[1]
    base, links, coulomb = np.empty((12, LANES)), np.empty((n, SIZE, LANES)), np.zeros(n)
    trig = np.empty((3, n * LANES))
    for lane in range(LANES):
        one = planar_workspace(bodies[lane], hinges[lane], gravity[lane])
        for j in range(12):
            base[j, lane] = one.base[j]
        for k in range(n):
            coulomb[k] += hinges[lane, k].coulomb
            for j in range(SIZE):
                links[k, j, lane] = one.links[k, j]
    trig_lanes = trig.reshape(3, n, LANES)
    return PlanarWork(base, links, given_joints(hinges[0]), dry_joints(coulomb), trig, trig_lanes)


@kernel
def span_plane(normal, base):
    """Write u, v and normal; u and v are coordinate axes if they can be."""
    least = 0
    for k in range(1, 3):
        if abs(normal[k]) < abs(normal[least]):
            least = k
    u = add_scaled(unit(least), -normal[least], normal)
    u = scale(1.0 / math.sqrt(dot(u, u)), u)
    put(base[U:], u)
    put(base[V:], cross(normal, u))
    put(base[NORMAL:], normal)


@inlined
def in_plane(base, a):
    """Components of a along u and v."""
    return dot(vec(base, U), a), dot(vec(base, V), a)


@recursion
def planar(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and tip wrench (6,); see `forward_dynamics`."""
    base, links, given, trig = work.base, work.links, work.given, work.trig
    ω, power = outward(q, qd, tau, links, trig[0])
    lost = take_off_dry_friction(links, work.dry, qd, TORQUE)
    if cos_sin_all(work.flat[0], work.flat[1], work.flat[2]):
        cos_sin_less_turns(q, links, work.flat, trig[0])
    inward(base, wrench, given, qdd, links, trig[1], trig[2])
    turning = ω * dot(vec(base, NORMAL), vec(wrench, 3))
    return turning + accelerate(base, given, links, qd, tau, qdd, power) - lost


@inlined
def outward(q, qd, tau, links, angles):
    """Absolute angles and rates, and the torques that are left for the motion.

    Returns the rate of the tip, and the power of drive and viscous friction.
    """
    φ = ω = power = zero_of(q)
    for k in range(len(q)):
        σ = at(links, k, SIGN)
        φ += σ * at(q, k)
        ω += σ * at(qd, k)
        put_at(angles, φ, k)
        put_at(links, ω * ω, k, RATE2)
        working, torque = smooth_torques(links, k, at(q, k), at(qd, k), at(tau, k))
        put_at(links, torque, k, TORQUE)
        power += working * at(qd, k)
    return ω, power


@recursion
def cos_sin_less_turns(q, links, flat, angles):
    """Cosines and sines once more, of sums of joint angles less whole turns; `angles` is the memory of `flat[0]`."""
    for k in range(len(q)):
        put_at(angles, at(q, k), k)
    less_whole_turns(flat[0])
    φ = zero_of(q)
    for k in range(len(q)):
        φ += at(links, k, SIGN) * at(angles, k)
        put_at(angles, φ, k)
    cos_sin_all(flat[0], flat[1], flat[2])


@inlined
def inward(base, wrench, given, qdd, links, cosines, sines):
    """What each link and all beyond it demand at the link's hinge point: M, f₀ and the moment n."""
    o = zero_of(cosines)
    Mxx = Mxy = Myy = j = gx = gy = o
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    n = -dot(vec(base, NORMAL), vec(wrench, 3))
    for k in range(len(links) - 1, -1, -1):
        c, s, A, m, w = at(cosines, k), at(sines, k), at(links, k, ARMATURE), at(links, k, MASS), at(links, k, RATE2)
        rx, ry, sx, sy, τ = (
            at(links, k, RX),
            at(links, k, RY),
            at(links, k, SX),
            at(links, k, SY),
            at(links, k, SIGN) * at(links, k, TORQUE),
        )
        dx, dy = -s * rx - c * ry, c * rx - s * ry
        hx, hy = -s * sx - c * sy, c * sx - s * sy
        ax, ay = -w * dy, w * dx
        D = (
            (at(links, k, INERTIA) + j + 2.0 * (dx * gx + dy * gy))
            + dx * dx * Mxx
            + dy * dy * Myy
            + (2.0 * dx * dy) * Mxy
        )
        Hx, Hy = hx + gx + Mxx * dx + Mxy * dy, hy + gy + Mxy * dx + Myy * dy
        n += gx * ax + gy * ay
        fx, fy = fx + (Mxx * ax + Mxy * ay), fy + (Mxy * ax + Myy * ay)
        n += dx * fx + dy * fy
        Mxx, Myy, fx, fy = Mxx + m, Myy + m, fx - w * hy, fy + w * hx
        if given[k]:  # kept for `accelerate`: the moment is n + D α + H·a once α and a are known
            step = at(links, k, SIGN) * at(qdd, k)
            ux, uy, α, β, γ = Hx, Hy, n, D, D  # without the rotor, which turns with the hinge alone, as given
            j, gx, gy, n = D, Hx, Hy, n + D * step
            fx, fy = fx + Hx * step, fy + Hy * step
        else:
            inverse = 1.0 / (D + A)
            ux, uy, α, β, γ = Hx * inverse, Hy * inverse, (τ - n) * inverse, A * inverse, D * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy, n = β * D, β * Hx, β * Hy, γ * τ + β * n
            fx, fy = fx + Hx * α, fy + Hy * α
        put_at(links, dx, k, DX)
        put_at(links, dy, k, DY)
        put_at(links, ux, k, UX)
        put_at(links, uy, k, UY)
        put_at(links, α, k, ALPHA)
        put_at(links, β, k, BETA)
        put_at(links, γ, k, GAMMA)


@inlined
def accelerate(base, given, links, qd, tau, qdd, power):
    """Absolute accelerations, and their differences at the hinges; where these are given, the torque they take.

    Returns the power with that of these torques. The rows of the links keep α for T / D.
    """
    ax, ay = in_plane(base, scale(-1.0, vec(base, GRAVITY)))
    before = zero_of(qdd)
    for k in range(len(qdd)):
        dx, dy, w = at(links, k, DX), at(links, k, DY), at(links, k, RATE2)
        pull = at(links, k, UX) * ax + at(links, k, UY) * ay
        if given[k]:
            α = before + at(links, k, SIGN) * at(qdd, k)
            moment = at(links, k, SIGN) * (at(links, k, ALPHA) + at(links, k, BETA) * α + pull)
            more = moment + at(links, k, ARMATURE) * at(qdd, k) - at(links, k, TORQUE)  # than all else gives it
            put_at(tau, at(tau, k) + more, k)
            power += at(qd, k) * more
        else:
            α = (at(links, k, ALPHA) + at(links, k, BETA) * before) - pull
            step = (at(links, k, ALPHA) - at(links, k, GAMMA) * before) - pull
            put_at(qdd, at(links, k, SIGN) * step, k)
        put_at(links, α, k, ALPHA)
        ax, ay = ax + α * dx - w * dy, ay + α * dy + w * dx
        before = α
    return power
