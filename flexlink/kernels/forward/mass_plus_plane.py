"""Solve (M + A) x = r in a plane, O(n), real or complex; M is the mass matrix, A contains rotors, springs, dampers.

Angles and accelerations are absolute as in `planar`, at rest and without forces; d and h are r and m c rotated by 90°.
For a diagonal A:

    backward    H = h + g + M d          D = I + A + j + 2 d·g + d·M d        M ← M + m 1 − H Hᵀ / D
    load        n ← n + d·f              T = σ r − n       n ← σ r − A T / D      f ← f + H T / D
    forward     α = T / D + (A / D) α_before − H·a / D           σ x = α − α_before          a ← a + α d

j = A (1 − A / D) and g = H A / D are the terms of a rotor; 1 − A / D is computed as (D − A) / D, as in `planar`.

With coupled springs, A is full within a cell. Eliminating hinge k leaves c_j α + g_j·a in the equation of every hinge j
before it in its cell, where α and a are the motion at the current point. Since M + A is symmetric, ξ_j = 1 causes the
same moment c_j and force g_j there. This column of j is transferred inboard like a load. With ξ = σ x, A_kj multiplied
by σ_k σ_j, and D the outboard inertia without the rotor,

    body        c_j ← c_j + d·g_j
    hinge       U = D + c_k        G = H + g_k        S = U + c_k + A_kk        L_kj = A_kj + c_j      j < k in the cell
                j = (D A_kk − c_k²) / S               g = ((c_k + A_kk) H − U g_k) / S                M ← M − G Gᵀ / S
                c_j ← c_j − L_kj U / S                g_j ← g_j − L_kj G / S                 A_ij ← A_ij − L_ki L_kj / S
    load        T = (τ − n) / S       n ← (U τ + (c_k + A_kk) n) / S       f ← f + G T       r_j ← r_j − L_kj T
    forward     ξ = T − (U α_before + G·a + Σ_j L_kj ξ_j) / S

There is no cancellation for large A. Column j is stored in row j of the factors until j is eliminated. The
stored numbers are σ_j L_kj, which multiply r_j and x_j directly.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import LINK, cos_sin_less_turns, planar_workspace
from flexlink.kernels.forces.couplings import cells_of
from flexlink.kernels.forward.mass_plus_cells import COUPLED, rows_beside
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, recursion
from flexlink.kernels.tools.lanes import at
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep
from flexlink.kernels.tools.sincos import cos_sin_all

ROW = numbered("A inverse gx gy β γ")  # of an eliminated hinge: A_kk, 1 / S, G, (c_k + A_kk) / S and U / S
OPEN = numbered("rotor gx gy c", start=ROW.inverse)  # of a hinge before its elimination: A_kk so far, its column c, g


class PlanePosture(NamedTuple):
    """Posture of a chain in a plane, with its constants."""

    links: Any
    prescribed: Any
    trig: Any  # absolute angles, cosines, sines
    d: Any  # (n, 2) r rotated by 90°
    h: Any  # (n, 2) m c rotated by 90°
    first: Any  # (n,) first hinge of each hinge's cell; (0,) without couplings; None for a plain chain
    coupled: Any  # (n, w, 2) K and D with the hinges before it in its cell
    radius: Any  # (n,) displacement per rotation of joints that displace no point [m]; (0,) if there are none


@kernel
def plane_posture(chain):
    """Allocate the posture of a planar chain."""
    n, work = len(chain.hinges), planar_workspace(chain)
    d, h, first = np.zeros((n, 2)), np.zeros((n, 2)), cells_of(n, chain.rare)
    coupled = rows_beside(first, chain.rare)
    return PlanePosture(work.links, work.prescribed, work.trig, d, h, first, coupled, np.zeros(0))


@kernel
def plane_postures(s, posture):
    """Allocate `s` postures of the same chain; their arrays have a leading dimension (s,)."""
    n = len(posture.d)
    trig, d, h = np.zeros((s, 3, n)), np.zeros((s, n, 2)), np.zeros((s, n, 2))
    return PlanePosture(posture.links, posture.prescribed, trig, d, h, posture.first, posture.coupled, posture.radius)


@allocating
def levers_alone(planar, levers):
    """A posture that shares the memory of `planar`, for one state or eight, where only d and h are needed."""
    links, prescribed, trig = planar.links, planar.prescribed, planar.trig
    return PlanePosture(links, prescribed, trig, levers[0], levers[1], None, None, np.empty(0))


@inlined
def plane_without_cells(posture):
    """The same posture with the type of a chain without coupled springs."""
    links, prescribed, trig, d, h = posture.links, posture.prescribed, posture.trig, posture.d, posture.h
    return PlanePosture(links, prescribed, trig, d, h, None, None, posture.radius)


@recursion
def plane_posture_of(i, postures):
    """Posture `i` of several postures, whose arrays have a leading dimension."""
    trig, d, h = postures.trig[i], postures.d[i], postures.h[i]
    return PlanePosture(
        postures.links, postures.prescribed, trig, d, h, postures.first, postures.coupled, postures.radius
    )


@recursion
def place_in_plane(q, posture):
    """Set the posture to the angles q (n,)."""
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
    """Write d and h from cosines and sines of the absolute angles, for one state or eight side by side."""
    links, trig, d, h = posture.links, posture.trig, posture.d, posture.h
    for k in range(len(d)):
        c, s = at(trig[1], k), at(trig[2], k)
        rx, ry, sx, sy = at(links, k, LINK.rx), at(links, k, LINK.ry), at(links, k, LINK.sx), at(links, k, LINK.sy)
        keep(d, k, (-s * rx - c * ry, c * rx - s * ry))
        keep(h, k, (-s * sx - c * sy, c * sx - s * sy))


@recursion
def factor_in_plane(factors, posture):
    """Prepare `solve_in_plane`; column 0 of `factors` is A_kk, columns from `COUPLED.L` are A_kj."""
    links, prescribed, d, h, first = posture.links, posture.prescribed, posture.d, posture.h, posture.first
    o = factors.dtype.type(0)
    Mxx = Mxy = Myy = j = gx = gy = o
    beyond = len(factors)  # first hinge of the cell of the hinge outboard
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
            keep(factors, k, (inverse, Gx, Gy, β, γ), ROW.inverse)
            if first is not None:
                close_hinge(factors, links, k, first[k], U, Gx, Gy)


@inlined
def open_columns(factors, begin, k, beyond, dx, dy):
    """Transfer the columns of a cell, hinges `begin` … k, to the point of hinge k; clear them if the cell is new."""
    o = factors.dtype.type(0)
    for i in range(begin, k + 1):
        if begin == beyond:
            factors[i, OPEN.c] += dx * factors[i, OPEN.gx] + dy * factors[i, OPEN.gy]
        else:
            keep(factors, i, (factors[i, ROW.A], o, o, o), OPEN.rotor)


@inlined
def close_hinge(factors, links, k, begin, U, Gx, Gy):
    """Eliminate hinge k from the equations of hinges `begin` … k − 1, before it in its cell; stores σ_j L_kj."""
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
    """Largest displacement [m] of the outboard end of any segment for small changes δ (n,) of the angles."""
    links, d = posture.links, posture.d
    φ = x = y = largest = 0.0
    for k in range(len(δ)):
        φ += links[k, LINK.sign] * δ[k]
        x, y = x + φ * d[k, 0], y + φ * d[k, 1]
        largest = max(largest, x * x + y * y)
    return math.sqrt(largest + (φ - φ))  # nan if a δ is not finite; `max` would ignore it
