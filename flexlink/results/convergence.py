"""Richardson extrapolation of the tip's path to the limit of infinitely many hinges.

x* ≈ x_b + (x_b − x_a) / ((N_b/N_a)^p − 1)          paths x_a, x_b with N_a < N_b hinges; p: order of convergence
p = log(|x_b − x_a| / |x_c − x_b|) / log(N_b/N_a)   order observed with three levels, N_c/N_b = N_b/N_a

With a known order and three levels, the error of x* is estimated by the change of x* when the last level is added.
Otherwise it is estimated by the distance |x* − x_b| of x* from the finest level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.results.tip_motion import largest_distance

Level = tuple[float, Array]
"""A level: number of hinges in each link, and the path of the tip (samples, 3) [m]."""


class Limit(NamedTuple):
    """Limit of the tip's path as a model gets more hinges.

    Attributes
    ----------
    tip
        The path, shape (samples, 3) [m].
    errors
        Estimate of the largest error of `tip` up to each sample, shape (samples,) [m].
    order
        Order of convergence of the extrapolation; nan if the limit is the finest level itself.
    weights
        Weights of the last two levels in `tip`.
    """

    tip: Array
    errors: Array
    order: float = math.nan
    weights: tuple[float, float] = (0.0, 1.0)

    @property
    def error(self) -> float:
        """Estimate of the largest error at any sample [m]."""
        return float(self.errors[-1])


def extrapolated(levels: Sequence[Level], order: float = 2.0) -> Limit:
    """Limit extrapolated from the last two levels with this order; its errors are inf, since not yet estimated."""
    (Na, a), (Nb, b) = levels[-2:]
    q = (Nb / Na) ** order - 1
    return Limit(b + (b - a) / q, np.full(len(b), np.inf), order, (-1 / q, 1 + 1 / q))


def change_of_limit(levels: Sequence[Level], order: float = 2.0) -> Array:
    """Change of the limit when the last level is added (samples, 3) [m]; needs three levels."""
    return extrapolated(levels, order).tip - extrapolated(levels[:-1], order).tip


def observed_order(levels: Sequence[Level]) -> float:
    """Order of convergence observed with the last three levels; inf if the last change is zero."""
    (Na, a), (Nb, b), (_, c) = levels[-3:]
    before, last = largest_distance(b, a), largest_distance(c, b)
    if not before or not last:
        return -math.inf if last else math.inf
    return math.log(before / last) / math.log(Nb / Na)
