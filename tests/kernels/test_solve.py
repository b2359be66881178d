"""The dense solvers solve all documented systems, not only those of mass matrices."""

import numpy as np
import pytest

from flexlink.kernels.tools.solve import solve_cholesky, solve_lu

EPS = np.finfo(float).eps


def positive_definite(n: int, rng: np.random.Generator) -> np.ndarray:
    B = rng.normal(size=(n, n))
    return B @ B.T + 0.1 * np.eye(n)


@pytest.mark.parametrize("solve", [solve_lu, solve_cholesky])
@pytest.mark.parametrize("n", [1, 2, 5, 12])
def test_dense_solvers_solve_any_positive_definite_system(solve, n: int, rng: np.random.Generator) -> None:
    A, b = positive_definite(n, rng), rng.normal(size=n)
    x = b.copy()
    solve(A.copy(), x, np.empty((3, n)))
    assert np.abs(A @ x - b).max() <= 10 * n * EPS * (np.abs(A) @ np.abs(x)).max()


@pytest.mark.parametrize("n", [2, 5, 12])
def test_lu_exchanges_rows_where_a_pivot_is_small(n: int, rng: np.random.Generator) -> None:
    """Without the exchange, or with signed comparison, a relative pivot of 1e-10 leaves six digits in the residual."""
    A, b = positive_definite(n, rng), rng.normal(size=n)
    A[0, 0], A[1:, 0] = 1e-10, -np.abs(A[1:, 0])  # no longer a mass matrix: only its diagonal must be positive
    x = b.copy()
    solve_lu(A.copy(), x, np.empty((3, n)))
    residual = np.abs(A @ x - b)
    assert (residual <= 10 * n * EPS * (np.abs(A) @ np.abs(x)).max()).all()  # also False for nan


@pytest.mark.parametrize("solve", [solve_lu, solve_cholesky])
def test_a_matrix_singular_to_rounding_has_no_solution(solve) -> None:
    A, b = np.array([[1.0, 1.0], [1.0, 1.0 + EPS]]), np.array([1.0, 2.0])
    solve(A, b, np.empty((3, 2)))
    assert np.isnan(b).all()
