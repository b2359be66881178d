"""Solve (M + A) x = r for hinges that move by shapes, x = Φ y: Φᵀ (M + A) Φ y = Φᵀ r, real or complex.

A contains rotors, springs and dampers, and is diagonal except for coupled springs. Φᵀ M Φ is computed once per posture.
Bodies are placed, and displaced, by the chain's own posture in a plane or in space (`mass_plus`).
"""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.bodies.shaped_mass import ShapedMass, Shapes, shaped_mass_workspace
from flexlink.kernels.forward.mass_plus_cells import COUPLED, FACTORS, columns
from flexlink.kernels.tools.compiler import inlined, kernel, recursion, subroutine


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


@inlined
def shaped_without_cells(posture):
    """The same posture; `factor_shapes` handles chains with and without cells."""
    return posture


@subroutine
def closest_sum(x, posture):
    """Replace accelerations x (n,) by the closest sum of shapes.

    Rounding errors leave the range of the shapes; extrapolation from step to step would magnify them.
    """
    Φ, inverse, first, stop = posture.shapes.matrix, posture.shapes.inverse, posture.shapes.first, posture.shapes.stop
    y = posture.y
    y[:] = 0.0
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
    factors[:m, last] = 0.0
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
