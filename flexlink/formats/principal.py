"""Principal moments and axes of an inertia by Jacobi's method: plane rotations, each of which zeroes one product.

Cyclic by rows (Golub & Van Loan, Matrix Computations, 8.5.4). Of sums in the order in which they are written, so that a
file is the same whichever CPU has written it: LAPACK's last digits, and the axes of moments that are nearly equal,
depend on the kernels of the BLAS below it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexlink.common.products import dot

Array = NDArray[np.float64]

NEGLIGIBLE = np.finfo(float).eps ** 2
"""Product of inertia, of the largest element, that moves neither moments nor axes any more."""

SWEEPS = 5
"""At most; the fifth finds nothing left, as convergence is quadratic from the second on. Of equal moments the products
are rounding, which another sweep makes anew: more of them only add up."""


def principal_axes(inertia: Array) -> tuple[Array, Array]:
    """Moments, the least one first, and the axes as the columns of a rotation R: I = R diag(moments) Rᵀ."""
    I, R = np.array(inertia, dtype=float), np.eye(3)
    negligible = NEGLIGIBLE * np.abs(I).max()
    for _ in range(SWEEPS):
        turned = False
        for j, k in ((0, 1), (0, 2), (1, 2)):
            if abs(I[j, k]) > negligible:
                turned = True
                _turn(I, R, j, k)
        if not turned:
            break
    moments, order = np.diag(I), np.argsort(np.diag(I), kind="stable")
    axes = R[:, order]
    right_handed = dot(np.cross(axes[:, 0], axes[:, 1]), axes[:, 2]) > 0
    return moments[order], axes if right_handed else -axes


def _turn(I: Array, R: Array, j: int, k: int) -> None:
    """I → Jᵀ I J and R → R J, in place, by the smaller of the angles that make I_jk zero."""
    τ = (I[k, k] - I[j, j]) / (2 * I[j, k])
    t = math.copysign(1.0, τ) / (abs(τ) + math.hypot(1.0, τ))  # tan
    c = 1 / math.hypot(1.0, t)
    s, change = t * c, t * I[j, k]
    ends = I[j, j] - change, I[k, k] + change
    for matrix in (I, I.T, R):  # columns, rows, columns
        matrix[:, j], matrix[:, k] = c * matrix[:, j] - s * matrix[:, k], s * matrix[:, j] + c * matrix[:, k]
    (I[j, j], I[k, k]), I[j, k], I[k, j] = ends, 0.0, 0.0
