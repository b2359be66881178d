"""One number of the specimen fitted to some of the measured quantities, and how well it then predicts the others.

If one number, fitted to half of the quantities, predicts the other half, the specimen's data are wrong in that number;
if no number does, the model or the measurement is wrong. The fit is weighted by the uncertainty u_D of the readings:

    min over p of Σ ((S_i(p) − D_i) / u_D,i)²,       p = start · exp(x).

S(p) is computed on the coarsest grid and shifted by the difference of the finest and the coarsest grid without the fit.
The standard uncertainty of x is u_x = b / √(jᵀj), where j are the derivatives of the weighted differences and b is the
Birge ratio, √(χ² / (n − 1)) but at least 1. The other inputs keep their tolerances; since a changed input would also
have changed the fitted number, its effect is what the fit does not compensate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from flexlink.common.types import Array
from flexlink.describe.spec import Positive, Spec
from validation.measured.readings import Reading
from validation.measured.uncertainty import VERDICTS, Comparison

STEP = 1e-3  # of x, for derivatives
NEAR_LIMIT = 0.01  # distance to a limit of x at which the fit counts as having run into it


class Candidate(Spec, frozen=True, kw_only=True):
    """A number of the scene at `path`, sought between `low` and `high` times `start` (its value in the scene, if 0).

    `limit` states the meaning if the best value is a limit of this range. `tolerance` is the relative tolerance with
    which the number is known, for comparison; 0 if it is unknown.
    """

    path: str
    unit: str
    low: Positive = 0.5
    high: Positive = 2.0
    start: float = 0.0
    tolerance: float = 0.0
    limit: str = "its range"


class OneNumber(Spec, frozen=True, kw_only=True):
    """Group of quantities, patterns of those that are fitted, by a name for this choice, and candidates by name."""

    group: str
    fitted_to: dict[str, list[str]]
    candidate: dict[str, Candidate]


class Study(NamedTuple):
    """What the fit starts from: comparisons without a fit, by quantity, and the effect of each input's tolerance.

    `predict` computes the quantities on the coarsest grid for a value of the candidate; None leaves the scene as it is.
    `inputs` has, by input, the standard uncertainty of each quantity with its sign.
    """

    compared: Mapping[str, Comparison]
    inputs: Mapping[str, Mapping[str, float]]
    predict: Callable[[float | None], Mapping[str, float]]


class Fitted(NamedTuple):
    """A fitted number, and the comparisons of the quantities to which it was not fitted.

    Attributes
    ----------
    value, u_relative
        The number, and its relative standard uncertainty; infinite if the fitted quantities do not depend on it there.
    at_limit
        Whether the best value is a limit of the range, or so near that the quantities no longer depend on it.
    before, after
        Root mean square of (S − D) / u_D of the fitted quantities without and with the fit.
    others
        The other quantities, with the fit.
    """

    value: float
    u_relative: float
    at_limit: bool
    before: float
    after: float
    others: dict[str, Comparison]

    def count(self, verdict: str = VERDICTS[0]) -> int:
        """Number of the other quantities with this verdict."""
        return sum(each.verdict == verdict for each in self.others.values())


def chosen(names: Sequence[str], patterns: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names that match a pattern, and the others."""
    fitted = [name for name in names if any(fnmatchcase(name, pattern) for pattern in patterns)]
    return fitted, [name for name in names if name not in fitted]


def fit_one_number(
    candidate: Candidate, start: float, readings: Mapping[str, Reading], patterns: Sequence[str], study: Study
) -> Fitted:
    """Fit a number to the quantities that match the patterns; compare the others."""
    fitted, others = chosen(list(readings), patterns)
    weighted = _weighted(start, readings, study)
    limits = math.log(candidate.low), math.log(candidate.high)
    best = least_squares(
        lambda x: _array(weighted(x[0]), fitted), [0.0], bounds=limits, diff_step=STEP, x_scale=0.1, xtol=1e-10
    )
    x = float(best.x[0])
    low, high = weighted(x - STEP), weighted(x + STEP)
    slopes = {name: (high[name] - low[name]) / (2 * STEP) for name in readings}
    j, span = _array(slopes, fitted), limits[1] - limits[0]
    vanished = float(j @ j) * span**2 < 1.0
    determined = not vanished or _moves(weighted, fitted, span)
    at_limit = determined and (vanished or min(x - limits[0], limits[1] - x) < NEAR_LIMIT)
    birge = max(1.0, math.sqrt(2.0 * best.cost / max(len(fitted) - 1, 1)))
    u_x = math.inf if vanished else birge / math.sqrt(float(j @ j))
    compared = {name: study.compared[name] for name in others}
    if determined and not at_limit:
        now = weighted(x)
        for name in others:
            left = [_not_compensated(name, each, readings, slopes, j, fitted) for each in study.inputs.values()]
            u, old = readings[name].u, compared[name]
            u_input = math.hypot(*left, slopes[name] * u * u_x)
            compared[name] = old._replace(simulated=old.measured + now[name] * u, u_input=u_input)
    before = _array({name: study.compared[name].error / readings[name].u for name in fitted}, fitted)
    misfits = [math.sqrt(float(r @ r) / len(fitted)) for r in (before, best.fun)]
    return Fitted(start * math.exp(x) if determined else start, u_x, at_limit, misfits[0], misfits[1], compared)


def _weighted(start: float, readings: Mapping[str, Reading], study: Study) -> Callable[[float], dict[str, float]]:
    """(S − D) / u_D of every quantity as a function of x."""
    free = study.predict(None)
    finer = {name: study.compared[name].simulated - free[name] for name in readings}

    def weighted(x: float) -> dict[str, float]:
        found = study.predict(start * math.exp(x))
        return {name: (found[name] + finer[name] - each.value) / each.u for name, each in readings.items()}

    return weighted


def _moves(weighted: Callable[[float], dict[str, float]], fitted: Sequence[str], span: float) -> bool:
    """Whether the fitted quantities depend on the number at its start."""
    j = (_array(weighted(STEP), fitted) - _array(weighted(-STEP), fitted)) / (2 * STEP)
    return float(j @ j) * span**2 > 1.0


def _array(values: Mapping[str, float], names: Sequence[str]) -> Array:
    return np.array([values[name] for name in names])


def _not_compensated(
    name: str,
    effect: Mapping[str, float],
    readings: Mapping[str, Reading],
    slopes: Mapping[str, float],
    j: Array,
    fitted: Sequence[str],
) -> float:
    """Effect of an input on a quantity after the number has been fitted again with the input changed."""
    shifts = np.array([effect[each] / readings[each].u for each in fitted])
    dx = -float(j @ shifts) / float(j @ j)
    return effect[name] + slopes[name] * readings[name].u * dx
