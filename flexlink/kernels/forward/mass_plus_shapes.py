"""Solve (M + A) x = r for hinges that move by shapes, x = Φ y: Φᵀ (M + A) Φ y = Φᵀ r, real or complex.

A contains rotors, springs and dampers, and is diagonal except for coupled springs. Φᵀ M Φ is computed once per posture.
Displacements of bodies are those of the chain's own posture in a plane or in space.
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.shaped_mass import ShapedMass, Shapes, mass_in_plane, mass_in_space, shaped_mass_workspace
from flexlink.kernels.forward.mass_plus_cells import COUPLED, FACTORS, columns
from flexlink.kernels.forward.mass_plus_plane import (
    PlanePosture,
    displacement_in_plane,
    place_in_plane,
    plane_posture_of,
)
from flexlink.kernels.forward.mass_plus_space import (
    SpacePosture,
    displacement_in_space,
    place_in_space,
    space_posture_of,
)
from flexlink.kernels.tools.compiler import by_type, inlined, kernel, recursion, subroutine


class ShapedPosture(NamedTuple):
    """Posture of a chain whose hinges move by shapes, with its constants."""

    chain: Any
    shapes: Shapes
    mass: ShapedMass
    M: Any  # (m, m) Φᵀ M Φ without rotors
    y: Any  # (m,) scratch
    hinges: Any  # the chain's own posture
    first: Any  # as in `hinges`
    coupled: Any  # as in `hinges`
    radius: Any  # as in `hinges`


@kernel
def shaped_posture(chain, shapes, hinges):
    """Allocate the posture; `hinges` is the chain's own posture."""
    m = shapes.matrix.shape[1]
    mass, M = shaped_mass_workspace(chain, shapes), np.zeros((m, m))
    return ShapedPosture(chain, shapes, mass, M, np.zeros(m), hinges, hinges.first, hinges.coupled, hinges.radius)


@kernel
def shaped_postures(s, posture, hinges):
    """Allocate `s` postures of the same chain, with its own postures `hinges`, whose arrays begin with (s,)."""
    m = len(posture.M)
    return ShapedPosture(
        posture.chain, posture.shapes, posture.mass, np.zeros((s, m, m)), posture.y, hinges,
        posture.first, posture.coupled, posture.radius,
    )  # fmt: skip


@by_type({PlanePosture: plane_posture_of, SpacePosture: space_posture_of})
def stage_of_hinges(i, postures):
    """Posture `i` of the chain's own postures."""


@inlined
def shaped_posture_of(i, postures):
    """Posture `i` of several postures, whose arrays have a leading dimension."""
    return ShapedPosture(
        postures.chain, postures.shapes, postures.mass, postures.M[i], postures.y,
        stage_of_hinges(i, postures.hinges), postures.first, postures.coupled, postures.radius,
    )  # fmt: skip


@inlined
def shaped_without_cells(posture):
    """The same posture; `factor_shapes` handles chains with and without cells."""
    return posture


@by_type({PlanePosture: place_in_plane, SpacePosture: place_in_space})
def place_hinges(q, posture):
    """Set the chain's own posture to the angles q (n,)."""


@inlined
def weigh_in_plane(q, posture, hinges):
    """`weigh_hinges` in a plane."""
    mass_in_plane(hinges.links, hinges.trig, posture.shapes, posture.M, posture.mass.loads)


@inlined
def weigh_in_space(q, posture, hinges):
    """`weigh_hinges` in space."""
    mass_in_space(posture.chain, q, posture.shapes, posture.M, posture.mass)


@by_type({PlanePosture: weigh_in_plane, SpacePosture: weigh_in_space})
def weigh_hinges(q, posture, hinges):
    """Write Φᵀ M Φ to `posture.M`, after `place_hinges` at the same angles."""


@subroutine
def place_shapes(q, posture):
    """Set the posture to the angles q (n,), and compute Φᵀ M Φ."""
    place_hinges(q, posture.hinges)
    weigh_hinges(q, posture, posture.hinges)


@subroutine
def closest_sum(x, posture):
    """Replace accelerations x (n,) by the closest sum of shapes.

    Rounding errors leave the range of the shapes; extrapolation from step to step would magnify them.
    """
    Φ, inverse, first, stop = posture.shapes.matrix, posture.shapes.inverse, posture.shapes.first, posture.shapes.stop
    y = posture.y
    for j in range(len(y)):
        y[j] = 0.0
    for k in range(len(x)):
        for j in range(first[k], stop[k]):
            y[j] += inverse[k, j] * x[k]
    for k in range(len(x)):
        x[k] = 0.0
        for j in range(first[k], stop[k]):
            x[k] += Φ[k, j] * y[j]


