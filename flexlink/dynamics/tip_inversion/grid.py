"""Times at which the inverse is computed: spacing, and how long the torques begin before a move and end after it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array, Complex


class Grid(NamedTuple):
    """Spacing [s], and the numbers of spacings before, within and after a move."""

    spacing: float
    before: int
    points: int
    after: int

    @property
    def rows(self) -> int:
        """Number of times."""
        return self.before + self.points + self.after + 1


def grid_of(zeros: list[tuple[Complex, Complex]], duration: float, n: int) -> Grid:
    """Choose the times for a move of n coordinates from zeros at its start, middle and end, with and without damping.

    Zeros on the imaginary axis would let the springs vibrate with the tip at rest. Those that are much faster than the
    move are left unresolved, so that the springs follow quasi-statically.

    Raises
    ------
    SceneError
        A zero on the imaginary axis is not faster than the move, or the torques would decay too slowly.
    """
    fastest = 2.46  # |λ| h at the highest frequency that differences of order 6 represent
    fewest = 40  # times that resolve a move
    points = min(200, max(100, 16_000 // n))  # more would resolve zeros of single segments, and cost memory
    oscillating = [z for _, undamped in zeros for z in undamped if abs(z.real) <= 0.1 * abs(z)]
    if oscillating:
        slowest = min(map(abs, oscillating))
        points = min(points, int(duration * slowest / (1.2 * fastest)))
        if points < fewest:
            needed = fewest * 1.2 * fastest / slowest if slowest * duration > 1e-3 else math.inf
            longer = f"a move of {needed:.3g} s or more" if math.isfinite(needed) else "other joints"
            raise SceneError(
                f"tip: with the tip at rest the arm can vibrate at {slowest / (2 * math.pi):.3g} Hz (a transmission "
                f"zero on the imaginary axis), so no bounded torque moves the tip in {duration:g} s; take {longer}, or "
                "less inertia at the tip",
                id="zeros-on-axis",
            )
    h = duration / points
    first, last = (damped[np.abs(damped) * h <= fastest] for damped, _ in (zeros[0], zeros[-1]))
    before, after = _decay(first[first.real > 0].real, h), _decay(-last[last.real < 0].real, h)
    if before + after > 20 * points:
        raise SceneError(
            f"tip: torques would have to begin {before * h:.3g} s before and end {after * h:.3g} s after a move of "
            f"{duration:g} s; take a longer move",
            id="zeros-too-slow",
        )
    return Grid(h, before, points, after)


def _decay(rates: Array, h: float) -> int:
    """Number of spacings after which all exp(−rate t) have decayed to 1e-7, at least 8."""
    slowest = float(rates.min(initial=math.inf))
    return max(8, math.ceil(math.log(1e7) / slowest / h)) if math.isfinite(slowest) and slowest > 0 else 8
