"""Profile intervals: one parameter is fixed at values near its estimate, and all others are refitted.

    √(2 (cost(x) − least cost)) = half of the interval / standard deviation with white noise

defines the ends of the interval; for a quadratic cost, they equal the ends of the linear estimate's interval.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.estimate import Estimate
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.solve import Found, Search

OUTWARDS = tuple(1.5**k for k in range(7))
"""Distances from the estimate at which ends are tried, relative to the end of the linear estimate's interval."""
HALVINGS = 3
"""Number of bisections for an end beyond the initial guess."""


class Rise:
    """Increase of the cost from its minimum, and the points at which it reaches the ends of intervals.

    Attributes
    ----------
    search, best
        The search, and its solution.
    C
        Covariance of the coordinates at the solution, for white noise of the assumed size.
    """

    def __init__(self, search: Search, best: Found, at: Likelihood) -> None:
        self.search, self.best, self.C = search, best, at.covariance
        self.least, self.unlikely = search.cost(best.x, best.blocks), 0.0
        if search.coloured:
            self.unlikely = search.unlikelihood(best.x, best.blocks)

    def squares(self, x: Array) -> float:
        """Increase of twice the cost."""
        return 2 * (self.search.cost(x, self.best.blocks) - self.least)

    def rise(self, x: Array) -> float:
        """Increase of twice the cost or, if smaller, the likelihood ratio with the noise refitted."""
        rise = self.squares(x)
        if not self.search.coloured or rise <= 0:
            return rise
        try:
            return min(rise, self.search.unlikelihood(x, self.best.blocks) - self.unlikely)
        except FlexlinkError:  # the simulation fails
            return math.inf

    def refitted(self, k: int, at: float, near: Array, *, rough: bool = False) -> Array:
        """Minimum of the cost near a point, with one parameter fixed."""
        point = near.copy()
        point[k] = at
        return self.search.least(point, self.best.blocks, rough=rough, held=k)

    def half(self, k: int, end: float) -> float:
        """Distance of an end from the estimate."""
        return self.search.coordinates[k].x(end) - float(self.best.x[k])

    def wanted(self, k: int, end: float) -> float:
        """Increase of twice the cost up to an end of the interval if the cost were quadratic."""
        return self.half(k, end) ** 2 / float(self.C[k, k])

    def beside(self, k: int, half: float) -> Array:
        """Point at a distance from the estimate, with the other parameters moved along the linear estimate."""
        bounds = np.array([each.bounds for each in self.search.coordinates]).T
        return np.asarray(np.clip(self.best.x + half * self.C[:, k] / self.C[k, k], *bounds))

    def far(self, k: int, end: float) -> float:
        """An end, moved outwards to where the cost has risen, other parameters moved along the linear estimate."""
        hardly = 0.5  # smallest sufficient increase of the cost, relative to the increase of a quadratic cost
        wanted, half = hardly * self.wanted(k, end), self.half(k, end)

        def rejected(times: float) -> bool:
            return not self.rise(self.beside(k, half * times)) < wanted

        times = first_rejected(rejected, OUTWARDS)
        return end if times is None else self.search.coordinates[k].value(float(self.beside(k, half * times)[k]))

    def beyond_start(self, k: int, one: Estimate) -> float | None:
        """First value beyond the initial guess that the data reject; None if they reject the initial guess."""
        furthest = 10.0  # an initial guess is rejected beyond this many half-widths of the interval
        coordinate, x = self.search.coordinates[k], float(self.best.x[k])
        wanted, start = self.wanted(k, one.low if one.start < one.value else one.high), coordinate.x(one.start)

        def rejected(at: float) -> bool:
            """Whether the cost is too large with one parameter fixed and all others refitted."""
            try:
                return not self.rise(self.refitted(k, at, self.best.x, rough=True)) < wanted
            except FlexlinkError:  # the simulation fails at the first point of the refit
                return True

        if self.wanted(k, one.start) > furthest**2 * wanted:
            return None
        values = np.clip(x + np.array(OUTWARDS) * (start - x), *coordinate.bounds).tolist()
        end = first_rejected(rejected, list(dict.fromkeys(values)), HALVINGS)
        return None if end is None else coordinate.value(end)

    def profile(self, k: int, end: float) -> float:
        """End of a profile interval beside an end of the linear estimate's; nan if it is out of range."""
        parts = 0.5, 1.0, 1.6  # distances of the profile's points from the estimate, in half-widths of the interval
        coordinate, x, half = self.search.coordinates[k], float(self.best.x[k]), self.half(k, end)
        low, high = coordinate.bounds
        heights, point = [0.0], self.best.x
        for part in parts:
            if not low <= x + part * half <= high:
                return math.nan
            point = self.refitted(k, x + part * half, point)
            heights.append(math.sqrt(max(self.squares(point), 0.0)))
        wanted = math.sqrt(self.wanted(k, end))
        if not (np.diff(heights) > 0).all() or heights[-1] < wanted:
            return math.nan
        distance = float(scipy.interpolate.PchipInterpolator(heights, (0.0, *parts))(wanted))
        return coordinate.value(x + half * distance)


def first_rejected(rejected: Callable[[float], bool], values: Sequence[float], halvings: int = 0) -> float | None:
    """First rejected value of a sequence moving outwards, refined by bisection; the last value if none is rejected.

    None if the first value is rejected, so that nothing needs to move.
    """
    at = next((k for k, value in enumerate(values) if rejected(value)), None)
    if not at:
        return None if at == 0 else values[-1]
    inside, value = values[at - 1], values[at]
    for _ in range(halvings):
        middle = (inside + value) / 2
        inside, value = (inside, middle) if rejected(middle) else (middle, value)
    return value


def profiled(rise: Rise, numbers: Sequence[Estimate], report: Callable[[str], None]) -> list[Estimate]:
    """Estimates of the scene's parameters with profile intervals; an end beyond the range of the profile is nan."""
    found = []
    for k, one in enumerate(numbers):
        ends = list[float]()
        for end in (one.low, one.high):
            rise.search.watch(f"profile {2 * k + len(ends) + 1} of {2 * len(numbers)}")
            ends.append(rise.profile(k, end))
        found.append(dataclasses.replace(one, profile=(ends[0], ends[1])))
        report(f"profile of {one.name}: {ends[0]:.6g} … {ends[1]:.6g}")
    return found


def widened(rise: Rise, numbers: Sequence[Estimate]) -> list[Estimate]:
    """Estimates of the scene's parameters with wider intervals where the cost is not quadratic.

    An end at which the cost has hardly increased is moved outwards. If the initial guess is outside the interval, the
    fit is repeated with the parameter fixed at this guess. If the data do not reject the guess, the end is moved beyond
    it, to the first value that the data reject.
    """
    ends = [(k, end) for k, one in enumerate(numbers) for end in (one.low, one.high)]
    rise.search.signals.ahead([rise.beside(k, rise.half(k, end)) for k, end in ends])
    found = []
    for k, one in enumerate(numbers):
        low, high = rise.far(k, one.low), rise.far(k, one.high)
        end = None if low <= one.start <= high else rise.beyond_start(k, one)
        if end is not None:
            low, high = min(low, end), max(high, end)
        wider = (low, high) != (one.low, one.high)
        found.append(dataclasses.replace(one, low=low, high=high, widened=wider))
    return found
