"""Intervals by profile: a number is held beside its best value, all others are fitted anew.

    √(2 (cost(x) − cost)) = half of the interval / standard deviation that white noise would leave

holds at its ends where the sum of squares is a parabola; where it is not, the ends lie where it says.
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
from flexlink.identification.fitted import Estimate
from flexlink.identification.solve import Found, Search


def profiled(search: Search, best: Found, numbers: Sequence[Estimate], tell: Callable[[str], None]) -> list[Estimate]:
    """The numbers of the scene, each with its interval by profile; nan is an end that the profile does not reach."""
    least, white = search.cost(best.x, best.blocks), np.sqrt(np.diag(search.covariance(best.x, best.blocks)))
    found = []
    for k, one in enumerate(numbers):
        ends = tuple(_end(search, best, k, one, side, least, float(white[k])) for side in (-1, 1))
        found.append(dataclasses.replace(one, profile=(ends[0], ends[1])))
        tell(f"profile of {one.name}: {ends[0]:.6g} … {ends[1]:.6g}")
    return found


def widened(search: Search, best: Found, numbers: Sequence[Estimate]) -> list[Estimate]:
    """The numbers of the scene, intervals as wide as the sum of squares says where that is no parabola.

    An end where it has hardly risen is moved outwards until it has. A start outside is tried with all others fitted
    anew; where the data do not reject it, that end is moved on to the first point that they do reject.
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
    """The sum of squares beside its least."""

    def __init__(self, search: Search, best: Found) -> None:
        self.search, self.best = search, best
        self.least, self.unlikely = search.cost(best.x, best.blocks), 0.0
        if search.coloured:
            self.unlikely = search.unlikelihood(best.x, best.blocks)
        self.C = search.covariance(best.x, best.blocks)

    def rise(self, x: Array) -> float:
        """How much twice the cost is above its least; noise may be another one there, too."""
        rise = 2 * (self.search.cost(x, self.best.blocks) - self.least)
        if not self.search.coloured or rise <= 0:
            return rise
        try:
            return min(rise, self.search.unlikelihood(x, self.best.blocks) - self.unlikely)
        except FlexlinkError:  # the scene does not run there
            return math.inf

    def wanted(self, k: int, end: float) -> float:
        """What a parabola rises by up to an end, a value of the number."""
        return (self.search.coordinates[k].x(end) - float(self.best.x[k])) ** 2 / float(self.C[k, k])

    def far(self, k: int, one: Estimate, side: int) -> float | None:
        """An end farther out, the others where a parabola has them; None where the interval's own will do."""
        hardly = 0.5  # part of a parabola's rise
        wanted = hardly * self.wanted(k, _end_of(one, side))

        def rejected(times: float) -> bool:
            return not self.rise(self.beside(k, one, side, times)) < wanted

        if rejected(1.0):
            return None
        return self.search.coordinates[k].value(float(self.beside(k, one, side, _rejected(rejected, OUTWARDS))[k]))

    def beside(self, k: int, one: Estimate, side: int, times: float = 1.0) -> Array:
        """An end, so many times as far out, the others where a parabola has them."""
        half = self.search.coordinates[k].x(_end_of(one, side)) - float(self.best.x[k])
        bounds = np.array([each.bounds for each in self.search.coordinates]).T
        return np.asarray(np.clip(self.best.x + half * times * self.C[:, k] / self.C[k, k], *bounds))

    def beyond_start(self, k: int, one: Estimate) -> float | None:
        """The first value that the data reject, from a number's start on; None where they reject the start."""
        furthest = 10.0  # halves of an interval beyond which a start is rejected
        coordinate, x = self.search.coordinates[k], float(self.best.x[k])
        wanted, start = self.wanted(k, one.low if one.start < one.value else one.high), coordinate.x(one.start)
        if self.wanted(k, one.start) > furthest**2 * wanted or self.rejects(k, start, wanted):
            return None

        places = np.clip(x + np.array(OUTWARDS) * (start - x), *coordinate.bounds).tolist()
        return coordinate.value(
            _rejected(lambda at: at in coordinate.bounds or self.rejects(k, at, wanted), places, HALVINGS)
        )

    def rejects(self, k: int, at: float, wanted: float) -> bool:
        """Whether the sum of squares is too large with a number held there, all others fitted anew."""
        point = self.best.x.copy()
        point[k] = at
        return not self.rise(self.search.least(point, self.best.blocks, rough=True, held=k)) < wanted


OUTWARDS = tuple(1.5**k for k in range(7))
"""How many times as far out as an end others are tried."""
HALVINGS = 3
"""How often the part is halved in which an end beyond a start lies."""


def _rejected(rejected: Callable[[float], bool], places: Sequence[float], halvings: int = 0) -> float:
    """The first of places, farther and farther out, that is rejected, and between it and the one before by halving.

    The first place is not rejected; the last one is taken where none is.
    """
    for inside, place in itertools.pairwise(places):  # noqa: B007  where it ended
        if rejected(place):
            break
    else:
        inside = place
    for _ in range(halvings):
        middle = (inside + place) / 2
        inside, place = (inside, middle) if rejected(middle) else (middle, place)
    return place


def _end_of(one: Estimate, side: int) -> float:
    return one.high if side > 0 else one.low


def _end(search: Search, best: Found, k: int, one: Estimate, side: int, least: float, white: float) -> float:
    """One end of the interval."""
    at = 0.5, 1.0, 1.6  # places of the profile, in halves of the interval
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
