"""Articulated-body algorithm in a plane, O(n), for chains with parallel hinge axes.

All vectors are in inertial axes; the unknown is the acceleration a of the hinge point. A body and all outboard bodies
require a force f = M a + f₀. Their moment equals the joint torque, which is known, so only M (2×2) and f₀ are passed
on. d is r rotated by 90°, h is m c rotated by 90°, φ and α are absolute, D is the inertia about the hinge point plus
rotor A. A large φ is summed from angles without full turns, so φ keeps all digits:

    forward     φ ← φ + σ q       ω ← ω + σ q̇
    backward    f₀ ← f₀ − M ω² r             H = h + M d            D = I + d·M d + A        T = σ τ − n − d·f₀
                M ← M + m 1 − H Hᵀ / D       f₀ ← f₀ − ω² m c + H T / D
    forward     α = (T − H·a) / D            σ q̈ = α − α_before    a ← a + α d − ω² r

A rotor's torque A q̈ is not known in advance. It adds a moment that depends on the motion, j α + g·a (zero if A = 0),
with j = A (1 − A/D). 1 − A/D is computed as (D − A)/D, so a large rotor loses no digits. The same code works for one
chain and for eight chains side by side (`lanes`).
"""

from flexlink.kernels.bodies.plane import BASE, LINK, cos_sin_less_turns, in_plane
from flexlink.kernels.forces.elements import subtract_torques
from flexlink.kernels.forces.joint_torques import smooth_torques, subtract_dry_friction
from flexlink.kernels.tools.compiler import inlined, recursion
from flexlink.kernels.tools.lanes import at, put_at, vec, zero_of
from flexlink.kernels.tools.rare import rarely
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import dot, scale


@recursion
def planar(wrench, q, qd, tau, qdd, work):
    """Write q̈ for drive torques `tau`, all (n,) or (n, 8), and the tip wrench (6,); see `forward_dynamics`."""
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
    """Store absolute angles, ω², T_EX − d q̇ − k (θ − θ₀); return ω of the tip, and the power of drives and dampers."""
    φ = ω = power = zero_of(q)
    for k in range(len(q)):
        σ = at(links, k, LINK.sign)
        φ, ω = φ + σ * at(q, k), ω + σ * at(qd, k)
        put_at(angles, φ, k)
        working, torque = smooth_torques(links, k, at(q, k), at(qd, k), at(tau, k))
        keep(links, k, (ω * ω, torque), LINK.rate2)
        power += working * at(qd, k)
    return ω, power


@inlined
def inward(base, wrench, prescribed, qdd, links, cosines, sines):
    """Compute M, f₀ and the moment n of each link and all outboard links, at the link's hinge point."""
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
        D = at(links, k, LINK.inertia) + j + 2.0 * (dx * gx + dy * gy)
        D = D + dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = hx + gx + Mxx * dx + Mxy * dy, hy + gy + Mxy * dx + Myy * dy
        n += gx * ax + gy * ay
        fx, fy = fx + (Mxx * ax + Mxy * ay), fy + (Mxy * ax + Myy * ay)
        n += dx * fx + dy * fy
        Mxx, Myy, fx, fy = Mxx + m, Myy + m, fx - w * hy, fy + w * hx
        if prescribed[k]:  # stored for `accelerate`: the moment is n + D α + H·a for the resulting α and a
            step = at(links, k, LINK.sign) * at(qdd, k)
            ux, uy, α, β, γ = Hx, Hy, n, D, D  # without the rotor, whose acceleration is prescribed
            j, gx, gy, n = D, Hx, Hy, n + D * step
            fx, fy = fx + Hx * step, fy + Hy * step
        else:
            inverse = 1.0 / (D + A)
            ux, uy, α, β, γ = Hx * inverse, Hy * inverse, (τ - n) * inverse, A * inverse, D * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy, n = β * D, β * Hx, β * Hy, γ * τ + β * n
            fx, fy = fx + Hx * α, fy + Hy * α
        keep(links, k, (dx, dy, ux, uy, α, β, γ), LINK.dx)


@inlined
def accelerate(base, prescribed, links, qd, tau, qdd, power):
    """Compute absolute accelerations, q̈ from their differences, and torques of prescribed hinges.

    Returns the power, including the power of these torques. In the rows of the links, α replaces T / D.
    """
    ax, ay = in_plane(base, scale(-1.0, vec(base, BASE.gravity)))
    before = zero_of(qdd)
    for k in range(len(qdd)):
        dx, dy, w = at(links, k, LINK.dx), at(links, k, LINK.dy), at(links, k, LINK.rate2)
        pull = at(links, k, LINK.ux) * ax + at(links, k, LINK.uy) * ay
        if prescribed[k]:
            α = before + at(links, k, LINK.sign) * at(qdd, k)
            moment = at(links, k, LINK.sign) * (at(links, k, LINK.α) + at(links, k, LINK.β) * α + pull)
            # torque in addition to drive, spring and friction
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
