"""Explicit Runge-Kutta in mpmath from the exact coefficients, for q̈ = f(q, q̇)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mpmath import mp, mpf

from flexlink.describe.methods import Method

Vector = list[Any]


def integrate(
    acceleration: Callable[[Vector, Vector], Vector],
    method: Method,
    state: tuple[Sequence[Any], Sequence[Any]],
    duration: Any,
    steps: int,
) -> tuple[Vector, Vector]:
    """q and q̇ after `duration` [s] in equal steps, in mpmath's working precision."""
    exact = method.exact
    A, b = [[_mpf(x) for x in row] for row in exact[0]], [_mpf(x) for x in exact[1]]
    h = mpf(duration) / steps
    y = [mpf(x) for part in state for x in part]
    n = len(y) // 2
    for _step in range(steps):
        slopes: list[Vector] = []
        for row in A:
            stage = _combine(y, h, row, slopes)
            slopes.append(stage[n:] + acceleration(stage[:n], stage[n:]))
        y = _combine(y, h, b, slopes)
    return y[:n], y[n:]


def _combine(y: Vector, h: Any, weights: Vector, slopes: list[Vector]) -> Vector:
    """y + h Σ_j weights_j slopes_j, over the slopes that there are."""
    used = [(h * w, k) for w, k in zip(weights, slopes, strict=False) if w]
    return [x + mp.fsum(w * k[i] for w, k in used) for i, x in enumerate(y)]


def _mpf(x: Any) -> Any:
    return mpf(x.numerator) / x.denominator
