"""Piecewise polynomial angles over time, which can be evaluated, combined, delayed and summed exactly.

On piece i, from knot i to the next, r = Σ_j c_ij x^j with x = t − knot_i; the last piece has no end, and x = 0 before
the first knot. The first and the last piece are constant, so a trajectory starts and ends at rest.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.numbers import numbers


@dataclasses.dataclass(frozen=True, eq=False)
class ReferenceTrajectory:
    """Desired angles over time as piecewise polynomials; calling it with times returns angle, rate and acceleration.

    Attributes
    ----------
    knots
        Start times of the pieces [s], increasing, shape (m,).
    coefficients
        c_ij of every angle, shape (m, degree + 1, d) [rad/s^j]; 0 for j > 0 in the first and last piece.

    Raises
    ------
    ArgumentError
        Shapes do not match, a number is not finite, knots do not increase, or the first or last piece is not constant.

    Examples
    --------
    >>> course = scene.course  # of the drive's reference
    >>> angle, rate, acceleration = course([0.0, 0.25, 0.5])  # rad, rad/s, rad/s²
    >>> print(np.degrees(angle[:, 0]).round(1), course.knots)
    [30. 45. 60.] [-1.    0.    0.25  0.5 ]
    """

    knots: Array
    coefficients: Array

    def __post_init__(self) -> None:
        for name in ("knots", "coefficients"):
            object.__setattr__(self, name, numbers(name, getattr(self, name)))
        knots, c = self.knots, self.coefficients
        if knots.ndim != 1 or c.ndim != 3 or not len(knots) or len(c) != len(knots) or not c.shape[1]:
            text = f"knots {knots.shape}, coefficients {c.shape}: shapes must be (m,), (m, degree + 1, d)"
            raise ArgumentError(text, id="wrong-shape")
        if not (np.isfinite(knots).all() and np.isfinite(c).all()):
            text = "knots, coefficients: not finite; the angle changes so fast that its rate overflows float64"
            raise ArgumentError(text, id="overflow")
        if np.any(np.diff(knots) <= 0):
            k = int(np.argmax(np.diff(knots) <= 0))
            text = f"knots[{k + 1}] = {knots[k + 1]!r}: must be later than the previous one, {knots[k]!r}"
            raise ArgumentError(text, id="times-not-increasing")
        if c[0, 1:].any() or c[-1, 1:].any():
            why = "coefficients: the first and the last piece must be constant (start and end at rest)"
            raise ArgumentError(why, id="not-at-rest")
        knots.flags.writeable = c.flags.writeable = False

    def __call__(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Angle [rad], rate [rad/s] and acceleration [rad/s²] at times t [s], each of shape (*t.shape, d)."""
        times = numbers("t", t)
        c, x = self._located(times.ravel())
        angle, rate, half = np.zeros((3, len(c), c.shape[2]))
        for j in range(c.shape[1] - 1, -1, -1):  # Horner's scheme for the value and its first two derivatives
            half = half * x + rate
            rate = rate * x + angle
            angle = angle * x + c[:, j]
        shape = *times.shape, c.shape[2]
        return angle.reshape(shape), rate.reshape(shape), (2.0 * half).reshape(shape)

    def __repr__(self) -> str:
        m, p, d = self.coefficients.shape
        first, last = self.knots[0], self.knots[-1]
        return f"<ReferenceTrajectory of {d} angles: {m} pieces of degree {p - 1}, {first:g} to {last:g} s>"

    def restated(self, knots: Array) -> Array:
        """Return the coefficients about other knots; each new piece must lie within a piece of this trajectory.

        The shift r(x₀ + x) is computed by repeated synthetic division; the result has shape (knots, degree + 1, d).
        """
        c, x = self._located(knots)
        for j in range(c.shape[1] - 1):
            for k in range(c.shape[1] - 2, j - 1, -1):
                c[:, k] += x * c[:, k + 1]
        return c

    def delayed(self, delay: float) -> "ReferenceTrajectory":
        """The same trajectory, later by `delay` [s]."""
        return ReferenceTrajectory(self.knots + numbers("delay", delay), self.coefficients)

    def shaped(self, times: ArrayLike, weights: ArrayLike) -> "ReferenceTrajectory":
        """Apply an input shaper: return Σ_i a_i r(t − t_i), with `times` t_i [s] and `weights` a_i of its impulses.

        Raises
        ------
        ArgumentError
            Times and weights are not lists of equal length, a number is not finite, or there are too many pieces.

        Examples
        --------
        >>> shaper = fl.InputShaper(kind="ZV", frequency_hz=(2.0,))
        >>> print(scene.course.shaped(*shaper.impulses).knots[-1])  # s, later by half a period
        0.75
        """
        t, a = numbers("times", times), numbers("weights", weights)
        if t.ndim != 1 or t.shape != a.shape or not len(t) or not (np.isfinite(t).all() and np.isfinite(a).all()):
            text = f"times, weights: shapes {t.shape}, {a.shape}; expected finite numbers of equal shape (k,), k > 0"
            raise ArgumentError(text, id="wrong-shape")
        most = 100_000  # largest number of pieces; more would take minutes and gigabytes
        if len(t) * len(self.knots) > most:
            text = f"{len(t)} impulses on {len(self.knots)} pieces give {len(t) * len(self.knots)}; at most {most}"
            raise ArgumentError(text, id="too-many-impulses")
        copies = [self.delayed(delay) for delay in t]
        knots = common_knots(copies)
        parts = (weight * copy.restated(knots) for weight, copy in zip(a, copies, strict=True))
        return ReferenceTrajectory(knots, sum(parts))

    def extremes(self) -> tuple[Array, Array]:
        """Smallest and largest angles over all time [rad], shape (d,) each, at knots or at extrema within pieces."""
        low, high = self._extremes
        return low.copy(), high.copy()

    @functools.cached_property
    def _extremes(self) -> tuple[Array, Array]:
        lengths, powers = np.diff(self.knots)[:, None, None], np.arange(self.coefficients.shape[1])[:, None]
        c = self.coefficients[:-1] * lengths**powers
        at_knots = np.concatenate([self.coefficients[:, 0], c.sum(axis=1)])  # values at both ends of each piece
        low, high = at_knots.min(axis=0), at_knots.max(axis=0)
        hull = np.einsum("ij,kjd->kid", _to_bernstein(c.shape[1] - 1), c)  # these numbers bound all values of a piece
        rounded = 2.0**-48 * np.abs(c).sum(axis=1)
        beyond = (hull.min(axis=1) < low - rounded) | (hull.max(axis=1) > high + rounded)
        for piece, d in zip(*np.nonzero(beyond), strict=True):
            angle = np.polynomial.Polynomial(c[piece, :, d])
            inside = angle(np.clip(angle.deriv().roots().real, 0.0, 1.0))
            low[d], high[d] = np.min(inside, initial=low[d]), np.max(inside, initial=high[d])
        return low, high

    @property
    def jumps(self) -> Array:
        """Knots [s] at which an angle or a rate jumps by more than rounding error."""
        c, x = self.coefficients, np.diff(self.knots)[:, None]
        powers = np.arange(c.shape[1])[:, None, None]
        jump = np.zeros(len(self.knots) - 1, dtype=bool)
        for _ in range(2):
            terms = c[:-1].transpose(1, 0, 2) * x ** powers[: c.shape[1]]
            scale = np.abs(terms).sum(axis=0).max(axis=0, initial=0.0) + np.abs(c[:, 0]).max(axis=0)
            jump |= np.any(np.abs(c[1:, 0] - terms.sum(axis=0)) > 1e-9 * scale, axis=1)
            c = c[:, 1:] * powers[1 : c.shape[1], 0] if c.shape[1] > 1 else np.zeros_like(c)
        return self.knots[1:][jump]

    def _located(self, t: Array) -> tuple[Array, Array]:
        """Coefficients of the pieces at times t, shape (len(t), degree + 1, d), and x at these times, (len(t), 1)."""
        piece = np.maximum(np.searchsorted(self.knots, t, side="right") - 1, 0)
        return self.coefficients[piece], np.maximum(t - self.knots[piece], 0.0)[:, None]


