"""Runge-Kutta methods in mpmath with exact coefficients, for q̈ = f(q, q̇).

The stages of an implicit method are found by fixed-point iteration, stage by stage. The iteration converges for the
small steps with which an order is measured.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpmath import mp, mpf

from flexlink.describe.schemes.methods import Method
from validation.oracles.rooted_trees import as_mpf

Vector = list[Any]

SOLVED, MOST_PASSES = mpf("1e-30"), 200
"""Largest relative change of the stage derivatives at convergence, far below measured errors; iteration limit."""


def integrate(
    acceleration: Callable[[Vector, Vector], Vector],
    method: Method,
    state: tuple[Sequence[Any], Sequence[Any]],
    duration: Any,
    steps: int,
) -> tuple[Vector, Vector]:
    """q and q̇ after `duration` [s] in equal steps, in mpmath's working precision; stages converge to `SOLVED`.

    Raises
    ------
    ArithmeticError
        The iteration of implicit stages does not converge; the step is too large.
    """
    exact = method.exact
    A, b = [[as_mpf(x) for x in row] for row in exact[0]], [as_mpf(x) for x in exact[1]]
    h = mpf(duration) / steps
    y = [mpf(x) for part in state for x in part]
    n = len(y) // 2

    def slope(weights: Vector, slopes: list[Vector]) -> Vector:
        stage = _combine(y, h, weights, slopes)
        return stage[n:] + acceleration(stage[:n], stage[n:])

    for _step in range(steps):
        slopes: list[Vector] = []
        for row in A:
            slopes.append(slope(row, slopes))
        if not method.explicit:
            _solve(A, slopes, slope)
        y = _combine(y, h, b, slopes)
    return y[:n], y[n:]


def _solve(A: list[Vector], slopes: list[Vector], slope: Callable[[Vector, list[Vector]], Vector]) -> None:
    """Solve for the derivatives of all stages by fixed-point iteration, in place and from any initial guess."""
    for _pass in range(MOST_PASSES):
        moved = mpf(0)
        for i, row in enumerate(A):
            before, slopes[i] = slopes[i], slope(row, slopes)
            moved = max(moved, _size([x - y for x, y in zip(slopes[i], before, strict=True)]) / _size(slopes[i]))
        if moved < SOLVED:
            return
    raise ArithmeticError(f"the implicit stages have not converged in {MOST_PASSES} passes; use a smaller step")


def _size(x: Vector) -> Any:
    return max(map(abs, x))


def _combine(y: Vector, h: Any, weights: Vector, slopes: list[Vector]) -> Vector:
    """y + h Σ_j weights_j slopes_j, over the available derivatives."""
    used = [(h * w, k) for w, k in zip(weights, slopes, strict=False) if w]
    return [x + mp.fsum(w * k[i] for w, k in used) for i, x in enumerate(y)]
