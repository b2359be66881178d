"""(M + A) x = r in a plane, O(n), real or complex: a mass matrix with other rotors, and springs and dampers with them.

Absolute angles and accelerations as in `planar`, at rest and without forces; d = r turned by 90°, h = m c likewise.
With A diagonal:

    inward      H = h + g + M d          D = I + A + j + 2 d·g + d·M d        M ← M + m 1 − H Hᵀ / D
    load        n ← n + d·f              T = σ r − n       n ← σ r − A T / D      f ← f + H T / D
    outward     α = T / D + (A / D) α_before − H·a / D           σ x = α − α_before          a ← a + α d

j = A (1 − A / D) and g = H A / D are what a rotor passes inward; 1 − A / D is (D − A) / D, as in `planar`.

Where springs of a cell are coupled, A is full within it. A hinge k that is taken out leaves to every hinge j before it
in its cell a term of j's equation that depends on the motion at its place, c_j α + g_j·a, and, M + A being symmetric,
the same moment c_j and force g_j where ξ_j = 1: an open column, which travels inward as a load does. With ξ = σ x, A_kj
times σ_k σ_j, and D the inertia beyond without the rotor,

    body        c_j ← c_j + d·g_j
    hinge       U = D + c_k        G = H + g_k        S = U + c_k + A_kk        L_kj = A_kj + c_j        j < k, its cell
                j = (D A_kk − c_k²) / S               g = ((c_k + A_kk) H − U g_k) / S                M ← M − G Gᵀ / S
                c_j ← c_j − L_kj U / S                g_j ← g_j − L_kj G / S                 A_ij ← A_ij − L_ki L_kj / S
    load        T = (τ − n) / S       n ← (U τ + (c_k + A_kk) n) / S       f ← f + G T       r_j ← r_j − L_kj T
    outward     ξ = T − (U α_before + G·a + Σ_j L_kj ξ_j) / S

Nothing cancels where A is large. Column j stands in the places of row j's own factors until j is taken out. What is
kept is σ_j L_kj, which acts on r_j and x_j themselves.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import LINK, cos_sin_less_turns, planar_workspace
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.forward.mass_plus_cells import COUPLED, rows_beside
from flexlink.kernels.tools.compiler import inlined, kernel, recursion
from flexlink.kernels.tools.lanes import at, put_at
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.sincos import cos_sin_all

ROW = numbered("A inverse gx gy β γ")  # of a hinge that is out: A_kk, 1 / S, G, (c_k + A_kk) / S and U / S
OPEN = numbered("rotor gx gy c", start=ROW.inverse)  # of one that is not: A_kk so far, its open column


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


@inlined
def plane_without_cells(posture):
    """The posture by whose type no springs are coupled."""
    links, prescribed, trig, d, h = posture.links, posture.prescribed, posture.trig, posture.d, posture.h
    return PlanePosture(links, prescribed, trig, d, h, None, None, posture.radius)


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
    """Prepare `solve_in_plane`; A_kk in the first column of `factors`, with cells A_kj from `COUPLED.L` on."""
    links, prescribed, d, h, first = posture.links, posture.prescribed, posture.d, posture.h, posture.first
    o = factors.dtype.type(0)
    Mxx = Mxy = Myy = j = gx = gy = o
    beyond = len(factors)  # the cell of the hinge beyond; its first hinge
    for k in range(len(factors) - 1, -1, -1):
        dx, dy, m = d[k, 0], d[k, 1], links[k, LINK.mass]
        D = links[k, LINK.inertia] + j + 2.0 * (dx * gx + dy * gy)
        D += dx * dx * Mxx + dy * dy * Myy + (2.0 * dx * dy) * Mxy
        Hx, Hy = h[k, 0] + gx + Mxx * dx + Mxy * dy, h[k, 1] + gy + Mxy * dx + Myy * dy
        Mxx, Myy = Mxx + m, Myy + m
        if first is not None:
            open_columns(factors, first[k], k, beyond, dx, dy)
            beyond, factors[k, COUPLED.inertia] = first[k], D
        if prescribed[k]:
            j, gx, gy = D, Hx, Hy
        else:
            if first is None:
                A, U, Gx, Gy = factors[k, ROW.A], D, Hx, Hy
                inverse = 1.0 / (U + A)
                β, γ = A * inverse, U * inverse
                j, gx, gy = β * D, β * Hx, β * Hy
            else:
                A, c, hx, hy = factors[k, OPEN.rotor], factors[k, OPEN.c], factors[k, OPEN.gx], factors[k, OPEN.gy]
                U, Gx, Gy = D + c, Hx + hx, Hy + hy
                inverse = 1.0 / (U + c + A)
                β, γ = (c + A) * inverse, U * inverse
                j, gx, gy = (D * A - c * c) * inverse, β * Hx - γ * hx, β * Hy - γ * hy
            Mxx, Mxy, Myy = Mxx - Gx * Gx * inverse, Mxy - Gx * Gy * inverse, Myy - Gy * Gy * inverse
            factors[k, ROW.gx], factors[k, ROW.gy], factors[k, ROW.inverse] = Gx, Gy, inverse
            factors[k, ROW.β], factors[k, ROW.γ] = β, γ
            if first is not None:
                close_hinge(factors, links, k, first[k], U, Gx, Gy)


@inlined
def open_columns(factors, begin, k, beyond, dx, dy):
    """Open columns of a cell from `begin` to k, at the place of hinge k; `beyond` is where the cell before began."""
    o = factors.dtype.type(0)
    for i in range(begin, k + 1):
        if begin == beyond:
            factors[i, OPEN.c] += dx * factors[i, OPEN.gx] + dy * factors[i, OPEN.gy]
        else:
            factors[i, OPEN.rotor] = factors[i, ROW.A]
            factors[i, OPEN.c] = factors[i, OPEN.gx] = factors[i, OPEN.gy] = o


@inlined
def close_hinge(factors, links, k, begin, U, Gx, Gy):
    """What hinge k leaves to those before it in its cell, from `begin` on; keeps σ_j L_kj."""
    inverse, σ = factors[k, ROW.inverse], links[k, LINK.sign]
    for i in range(begin, k):
        own = links[i, LINK.sign]
        L = σ * own * factors[k, COUPLED.L + i - begin] + factors[i, OPEN.c]
        part = L * inverse
        factors[k, COUPLED.L + i - begin] = own * L
        factors[i, OPEN.c] -= part * U
        factors[i, OPEN.gx] -= part * Gx
        factors[i, OPEN.gy] -= part * Gy
        factors[i, OPEN.rotor] -= part * L
        for l in range(begin, i):
            factors[i, COUPLED.L + l - begin] -= own * part * factors[k, COUPLED.L + l - begin]


@recursion
def solve_in_plane(factors, r, x, posture):
    """Write x with (M + A) x = r, 0 at prescribed joints."""
    links, prescribed, d, first = posture.links, posture.prescribed, posture.d, posture.first
    o = factors.dtype.type(0)
    fx = fy = n = o
    if first is not None:
        for k in range(len(factors)):
            x[k] = r[k]
        r = x
    for k in range(len(factors) - 1, -1, -1):
        n += d[k, 0] * fx + d[k, 1] * fy
        if not prescribed[k]:
            τ = links[k, LINK.sign] * r[k]
            T = (τ - n) * factors[k, ROW.inverse]
            x[k] = T
            if first is not None:
                for i in range(first[k], k):
                    x[i] -= factors[k, COUPLED.L + i - first[k]] * T
            n = factors[k, ROW.γ] * τ + factors[k, ROW.β] * n
            fx, fy = fx + factors[k, ROW.gx] * T, fy + factors[k, ROW.gy] * T
    ax = ay = before = o
    for k in range(len(factors)):
        if prescribed[k]:
            x[k] = o
        else:
            pull = factors[k, ROW.gx] * ax + factors[k, ROW.gy] * ay
            if first is not None:
                for i in range(first[k], k):
                    pull += factors[k, COUPLED.L + i - first[k]] * x[i]
            α = x[k] - factors[k, ROW.inverse] * pull
            x[k] = links[k, LINK.sign] * (α - factors[k, ROW.γ] * before)
            before = α + factors[k, ROW.β] * before
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
