"""Vectors and matrices of three dimensions whose entries are numbers of a tape, or plain numbers."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexlink.formats.code.tape import Number

Real = Number | float
Vector = tuple[Real, Real, Real]
Matrix = tuple[Vector, Vector, Vector]  # rows
ZERO: Vector = (0.0, 0.0, 0.0)


def constant(A: Any) -> Matrix:
    """A matrix of plain numbers."""
    rows = np.asarray(A).tolist()
    return tuple(rows[0]), tuple(rows[1]), tuple(rows[2])


def add(a: Vector, b: Vector) -> Vector:
    """A + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def scale(s: Real, a: Vector) -> Vector:
    """s a."""
    return s * a[0], s * a[1], s * a[2]


def dot(a: Vector, b: Vector) -> Real:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vector, b: Vector) -> Vector:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def swung(ω: Vector, r: Vector) -> Vector:
    """ω × (ω × r)."""
    return cross(ω, cross(ω, r))


def apply(A: Matrix, v: Vector) -> Vector:
    """A v."""
    return dot(A[0], v), dot(A[1], v), dot(A[2], v)


def transposed(A: Matrix) -> Matrix:
    """Aᵀ."""
    return column(A, 0), column(A, 1), column(A, 2)


def column(A: Matrix, k: int) -> Vector:
    """Column k of A."""
    return A[0][k], A[1][k], A[2][k]


def product(A: Matrix, B: Matrix) -> Matrix:
    """A B."""
    columns = transposed(B)
    return transposed((apply(A, columns[0]), apply(A, columns[1]), apply(A, columns[2])))


def plus(A: Matrix, B: Matrix) -> Matrix:
    """A + B."""
    return add(A[0], B[0]), add(A[1], B[1]), add(A[2], B[2])


def minus(A: Matrix, B: Matrix) -> Matrix:
    """A − B."""
    return plus(A, (scale(-1.0, B[0]), scale(-1.0, B[1]), scale(-1.0, B[2])))


def minus_dyad(A: Matrix, a: Vector, b: Vector, s: Real) -> Matrix:
    """A − s a bᵀ."""
    b = scale(s, b)
    return minus(A, (scale(a[0], b), scale(a[1], b), scale(a[2], b)))


def skew(a: Vector) -> Matrix:
    """The matrix a× of the cross product."""
    return (0.0, -1.0 * a[2], a[1]), (a[2], 0.0, -1.0 * a[0]), (-1.0 * a[1], a[0], 0.0)


def turned(R: Matrix, axis: int, c: Real, s: Real) -> Matrix:
    """R times the rotation about a coordinate axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    columns = list(transposed(R))
    columns[j], columns[k] = (
        add(scale(c, columns[j]), scale(s, columns[k])),
        add(scale(c, columns[k]), scale(-1.0 * s, columns[j])),
    )
    return transposed((columns[0], columns[1], columns[2]))
