"""The dense solvers solve what they say they solve, not only mass matrices."""

from __future__ import annotations

import numpy as np
import pytest

from flexlink.kernels.solve import solve_cholesky, solve_lu

EPS = np.finfo(float).eps


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_lu_exchanges_rows_where_a_pivot_is_zero_small_or_negative(n: int, rng: np.random.Generator) -> None:
    """Partial pivoting: the residual is some roundings of |A| |x|, whatever the order and the sign of the rows."""
    zero, signs = np.roll(np.eye(n), 1, axis=0), -np.eye(n) + 1e-9 * rng.normal(size=(n, n))
    small = rng.normal(size=(n, n))
    small[0, 0] *= 1e-14
    for A in (zero, signs, small, rng.normal(size=(n, n))):
        b = rng.normal(size=n)
        x = b.copy()
        solve_lu(A.copy(), x)
        assert np.abs(A @ x - b).max() <= 10 * n * EPS * (np.abs(A) @ np.abs(x)).max()


@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_cholesky_solves_any_positive_definite_system(n: int, rng: np.random.Generator) -> None:
    B = rng.normal(size=(n, n))
    A, b = B @ B.T + 0.1 * np.eye(n), rng.normal(size=n)
    x = b.copy()
    solve_cholesky(A.copy(), x)
    assert np.abs(A @ x - b).max() <= 10 * n * EPS * (np.abs(A) @ np.abs(x)).max()
