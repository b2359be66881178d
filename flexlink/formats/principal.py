"""Principal moments and axes of an inertia by Jacobi's method: plane rotations, each of which zeroes one product.

Cyclic by rows (Golub & Van Loan, Matrix Computations, 8.5.4). All sums have a fixed order, so that a file is the same
on every CPU: the last digits of LAPACK, and the axes of nearly equal moments, depend on the BLAS.
"""

from __future__ import annotations

import math

import numpy as np

from flexlink.common.products import dot
from flexlink.common.types import Array


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Moments in ascending order, and the axes as columns of a rotation R: I = R diag(moments) Rᵀ."""
    I, R = np.array(inertia, dtype=float), np.eye(3)
    negligible = np.finfo(float).eps ** 2 * np.abs(I).max()  # of a product that changes neither moments nor axes
    sweeps = 5  # convergence is quadratic from the second on; for equal moments, more sweeps only add up rounding
    for _ in range(sweeps):
        rotated = False
        for j, k in ((0, 1), (0, 2), (1, 2)):
            if abs(I[j, k]) > negligible:
                rotated = True
                _rotate(I, R, j, k)
        if not rotated:
            break
    moments, order = np.diag(I), np.argsort(np.diag(I), kind="stable")
    axes = R[:, order]
    right_handed = dot(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2]) > 0
    return moments[order], axes if right_handed else -axes


def _rotate(I: Array, R: Array, j: int, k: int) -> None:
    """I → Jᵀ I J and R → R J, in place, by the smaller of the angles that make I_jk zero."""
    τ = (I[k, k] - I[j, j]) / (2 * I[j, k])
    t = math.copysign(1.0, τ) / (abs(τ) + math.hypot(1.0, τ))  # tan
    c = 1 / math.hypot(1.0, t)
    s, change = t * c, t * I[j, k]
    ends = I[j, j] - change, I[k, k] + change
    for matrix in (I, I.T, R):  # columns, rows, columns
        matrix[:, j], matrix[:, k] = c * matrix[:, j] - s * matrix[:, k], s * matrix[:, j] + c * matrix[:, k]
    (I[j, j], I[k, k]), I[j, k], I[k, j] = ends, 0.0, 0.0