@functools.cache
def _to_bernstein(degree: int) -> Array:
    """Matrix from power to Bernstein coefficients on [0, 1]; these enclose the polynomial (Farouki 2012)."""
    row = range(degree + 1)
    return np.array([[math.comb(i, j) / math.comb(degree, j) for j in row] for i in row])


def still(angles: ArrayLike) -> ReferenceTrajectory:
    """A trajectory at rest at these angles (d,) [rad]."""
    return ReferenceTrajectory(np.zeros(1), np.array(angles, dtype=np.float64)[None, None])


def from_rest_to_rest(knots: Array, moving: Array, end: Array) -> ReferenceTrajectory:
    """A trajectory at rest, then on pieces (m, degree + 1, d) between knots (m + 1,), then at rest at `end` (d,)."""
    rest = np.zeros((2, *moving.shape[1:]))
    rest[0, 0], rest[1, 0] = moving[0, 0], end
    before = knots[0] - max(1.0, abs(knots[0]))
    return ReferenceTrajectory(np.concatenate([[before], knots]), np.concatenate([rest[:1], moving, rest[1:]]))


def side_by_side(courses: Sequence[ReferenceTrajectory]) -> ReferenceTrajectory:
    """Combine trajectories into one that has all their angles, on common knots."""
    if not courses:
        return still([])
    knots = common_knots(courses)
    parts = [course.restated(knots) for course in courses]
    order = max(part.shape[1] for part in parts)
    padded = [np.pad(c, ((0, 0), (0, order - c.shape[1]), (0, 0))) for c in parts]
    return ReferenceTrajectory(knots, np.concatenate(padded, axis=2))


def common_knots(courses: Sequence[ReferenceTrajectory]) -> Array:
    """Merge the knots of trajectories: return the earliest first knot, then the later knots, each once."""
    later = np.unique(np.concatenate([course.knots[1:] for course in courses]))
    return np.concatenate([[min(course.knots[0] for course in courses)], later[distinct(later)]])


def distinct(knots: Array) -> NDArray[np.bool_]:
    """Whether each knot differs from the next by more than the rounding errors of summed delays."""
    return np.asarray(np.diff(knots, append=np.inf) > 16 * np.finfo(float).eps * np.abs(knots).max(initial=0.0))
