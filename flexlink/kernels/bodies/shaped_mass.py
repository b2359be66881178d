"""Mass matrix Φᵀ M Φ of a chain whose hinges move by shapes, q̇ = Φ ż, in O(hinges · shapes).

All vectors are in frame 0, all moments about one point O, so nothing is transferred from body to body. Let the bodies
outboard of hinge k, with axis e through p, have mass m, first moment h and inertia J. A unit acceleration of the hinge
requires the force and moment (about O)

    v = (p − O) × e        f = m v + e × h        n = J e + h × v               prismatic: f = m e        n = h × e

F_l and N_l add these up, times Φ_kl, over the hinges of shape l from the tip to hinge k. With them hinge k contributes

    M_jl += Φ_kj (e · N_l + v · F_l)             prismatic: Φ_kj e · F_l

for all shapes l that move it or bodies outboard. Each pair of hinges is counted once, and half of each hinge with
itself, so the matrix is the sum of M and its transpose. This is the composite-body algorithm (Featherstone 2008,
section 6.2), with shapes in place of hinges.

In a plane, O is the tip and all moments are scalars: σ is the sense of hinge k, and with lever P = p − O

    v = σ (P_y, −P_x)      f = m v + σ (−h_y, h_x)      n = J σ + h_x v_y − h_y v_x
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.plane import LINK
from flexlink.kernels.geometry.kinematics import KinematicsWork, kinematics, kinematics_workspace
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import allocating, inlined, kernel, subroutine
from flexlink.kernels.tools.lanes import vec_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import added, keep
from flexlink.kernels.tools.sym3 import point_inertia, sym_add, sym_apply, sym_rotate, symmetric
from flexlink.kernels.tools.vec3 import ZERO, add, apply, cross, scale, sub, vector

LOAD = numbered("F:3 N:3 power")
"""Rows of a force and moment of every shape; `power` is that of the hinge's motion."""


class Shapes(NamedTuple):
    """Shapes of a chain: hinge rates are q̇ = Φ ż."""

    matrix: Any  # Φ, (n, m): hinge k moves by Φ_kj per unit of shape j
    first: Any  # (n,) the shapes of hinge k are first … stop − 1
    stop: Any
    inverse: Any  # (n, m) transposed pseudo-inverse: the sum of shapes closest to q̇ has amplitudes Φ⁺ q̇
    least: Any  # (bodies,) the first of these shapes:
    moves: Any  # (bodies, m) 1.0 if a shape moves a hinge of the body or of a body outboard, else 0.0


class ShapedMass(NamedTuple):
    """Scratch of `mass_in_space`."""

    placed: KinematicsWork
    outboard: Any  # (bodies, 10) m, h and J of a body and all bodies outboard
    loads: Any  # (7, m) F and N of every shape, rows `LOAD`


@allocating
def shaped_mass_workspace(chain, shapes):
    """Scratch of `mass_in_space`."""
    m = shapes.matrix.shape[1]
    return ShapedMass(kinematics_workspace(chain), np.empty((len(chain.bodies), 10)), np.empty((LOAD.size, m)))


@kernel
def mass_of_shapes(chain, shapes, q):
    """Return Φᵀ M Φ (m, m) at the angles q (n,), with rotors."""
    M, work = np.empty((shapes.matrix.shape[1], shapes.matrix.shape[1])), shaped_mass_workspace(chain, shapes)
    mass_in_space(chain, q, shapes, M, work)
    add_rotors(chain, shapes, M)
    return M


@subroutine
def mass_in_plane(links, trig, shapes, M, loads):
    """Write Φᵀ M Φ (m, m) of a planar chain without rotors; `trig` are its absolute angles, cosines and sines."""
    Φ, first, stop = shapes.matrix, shapes.first, shapes.stop
    M[:] = 0.0
    loads[:] = 0.0
    mass = hx = hy = J = px = py = 0.0
    for k in range(len(Φ) - 1, -1, -1):
        σ, m, c, s = links[k, LINK.sign], links[k, LINK.mass], trig[1, k], trig[2, k]
        px -= c * links[k, LINK.rx] - s * links[k, LINK.ry]
        py -= s * links[k, LINK.rx] + c * links[k, LINK.ry]
        sx = c * links[k, LINK.sx] - s * links[k, LINK.sy]
        sy = s * links[k, LINK.sx] + c * links[k, LINK.sy]
        J += links[k, LINK.inertia] + 2.0 * (px * sx + py * sy) + m * (px * px + py * py)
        mass, hx, hy = mass + m, hx + m * px + sx, hy + m * py + sy
        vx, vy = σ * py, -σ * px
        fx, fy = mass * vx - σ * hy, mass * vy + σ * hx
        n = σ * J + hx * vy - hy * vx
        add_half_in_plane(loads, Φ, k, first[k], stop[k], fx, fy, n)
        for l in range(first[k], len(M)):
            loads[LOAD.power, l] = vx * loads[0, l] + vy * loads[1, l] + σ * loads[5, l]
        add_products(M, Φ, k, first[k], stop[k], loads[LOAD.power], first[k])
        add_half_in_plane(loads, Φ, k, first[k], stop[k], fx, fy, n)
    add_transpose(M)


