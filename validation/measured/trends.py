"""Pooled trends: how fast readings change with a condition, measured over computed, with the errors that they share.

Ratios of one reading to several others share its error. A regression of readings on computed values has no such
problem: in each series, log D = a + b log S, with an own level a, and one factor b for all series. The weights are
(D / u_D)², the readings' errors are independent, and errors of inputs mostly go into the levels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from validation.measured.readings import Reading
from validation.measured.uncertainty import Comparison, Convergence


class Trend(NamedTuple):
    """A pooled trend: factor b with its standard uncertainty, and the misfit Σ ((log D − a − log S) D / u_D)².

    `of` is the group of ratios that it replaces, `freedom` their number and the degrees of freedom of the misfit.
    """

    name: str
    of: str
    factor: float
    u: float
    misfit: float
    freedom: int

    def compared(self, wanted: float) -> Comparison:
        """Comparison of the computed trend, 1, with the measured one."""
        return Comparison(1.0, self.factor, Convergence(math.nan, 0.0), 0.0, self.u, wanted)


def pooled(
    name: str, of: str, series: Iterable[Sequence[str]], readings: Mapping[str, Reading], computed: Mapping[str, float]
) -> Trend:
    """Trend over several series of readings, given by their names."""
    product = square = misfit = 0.0
    freedom = 0
    for names in series:
        weights = np.array([(readings[each].value / readings[each].u) ** 2 for each in names])
        s, d = (
            np.log(values) - np.average(np.log(values), weights=weights)
            for values in ([computed[each] for each in names], [readings[each].value for each in names])
        )
        product += float(weights @ (s * d))
        square += float(weights @ s**2)
        misfit += float(weights @ (s - d) ** 2)
        freedom += len(names) - 1
    return Trend(name, of, product / square, 1.0 / math.sqrt(square), misfit, freedom)
