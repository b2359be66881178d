"""(M + A) x = r in a plane, O(n), with A diagonal, real or complex: a mass matrix with other rotors.

Absolute angles and accelerations as in `planar`, at rest and without forces; d = r turned by 90°, h = m c likewise:

    inward      H = h + g + M d          D = I + A + j + 2 d·g + d·M d        M ← M + m 1 − H Hᵀ / D
    load        n ← n + d·f              T = σ r − n       n ← σ r − A T / D      f ← f + H T / D
    outward     α = T / D + (A / D) α_before − H·a / D           σ x = α − α_before          a ← a + α d

j = A (1 − A / D) and g = H A / D are what a rotor passes inward; 1 − A / D is (D − A) / D, as in `planar`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import LINK, cos_sin_less_turns, planar_workspace
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.forward.mass_plus_cells import rows_beside
from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.lanes import at, put_at
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sincos import cos_sin_all

FACTORS = numbered("A inverse hx hy β γ unused:2")  # of a hinge: A, 1 / D, H, β = A / D and 1 − β


class PlanePosture(NamedTuple):
    """Posture of a chain in a plane, with its constants."""

    links: Any
    prescribed: Any
    trig: Any  # absolute angles, cosines, sines
    d: Any  # (n, 2) r turned by 90°
    h: Any  # (n, 2) m c turned by 90°
    first: Any  # (n,) of each hinge the first of its cell; (0,) without couplings; None of a plain chain
    beside: Any  # (n, w, 2) K and D of those before it in its cell
    radius: Any  # (n,) by which turning counts as a displacement where it moves no place [m]; (0,) elsewhere


@kernel
def plane_posture(bodies, hinges, gravity, rare):
    """Scratch of a planar chain."""
    n, work = len(hinges), planar_workspace(bodies, hinges, gravity, rare)
    d, h, first = np.zeros((n, 2)), np.zeros((n, 2)), cells_of(n, rare)
    return PlanePosture(work.links, work.prescribed, work.trig, d, h, first, rows_beside(first, rare), np.zeros(0))


@kernel
def plane_postures(s, posture):
    """Scratch of `s` postures of the same chain, whose arrays have a leading dimension (s,)."""
    n = len(posture.d)
    trig, d, h = np.zeros((s, 3, n)), np.zeros((s, n, 2)), np.zeros((s, n, 2))
    return PlanePosture(posture.links, posture.prescribed, trig, d, h, posture.first, posture.beside, posture.radius)


@kernel
def levers_alone(planar, levers):
    """A posture on scratch of `planar`, of one state or of eight, for those who take d and h alone."""
    links, prescribed, trig = planar.links, planar.prescribed, planar.trig
    return PlanePosture(links, prescribed, trig, levers[0], levers[1], None, None, np.empty(0))


@recursion
def plane_posture_of(i, postures):
    """Posture `i` of several, whose arrays have a leading dimension."""
    trig, d, h = postures.trig[i], postures.d[i], postures.h[i]
    return PlanePosture(
        postures.links, postures.prescribed, trig, d, h, postures.first, postures.beside, postures.radius
    )


@recursion
def place_in_plane(q, posture):
    """Posture of angles q (n,)."""
    links, trig = posture.links, posture.trig
    φ = 0.0
    for k in range(len(q)):
        φ += links[k, LINK.sign] * q[k]
        trig[0, k] = φ
    if cos_sin_all(trig[0], trig[1], trig[2]):
        cos_sin_less_turns(q, links, trig, trig[0])
    turn_levers(posture)


@recursion
def turn_levers(posture):
    """d and h from the cosines and sines of the absolute angles, of one state or of eight side by side."""
    links, trig, d, h = posture.links, posture.trig, posture.d, posture.h
    for k in range(len(d)):
        c, s = at(trig[1], k), at(trig[2], k)
        rx, ry, sx, sy = at(links, k, LINK.rx), at(links, k, LINK.ry), at(links, k, LINK.sx), at(links, k, LINK.sy)
        put_at(d, -s * rx - c * ry, k, 0)
        put_at(d, c * rx - s * ry, k, 1)
        put_at(h, -s * sx - c * sy, k, 0)
        put_at(h, c * sx - s * sy, k, 1)


@recursion
def factor_in_plane(factors, posture):
    """From A in the first column of `factors` (n, 8) keep H, 1 / D, A / D and 1 − A / D in the others."""
    links, prescribed, d, h = posture.links, posture.prescribed, posture.d, posture.h
    o = factors.dtype.type(0)
    Mxx = Mxy = Myy = j = gx = gy = o
    for k in range(len(factors) - 1, -1, -1):
        dx, dy, m = d[k, 0], d[k, 1], links[k, LINK.mass]
        D = links[k, LINK.inertia] + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = h[k, 0] + gx + Mxx * dx + Mxy * dy, h[k, 1] + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        if prescribed[k]:
            j, gx, gy = D, Hx, Hy
        else:
            inverse = 1.0 / (D + factors[k, FACTORS.A])
            β = factors[k, FACTORS.A] * inverse
            Mxx, Mxy, Myy = Mxx - Hx * Hx * inverse, Mxy - Hx * Hy * inverse, Myy - Hy * Hy * inverse
            j, gx, gy = β * D, β * Hx, β * Hy
            factors[k, FACTORS.hx], factors[k, FACTORS.hy], factors[k, FACTORS.inverse] = Hx, Hy, inverse
            factors[k, FACTORS.β], factors[k, FACTORS.γ] = β, D * inverse


@recursion
def solve_in_plane(factors, r, x, posture):
    """Write x with (M + A) x = r, 0 at prescribed joints."""
    links, prescribed, d = posture.links, posture.prescribed, posture.d
    o = factors.dtype.type(0)
    fx = fy = n = o
    for k in range(len(factors) - 1, -1, -1):
        n += d[k, 0] * fx + d[k, 1] * fy
        if not prescribed[k]:
            τ = links[k, LINK.sign] * r[k]
            α = (τ - n) * factors[k, FACTORS.inverse]
            x[k] = α
            n = factors[k, FACTORS.γ] * τ + factors[k, FACTORS.β] * n
            fx, fy = fx + factors[k, FACTORS.hx] * α, fy + factors[k, FACTORS.hy] * α
    ax = ay = before = o
    for k in range(len(factors)):
        if prescribed[k]:
            x[k] = o
        else:
            pull = factors[k, FACTORS.hx] * ax + factors[k, FACTORS.hy] * ay
            α = x[k] - factors[k, FACTORS.inverse] * pull
            x[k] = links[k, LINK.sign] * (α - factors[k, FACTORS.γ] * before)
            before = α + factors[k, FACTORS.β] * before
        ax, ay = ax + before * d[k, 0], ay + before * d[k, 1]


@recursion
def displacement_in_plane(δ, posture):
    """Largest displacement [m] that small changes δ (n,) of the angles give to the far end of any segment."""
    links, d = posture.links, posture.d
    φ = x = y = largest = 0.0
    for k in range(len(δ)):
        φ += links[k, LINK.sign] * δ[k]
        x, y = x + φ * d[k, 0], y + φ * d[k, 1]
        largest = max(largest, x * x + y * y)
    return math.sqrt(largest + (φ - φ))  # nan, which `max` passes by, if a δ is not finite
