"""Intervals by profile: a number is held beside its best value, all others are fitted anew.

    √(2 (cost(x) − cost)) = half of the interval / standard deviation that white noise would leave

holds at its ends where the sum of squares is a parabola; where it is not, the ends lie where it says.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from scipy.interpolate import PchipInterpolator

from flexlink.identification.fitted import Estimate
from flexlink.identification.solve import Found, Search

FURTHEST = 10.0
"""Halves of an interval beyond which a start is taken for rejected."""
AT = 0.5, 1.0, 1.6
"""Where the profile is taken, in halves of the interval."""


def profiled(search: Search, best: Found, numbers: Sequence[Estimate], tell: Callable[[str], None]) -> list[Estimate]:
    """The numbers of the scene, each with its interval by profile; nan is an end that the profile does not reach."""
    least, white = search.cost(best.x, best.blocks), search.deviations(best.x, best.blocks)
    found = []
    for k, one in enumerate(numbers):
        ends = tuple(_end(search, best, k, one, side, least, float(white[k])) for side in (-1, 1))
        found.append(dataclasses.replace(one, profile=(ends[0], ends[1])))
        tell(f"profile of {one.name}: {ends[0]:.6g} … {ends[1]:.6g}")
    return found


def widened(search: Search, best: Found, numbers: Sequence[Estimate]) -> list[Estimate]:
    """The numbers of the scene, intervals wide enough to hold the starts that the data do not reject.

    A start outside an interval is tried as the profile's ends are: held, all others fitted anew. Where the sum of
    squares is a parabola it is rejected.
    """
    least, white = search.cost(best.x, best.blocks), search.deviations(best.x, best.blocks)
    found = []
    for k, one in enumerate(numbers):
        coordinate, point = search.coordinates[k], best.x.copy()
        point[k] = coordinate.x(one.start)
        if not one.low <= one.start <= one.high:
            end = one.low if one.start < one.value else one.high
            wanted = abs(coordinate.x(end) - float(best.x[k])) / float(white[k])
            if abs(point[k] - float(best.x[k])) > FURTHEST * wanted * float(white[k]):
                found.append(one)
                continue
            point = search.least(point, best.blocks, rough=True, held=k)
            rise = 2 * (search.cost(point, best.blocks) - least)
            if search.coloured:  # a start also has a noise of its own
                rise = min(rise, search.unlikelihood(point, best.blocks) - search.unlikelihood(best.x, best.blocks))
            if rise < wanted**2:
                low, high = min(one.low, one.start), max(one.high, one.start)
                found.append(dataclasses.replace(one, low=low, high=high, widened=True))
                continue
        found.append(one)
    return found


def _end(search: Search, best: Found, k: int, one: Estimate, side: int, least: float, white: float) -> float:
    """One end of the interval."""
    coordinate, x = search.coordinates[k], best.x
    half = abs(coordinate.x(one.high if side > 0 else one.low) - float(x[k]))
    low, high = coordinate.bounds
    heights, point = [0.0], x.copy()
    for part in AT:
        point[k] = float(x[k]) + side * part * half
        if not low <= point[k] <= high:
            return math.nan
        point = search.least(point, best.blocks, held=k)
        heights.append(math.sqrt(max(2 * (search.cost(point, best.blocks) - least), 0.0)))
    wanted = half / white
    if not (np.diff(heights) > 0).all() or heights[-1] < wanted:
        return math.nan
    return coordinate.value(float(x[k]) + side * half * float(PchipInterpolator(heights, (0.0, *AT))(wanted)))