@inlined
def as_given(x, posture):
    """Leave x unchanged: hinges that move one by one."""


@by_type({PlanePosture: displacement_in_plane, SpacePosture: displacement_in_space})
def displacement_by_type(δ, posture):
    """Largest displacement of the chain's own posture [m]."""


@inlined
def displacement_of_hinges(δ, posture):
    """Largest displacement [m] of the outboard end of any segment for small changes δ (n,) of the angles."""
    return displacement_by_type(δ, posture.hinges)


@kernel
def shaped_columns(posture):
    """Number of columns of the factors: those of the hinges, the matrix of the shapes (m, m), and scratch."""
    return columns(posture.first) + len(posture.M) + 1


@subroutine
def factor_shapes(factors, posture):
    """Prepare `solve_shapes`: write D and L of Φᵀ (M + A) Φ = Lᵀ D L, eliminated from the tip inward.

    They are in the first m rows of `factors`, below and on the diagonal of its columns `begin` …
    """
    shapes, m, begin = posture.shapes, len(posture.M), factors.shape[1] - len(posture.M) - 1
    for j in range(m):
        for l in range(j + 1):
            factors[j, begin + l] = posture.M[j, l]
    for k in range(len(factors)):
        add_dyad(factors, begin, shapes, k, k, factors[k, FACTORS.A])
        if posture.first is not None and len(posture.first) > 0:
            for i in range(posture.first[k], k):
                held = factors[k, COUPLED.L + i - posture.first[k]]
                add_dyad(factors, begin, shapes, k, i, held)
                add_dyad(factors, begin, shapes, i, k, held)
    for k in range(len(factors)):
        if posture.chain.hinges[k].prescribed:
            leave_out(factors, begin, m, shapes.first[k])
    for j in range(m - 1, -1, -1):
        for l in range(j):
            ratio = factors[j, begin + l] / factors[j, begin + j]
            for i in range(l + 1):
                factors[l, begin + i] -= ratio * factors[j, begin + i]
        for l in range(j):
            factors[j, begin + l] /= factors[j, begin + j]
    for k in range(len(factors)):
        D = factors[shapes.first[k], begin + shapes.first[k]]
        factors[k, FACTORS.inverse] = 1.0 / D
        if posture.first is not None and len(posture.first) > 0:
            factors[k, COUPLED.inertia] = D - factors[k, FACTORS.A]


@recursion
def add_dyad(factors, begin, shapes, k, i, held):
    """Add A_ki Φ_k Φ_iᵀ to the lower triangle, for rows Φ_k and Φ_i of the hinges k and i."""
    Φ, first, stop = shapes.matrix, shapes.first, shapes.stop
    for j in range(first[k], stop[k]):
        for l in range(first[i], min(stop[i], j + 1)):
            factors[j, begin + l] += Φ[k, j] * held * Φ[i, l]


@recursion
def leave_out(factors, begin, m, j):
    """Replace the equation of shape j by y_j = 0."""
    for l in range(j):
        factors[j, begin + l] *= 0.0
    for l in range(j + 1, m):
        factors[l, begin + j] *= 0.0
    factors[j, begin + j] = factors.dtype.type(1)


@subroutine
def solve_shapes(factors, r, x, posture):
    """Write x = Φ y (n,), 0 at prescribed joints."""
    Φ, first, stop, hinges = posture.shapes.matrix, posture.shapes.first, posture.shapes.stop, posture.chain.hinges
    m, last = len(posture.M), factors.shape[1] - 1
    begin = last - m
    for j in range(m):
        factors[j, last] = factors.dtype.type(0)
    for k in range(len(factors)):
        if not hinges[k].prescribed:
            for j in range(first[k], stop[k]):
                factors[j, last] += Φ[k, j] * r[k]
    for j in range(m - 1, -1, -1):
        for l in range(j):
            factors[l, last] -= factors[j, begin + l] * factors[j, last]
    for j in range(m):
        factors[j, last] /= factors[j, begin + j]
        for l in range(j):
            factors[j, last] -= factors[j, begin + l] * factors[l, last]
    for k in range(len(factors)):
        x[k] = factors.dtype.type(0)
        for j in range(first[k], stop[k]):
            x[k] += Φ[k, j] * factors[j, last]
