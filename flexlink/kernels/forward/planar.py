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

from flexlink.kernels.bodies.plane import BASE, LINK, cos_sin_less_turns, in_plane
from flexlink.kernels.forces.elements import subtract_torques
from flexlink.kernels.forces.joint_torques import smooth_torques, subtract_dry_friction
from flexlink.kernels.tools.compiler import inlined, recursion
from flexlink.kernels.tools.lanes import at, put_at, vec, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import (
    dot,
    scale,
)


@recursion
def planar(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and tip wrench (6,); see `forward_dynamics`."""
    base, links, prescribed, trig = work.base, work.links, work.prescribed, work.trig
    ω, power = outward(q, qd, tau, links, trig[0])
    lost = subtract_dry_friction(links, work.dry, qd, LINK.torque)
    if work.forces is not None and rarely(work.forces.act):
        lost += subtract_torques(work.forces, links, q, qd, LINK.torque)
    if cos_sin_all(work.flat[0], work.flat[1], work.flat[2]):
        cos_sin_less_turns(q, links, work.flat, trig[0])
    inward(base, wrench, prescribed, qdd, links, trig[1], trig[2])
    turning = ω * dot(vec(base, BASE.normal), vec(wrench, 3))
    return turning + accelerate(base, prescribed, links, qd, tau, qdd, power) - lost


@inlined
def outward(q, qd, tau, links, angles):
    """Absolute angles and rates, and the torques that are left for the motion.

    Returns the rate of the tip, and the power of drive and viscous friction.
    """
    φ = ω = power = zero_of(q)
    for k in range(len(q)):
        σ = at(links, k, LINK.sign)
        φ += σ * at(q, k)
        ω += σ * at(qd, k)
        put_at(angles, φ, k)
        put_at(links, ω * ω, k, LINK.rate2)
        working, torque = smooth_torques(links, k, at(q, k), at(qd, k), at(tau, k))
        put_at(links, torque, k, LINK.torque)
        power += working * at(qd, k)
    return ω, power


@inlined
def inward(base, wrench, prescribed, qdd, links, cosines, sines):
    """What each link and all beyond it demand at the link's hinge point: M, f₀ and the moment n."""
    o = zero_of(cosines)
    Mxx = Mxy = Myy = j = gx = gy = o
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    n = -dot(vec(base, BASE.normal), vec(wrench, 3))
    for k in range(len(links) - 1, -1, -1):
        c, s, A, m = at(cosines, k), at(sines, k), at(links, k, LINK.armature), at(links, k, LINK.mass)
        w = at(links, k, LINK.rate2)
        rx, ry, sx, sy = at(links, k, LINK.rx), at(links, k, LINK.ry), at(links, k, LINK.sx), at(links, k, LINK.sy)
        τ = at(links, k, LINK.sign) * at(links, k, LINK.torque)
        dx, dy = -s * rx - c * ry, c * rx - s * ry
        hx, hy = -s * sx - c * sy, c * sx - s * sy
        ax, ay = -w * dy, w * dx
        D = (
            (at(links, k, LINK.inertia) + j + 2.0 * (dx * gx + dy * gy))
            + dx * dx * Mxx
            + dy * dy * Myy
            + (2.0 * dx * dy) * Mxy
        )
        Hx, Hy = hx + gx + Mxx * dx + Mxy * dy, hy + gy + Mxy * dx + Myy * dy
        n += gx * ax + gy * ay
        fx, fy = fx + (Mxx * ax + Mxy * ay), fy + (Mxy * ax + Myy * ay)
        n += dx * fx + dy * fy
        Mxx, Myy, fx, fy = Mxx + m, Myy + m, fx - w * hy, fy + w * hx
        if prescribed[k]:  # kept for `accelerate`: the moment is n + D α + H·a once α and a are known
            step = at(links, k, LINK.sign) * at(qdd, k)
            ux, uy, α, β, γ = Hx, Hy, n, D, D  # without the rotor, which turns with the hinge alone, as given
            j, gx, gy, n = D, Hx, Hy, n + D * step
            fx, fy = fx + Hx * step, fy + Hy * step
        else:
            inverse = 1.0 / (D + A)
            ux, uy, α, β, γ = Hx * inverse, Hy * inverse, (τ - n) * inverse, A * inverse, D * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy, n = β * D, β * Hx, β * Hy, γ * τ + β * n
            fx, fy = fx + Hx * α, fy + Hy * α
        put_at(links, dx, k, LINK.dx)
        put_at(links, dy, k, LINK.dy)
        put_at(links, ux, k, LINK.ux)
        put_at(links, uy, k, LINK.uy)
        put_at(links, α, k, LINK.α)
        put_at(links, β, k, LINK.β)
        put_at(links, γ, k, LINK.γ)


@inlined
def accelerate(base, prescribed, links, qd, tau, qdd, power):
    """Absolute accelerations, and their differences at the hinges; where these are given, the torque they take.

    Returns the power with that of these torques. The rows of the links keep α for T / D.
    """
    ax, ay = in_plane(base, scale(-1.0, vec(base, BASE.gravity)))
    before = zero_of(qdd)
    for k in range(len(qdd)):
        dx, dy, w = at(links, k, LINK.dx), at(links, k, LINK.dy), at(links, k, LINK.rate2)
        pull = at(links, k, LINK.ux) * ax + at(links, k, LINK.uy) * ay
        if prescribed[k]:
            α = before + at(links, k, LINK.sign) * at(qdd, k)
            moment = at(links, k, LINK.sign) * (at(links, k, LINK.α) + at(links, k, LINK.β) * α + pull)
            # more than all else gives it
            more = moment + at(links, k, LINK.armature) * at(qdd, k) - at(links, k, LINK.torque)
            put_at(tau, at(tau, k) + more, k)
            power += at(qd, k) * more
        else:
            α = (at(links, k, LINK.α) + at(links, k, LINK.β) * before) - pull
            step = (at(links, k, LINK.α) - at(links, k, LINK.γ) * before) - pull
            put_at(qdd, at(links, k, LINK.sign) * step, k)
        put_at(links, α, k, LINK.α)
        ax, ay = ax + α * dx - w * dy, ay + α * dy + w * dx
        before = α
    return power
