"""Rest-to-rest motion profiles in closed form: s(t) from 0 to 1, and the shortest duration within limits.

The trapezoidal speed profile is the S-curve with unlimited jerk, so one algorithm handles both.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array


class Quintic(NamedTuple):
    """Move from 0 to 1 by one polynomial of degree 5, with zero rate and acceleration at both ends."""

    duration: float  # s

    def lasting(self, duration: float) -> "Quintic":
        """The same shape with another duration."""
        return Quintic(duration)

    @property
    def pieces(self) -> tuple[Array, Array]:
        """Knots [s], shape (3,), starting at 0, and polynomial coefficients of the two pieces, shape (2, 6)."""
        # s = 10 x³ − 15 x⁴ + 6 x⁵, x = t/T, expanded about 0 and about 1/2, which avoids cancellation at the end
        s = np.array([(0.0, 0.0, 0.0, 10.0, -15.0, 6.0), (0.5, 1.875, 0.0, -5.0, 0.0, 6.0)])
        return self.duration * np.array([0.0, 0.5, 1.0]), s / self.duration ** np.arange(6)


class Ramps(NamedTuple):
    """Move from 0 to 1 with two speed ramps, each made of phases t_j, t_a and t_j, and a cruise t_v between the ramps.

    Jerk is constant in each phase t_j, acceleration in t_a and speed in t_v.
    """

    jerk: float  # t_j, duration of a phase of constant jerk [s]
    acceleration: float  # t_a, duration of a phase of constant acceleration [s]
    cruise: float  # t_v, duration of constant speed [s]

    @property
    def duration(self) -> float:
        """Duration of the complete move [s]."""
        return 4 * self.jerk + 2 * self.acceleration + self.cruise

    def lasting(self, duration: float) -> "Ramps":
        """The same shape with another duration."""
        by = duration / self.duration
        return Ramps(self.jerk * by, self.acceleration * by, self.cruise * by)

    @property
    def pieces(self) -> tuple[Array, Array]:
        """Knots [s], starting at 0, and cubic coefficients of each phase; phases of zero length are left out."""
        t_j, t_a, t_v = self
        A = 1 / ((t_j + t_a) * (2 * t_j + t_a + t_v))
        j = A / t_j if t_j else 0.0
        v1, V = A * t_j / 2, A * (t_j + t_a)
        v2 = v1 + A * t_a
        s1, s3 = A * t_j**2 / 6, V * (2 * t_j + t_a) / 2
        s2 = s1 + v1 * t_a + A * t_a**2 / 2
        starts = np.array([
            [0.0, s1, s2, s3, 1 - s3, 1 - s2, 1 - s1],
            [0.0, v1, v2, V, V, v2, v1],
            [0.0, A / 2, A / 2, 0.0, 0.0, -A / 2, -A / 2],
            [j / 6, 0.0, -j / 6, 0.0, -j / 6, 0.0, j / 6],
        ])  # fmt: skip
        lengths = np.array([t_j, t_a, t_j, t_v, t_j, t_a, t_j])
        there = lengths > 0
        return np.concatenate([[0.0], np.cumsum(lengths[there])]), starts[:, there].T


Shape = Quintic | Ramps
Limits = tuple[float, float, float]  # largest rate, acceleration and jerk of a joint; inf if unlimited


def fastest_quintic(distance: float, limits: Limits) -> Quintic:
    """Return the fastest quintic over a distance > 0 within limits."""
    peaks = 15 / 8, 10 / math.sqrt(3), 60.0  # largest s' T, s'' T², s''' T³
    parts = [peak * distance / limit for peak, limit in zip(peaks, limits, strict=True)]
    return Quintic(max(part ** (1 / order) for order, part in enumerate(parts, 1)))


def fastest_ramps(distance: float, limits: Limits) -> Ramps:
    """Return the fastest S-curve over a distance D > 0 within limits v, a, j; with j = inf the fastest trapezoid.

    The peak acceleration A is a, or less if jerk j cannot reach a within rate v or distance D. t_a follows from the
    ramp's final speed A (t_j + t_a) ≤ v and from the distance of both ramps A (t_j + t_a)(2 t_j + t_a) ≤ D.
    """
    v, a, j = limits
    A = min(a, math.sqrt(v) * math.sqrt(j), math.cbrt(distance / 2) * math.cbrt(j) ** 2)
    t_j = A / j
    by_speed = v / A - t_j
    by_distance = (math.sqrt(t_j * t_j + 4 * distance / A) - 3 * t_j) / 2
    t_a = max(0.0, min(by_speed, by_distance))
    t_v = distance / A / (t_j + t_a) - (2 * t_j + t_a)
    return Ramps(t_j, t_a, max(0.0, t_v) if by_speed < by_distance else 0.0)


MOVES: dict[str, tuple[Shape, Callable[[float, Limits], Shape]]] = {
    "quintic": (Quintic(1.0), fastest_quintic),
    "trapezoidal": (Ramps(0.0, 1 / 3, 1 / 3), fastest_ramps),
    "s_curve": (Ramps(1 / 9, 1 / 9, 1 / 3), fastest_ramps),
}
"""For each profile, its move from 0 to 1 and the function for its fastest move. Speeding up, cruising and braking take
a third of the move each; in an S-curve, acceleration rises, stays constant and falls for a third of each speed ramp."""


def quintics(times: Sequence[float], rows: Array) -> Array:
    """Quintic pieces through rows of value, rate and acceleration, followed by a piece with the final rate."""
    pieces = np.zeros((len(times), 6))
    if len(times) > 1:
        from scipy.interpolate import BPoly, PPoly  # noqa: PLC0415  0.1 s that few scenes need

        pieces[:-1] = PPoly.from_bernstein_basis(BPoly.from_derivatives(times, rows)).c[::-1].T
    pieces[-1, :2] = rows[-1, :2]
    return pieces