@inlined
def add_half_in_plane(loads, Φ, k, first, stop, fx, fy, n):
    """Add half of the force and moment of hinge k to those of its shapes."""
    for j in range(first, stop):
        half = 0.5 * Φ[k, j]
        loads[0, j] += half * fx
        loads[1, j] += half * fy
        loads[5, j] += half * n


@inlined
def add_products(M, Φ, k, first, stop, power, least):
    """M_jl += Φ_kj power_l for the shapes j of hinge k, and l from `least` on."""
    for j in range(first, stop):
        for l in range(least, len(power)):
            M[j, l] += Φ[k, j] * power[l]


@inlined
def add_transpose(M):
    """M ← M + Mᵀ."""
    for j in range(len(M)):
        for l in range(j + 1):
            M[j, l] = M[l, j] = M[j, l] + M[l, j]


@subroutine
def mass_in_space(chain, q, shapes, M, work):
    """Write Φᵀ M Φ (m, m) without rotors, at the angles q (n,)."""
    kinematics(chain, q, work.placed)
    bodies, hinges, Φ, moves, loads = chain.bodies, chain.hinges, shapes.matrix, shapes.moves, work.loads
    points, axes = work.placed.points, work.placed.axes
    origin = vector(points[len(bodies) - 1])
    gather_bodies(bodies, origin, work)
    M[:] = 0.0
    loads[:] = 0.0
    for i in range(len(bodies) - 1, -1, -1):
        m, h, J = added(work.outboard, i, (0.0, ZERO, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)))
        lever = sub(vector(points[i]), origin)
        for k in range(bodies[i].stop - 1, bodies[i].first - 1, -1):
            e = vec_of(axes, k, 0)
            slides = hinges[k].axis >= SLIDES
            ω, v = (ZERO, e) if slides else (e, cross(lever, e))
            f = add(scale(m, v), cross(ω, h))
            n = add(sym_apply(J, ω), cross(h, v))
            add_half(loads, Φ, k, shapes.first[k], shapes.stop[k], f, n)
            for l in range(shapes.least[i], len(M)):
                power = v[0] * loads[0, l] + v[1] * loads[1, l] + v[2] * loads[2, l]
                power += ω[0] * loads[3, l] + ω[1] * loads[4, l] + ω[2] * loads[5, l]
                loads[LOAD.power, l] = moves[i, l] * power
            add_products(M, Φ, k, shapes.first[k], shapes.stop[k], loads[LOAD.power], shapes.least[i])
            add_half(loads, Φ, k, shapes.first[k], shapes.stop[k], f, n)
    add_transpose(M)


@inlined
def weigh_in_plane(q, work, placed):
    """`weigh` in a plane."""
    mass_in_plane(placed.links, placed.trig, work.shapes, work.M, work.mass.loads)


@inlined
def weigh_in_space(q, work, placed):
    """`weigh` in space."""
    mass_in_space(work.chain, q, work.shapes, work.M, work.mass)


@subroutine
def gather_bodies(bodies, origin, work):
    """Write mass, first moment and inertia about `origin` of each body with all bodies outboard."""
    outboard, rotations, points = work.outboard, work.placed.rotations, work.placed.points
    for i in range(len(bodies)):
        b = bodies[i]
        c = add(sub(vector(points[i]), origin), apply(rotations[i], vector(b.center)))
        J = sym_add(sym_rotate(rotations[i], symmetric(b.inertia)), point_inertia(b.mass, c))
        keep(outboard, i, (b.mass, scale(b.mass, c), J))
    for i in range(len(bodies) - 1, -1, -1):
        if bodies[i].parent > 0:
            parent = bodies[i].parent - 1
            for column in range(outboard.shape[1]):
                outboard[parent, column] += outboard[i, column]


@inlined
def add_half(loads, Φ, k, first, stop, f, n):
    """Add half of the force and moment of hinge k to those of its shapes."""
    for j in range(first, stop):
        half = 0.5 * Φ[k, j]
        for x in range(3):
            loads[x, j] += half * f[x]
            loads[3 + x, j] += half * n[x]


@subroutine
def add_rotors(chain, shapes, M):
    """M += Φᵀ A Φ for the rotor inertias A of the hinges."""
    Φ = shapes.matrix
    for k in range(len(Φ)):
        if chain.hinges[k].armature != 0.0:
            for j in range(shapes.first[k], shapes.stop[k]):
                for l in range(shapes.first[k], shapes.stop[k]):
                    M[j, l] += Φ[k, j] * chain.hinges[k].armature * Φ[k, l]
