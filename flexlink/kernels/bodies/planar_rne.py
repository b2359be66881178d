"""Recursive Newton-Euler in a plane: the torques for a given motion, with the constants of `planar`.

All vectors are in inertial axes. φ, ω, α are the absolute angle, rate and acceleration of a link, a the acceleration of
its hinge point, and I its inertia about this point. r is the vector to the next hinge point, m c the first moment; d
and h are r and m c turned by 90°. The centre of mass accelerates by a + (α h − ω² m c) / m. The recursion is therefore

    forward     φ ← φ + σ q        ω ← ω + σ q̇        α ← α + σ q̈
    body        F = m a + α h − ω² m c        N = I α + h·a            about the hinge point
                a ← a + α d − ω² r
    backward    n ← n + N + d·f        f ← f + F        τ = σ n + A q̈

This takes a quarter of `rne`'s time, since no vector is rotated between frames or multiplied by zeros of a third axis.
"""

from flexlink.kernels.bodies.plane import BASE, LINK, cos_sin_less_turns, in_plane
from flexlink.kernels.tools.compiler import inlined
from flexlink.kernels.tools.lanes import vec
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sincos import cos_sin_all
from flexlink.kernels.tools.vec3 import dot, scale

FORCE = numbered("x y", start=LINK.ux)  # F of a body; `planar` uses these columns for H / D


@inlined
def planar_rne(wrench, q, qd, qdd, tau, work):
    """Write τ = M q̈ + T_GC (n,) under the tip wrench (6,), with the scratch of `planar`; returns its power m·ω [W]."""
    base, links, trig = work.base, work.links, work.trig
    φ = ω = 0.0
    for k in range(len(q)):
        φ += links[k, LINK.sign] * q[k]
        ω += links[k, LINK.sign] * qd[k]
        trig[0, k] = φ
    if cos_sin_all(trig[0], trig[1], trig[2]):
        cos_sin_less_turns(q, links, trig, trig[0])
    forward(base, links, trig[1], trig[2], qd, qdd, tau)
    backward(base, links, wrench, qdd, tau)
    return ω * dot(vec(base, BASE.normal), vec(wrench, 3))


@inlined
def forward(base, links, cosines, sines, qd, qdd, tau):
    """Write d and F of every body to its row, and N to `tau`."""
    ax, ay = in_plane(base, scale(-1.0, vec(base, BASE.gravity)))
    ω = α = 0.0
    for k in range(len(qd)):
        c, s, σ, m = cosines[k], sines[k], links[k, LINK.sign], links[k, LINK.mass]
        rx, ry, sx, sy = links[k, LINK.rx], links[k, LINK.ry], links[k, LINK.sx], links[k, LINK.sy]
        ω += σ * qd[k]
        α += σ * qdd[k]
        w = ω * ω
        dx, dy = -s * rx - c * ry, c * rx - s * ry
        hx, hy = -s * sx - c * sy, c * sx - s * sy
        links[k, LINK.dx], links[k, LINK.dy] = dx, dy
        links[k, FORCE.x], links[k, FORCE.y] = m * ax + α * hx - w * hy, m * ay + α * hy + w * hx
        tau[k] = links[k, LINK.inertia] * α + hx * ax + hy * ay
        ax, ay = ax + α * dx - w * dy, ay + α * dy + w * dx


@inlined
def backward(base, links, wrench, qdd, tau):
    """Write τ of each hinge from N and F summed over all outboard bodies, less the tip wrench, about its point."""
    fx, fy = in_plane(base, scale(-1.0, vec(wrench, 0)))
    n = -dot(vec(base, BASE.normal), vec(wrench, 3))
    for k in range(len(qdd) - 1, -1, -1):
        n += tau[k] + links[k, LINK.dx] * fx + links[k, LINK.dy] * fy
        fx, fy = fx + links[k, FORCE.x], fy + links[k, FORCE.y]
        tau[k] = links[k, LINK.sign] * n + links[k, LINK.armature] * qdd[k]
