"""Profile intervals: one parameter is fixed at values near its estimate, and all others are refitted.

    √(2 (cost(x) − least cost)) = half of the interval / standard deviation with white noise

defines the ends of the interval; for a quadratic cost, they equal the ends of the linear estimate's interval.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.estimate import Estimate
from flexlink.identification.solve import Found, Search


def profiled(search: Search, best: Found, numbers: Sequence[Estimate], report: Callable[[str], None]) -> list[Estimate]:
    """Estimates of the scene's parameters with profile intervals; an end beyond the range of the profile is nan."""
    least, white = search.cost(best.x, best.blocks), np.sqrt(np.diag(search.at(best.x, best.blocks).covariance))
    found = []
    for k, one in enumerate(numbers):
        ends = list[float]()
        for side in (-1, 1):
            search.watch(f"profile {2 * k + len(ends) + 1} of {2 * len(numbers)}")
            ends.append(_end(search, best, k, one, side, least, float(white[k])))
        found.append(dataclasses.replace(one, profile=(ends[0], ends[1])))
        report(f"profile of {one.name}: {ends[0]:.6g} … {ends[1]:.6g}")
    return found


def widened(search: Search, best: Found, numbers: Sequence[Estimate]) -> list[Estimate]:
    """Estimates of the scene's parameters with wider intervals where the cost is not quadratic.

    An end at which the cost has hardly increased is moved outwards. If the initial guess is outside the interval, the
    fit is repeated with the parameter fixed at this guess. If the data do not reject the guess, the end is moved beyond
    it, to the first value that the data reject.
    """
    floor, found = _Floor(search, best), []
    search.signals.ahead([floor.beside(k, one, side) for k, one in enumerate(numbers) for side in (-1, 1)])
    for k, one in enumerate(numbers):
        far = {side: floor.far(k, one, side) for side in (-1, 1)}
        low, high = (one.low if far[-1] is None else far[-1]), (one.high if far[1] is None else far[1])
        if not low <= one.start <= high:
            end = floor.beyond_start(k, one)
            low, high = (low, high) if end is None else (min(low, end), max(high, end))
        wider = (low, high) != (one.low, one.high)
        found.append(dataclasses.replace(one, low=low, high=high, widened=wider))
    return found


class _Floor:
    """Increase of the cost around its minimum, and the points at which it reaches the ends of intervals."""

    def __init__(self, search: Search, best: Found) -> None:
        self.search, self.best = search, best
        self.least, self.unlikely = search.cost(best.x, best.blocks), 0.0
        if search.coloured:
            self.unlikely = search.unlikelihood(best.x, best.blocks)
        self.C = search.at(best.x, best.blocks).covariance

    def rise(self, x: Array) -> float:
        """Increase of twice the cost from its minimum or, if smaller, the likelihood ratio with the noise refitted."""
        rise = 2 * (self.search.cost(x, self.best.blocks) - self.least)
        if not self.search.coloured or rise <= 0:
            return rise
        try:
            return min(rise, self.search.unlikelihood(x, self.best.blocks) - self.unlikely)
        except FlexlinkError:  # the simulation fails
            return math.inf

    def wanted(self, k: int, end: float) -> float:
        """Increase of twice the cost up to an end of the interval if the cost were quadratic."""
        return (self.search.coordinates[k].x(end) - float(self.best.x[k])) ** 2 / float(self.C[k, k])

    def far(self, k: int, one: Estimate, side: int) -> float | None:
        """An end farther out, with other parameters moved along the linear estimate; None if no wider end is needed."""
        hardly = 0.5  # smallest sufficient increase of the cost, relative to the increase of a quadratic cost
        wanted = hardly * self.wanted(k, _end_of(one, side))

        def rejected(times: float) -> bool:
            return not self.rise(self.beside(k, one, side, times)) < wanted

        if rejected(1.0):
            return None
        return self.search.coordinates[k].value(float(self.beside(k, one, side, _rejected(rejected, OUTWARDS))[k]))

    def beside(self, k: int, one: Estimate, side: int, times: float = 1.0) -> Array:
        """Point at `times` the distance to an end, with the other parameters moved along the linear estimate."""
        half = self.search.coordinates[k].x(_end_of(one, side)) - float(self.best.x[k])
        bounds = np.array([each.bounds for each in self.search.coordinates]).T
        return np.asarray(np.clip(self.best.x + half * times * self.C[:, k] / self.C[k, k], *bounds))

    def beyond_start(self, k: int, one: Estimate) -> float | None:
        """First value beyond the initial guess that the data reject; None if they reject the initial guess."""
        furthest = 10.0  # an initial guess is rejected beyond this many half-widths of the interval
        coordinate, x = self.search.coordinates[k], float(self.best.x[k])
        wanted, start = self.wanted(k, one.low if one.start < one.value else one.high), coordinate.x(one.start)
        if self.wanted(k, one.start) > furthest**2 * wanted or self.rejects(k, start, wanted):
            return None

        values = np.clip(x + np.array(OUTWARDS) * (start - x), *coordinate.bounds).tolist()
        return coordinate.value(
            _rejected(lambda at: at in coordinate.bounds or self.rejects(k, at, wanted), values, HALVINGS)
        )

    def rejects(self, k: int, at: float, wanted: float) -> bool:
        """Whether the cost is too large with one parameter fixed and all others refitted."""
        point = self.best.x.copy()
        point[k] = at
        return not self.rise(self.search.least(point, self.best.blocks, rough=True, held=k)) < wanted


OUTWARDS = tuple(1.5**k for k in range(7))
"""Distances from the estimate at which ends are tried, relative to the end of the linear estimate's interval."""
HALVINGS = 3
"""Number of bisections for an end beyond the initial guess."""


def _rejected(rejected: Callable[[float], bool], values: Sequence[float], halvings: int = 0) -> float:
    """First rejected value of a sequence moving outwards, refined by bisection; the last value if none is rejected.

    The first value is assumed not to be rejected.
    """
    for inside, value in itertools.pairwise(values):  # noqa: B007  used after the loop
        if rejected(value):
            break
    else:
        inside = value
    for _ in range(halvings):
        middle = (inside + value) / 2
        inside, value = (inside, middle) if rejected(middle) else (middle, value)
    return value


def _end_of(one: Estimate, side: int) -> float:
    return one.high if side > 0 else one.low


def _end(search: Search, best: Found, k: int, one: Estimate, side: int, least: float, white: float) -> float:
    """One end of a profile interval."""
    at = 0.5, 1.0, 1.6  # distances of the profile's points from the estimate, in half-widths of the interval
    coordinate, x = search.coordinates[k], best.x
    half = abs(coordinate.x(_end_of(one, side)) - float(x[k]))
    low, high = coordinate.bounds
    heights, point = [0.0], x.copy()
    for part in at:
        point[k] = float(x[k]) + side * part * half
        if not low <= point[k] <= high:
            return math.nan
        point = search.least(point, best.blocks, held=k)
        heights.append(math.sqrt(max(2 * (search.cost(point, best.blocks) - least), 0.0)))
    wanted = half / white
    if not (np.diff(heights) > 0).all() or heights[-1] < wanted:
        return math.nan
    distance = float(scipy.interpolate.PchipInterpolator(heights, (0.0, *at))(wanted))
    return coordinate.value(float(x[k]) + side * half * distance)
