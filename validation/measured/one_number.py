"""One number of the specimen, chosen and fitted in one half of the readings, and judged in the other half.

If a number that is fitted to half of the readings predicts the other half, the specimen's data are wrong in it; if no
number does, the model or the measurement is wrong. Each half predicts the other, so every reading is held out
once. In each half, the number is the candidate with the smallest misfit there. The fit

    min over p of Σ (E_i / u_i)²,     E_i = S_i(p) − D_i,  p = start · exp(x),  u_i² = u_D,i² + (c D_i)²

begins with c = 0. If the misfit exceeds u_D, c is the relative scatter of the model that explains it, so that
Σ (E_i / u_i)² = n − 1 (Mandel and Paule 1982), and x is fitted again. S(p) is computed on the coarsest grid and shifted
by the difference of the finest and the coarsest grid without the fit. With J = dE / dx, u_x = 1 / √(Σ (J_i / u_i)²).
A reading that is held out is predicted with the uncertainty of x, the scatter c D, and of every other input the effect
that the fit does not compensate, since a changed input would also have changed the fitted number.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares

from flexlink.common.types import Array
from flexlink.describe.spec import Positive, Spec
from validation.measured.readings import Reading
from validation.measured.uncertainty import VERDICTS, Comparison

STEP = 1e-3  # of x, for derivatives
CLOSE = 1e-3  # of x and, squared, of the misfit, at which a fit ends: far below the smallest u_x and its effect
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
    """Groups of readings, patterns of those in the first half of them, and candidates by name.

    Readings of the groups `beside` are never fitted; the number of the first half predicts them.
    """

    groups: list[str]
    half: list[str]
    candidate: dict[str, Candidate]
    beside: list[str] = []  # noqa: RUF012  msgspec copies it

    def halves(self, readings: Mapping[str, Reading]) -> tuple[list[str], list[str]]:
        """Names of the readings in both halves."""
        names = [name for name, reading in readings.items() if reading.group in self.groups]
        return chosen(names, self.half)


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
    scatter
        c, the relative scatter of the fitted quantities that u_D does not explain.
    others
        The other quantities, with the fit.
    """

    value: float
    u_relative: float
    at_limit: bool
    before: float
    after: float
    scatter: float
    others: dict[str, Comparison]

    @property
    def usable(self) -> bool:
        """Whether the data determine the number."""
        return math.isfinite(self.u_relative) and not self.at_limit

    def count(self, verdict: str = VERDICTS[0]) -> int:
        """Number of the other quantities with this verdict."""
        return sum(each.verdict == verdict for each in self.others.values())


def chosen(names: Sequence[str], patterns: Sequence[str]) -> tuple[list[str], list[str]]:
    """Names that match a pattern, and the others."""
    fitted = [name for name in names if any(fnmatchcase(name, pattern) for pattern in patterns)]
    return fitted, [name for name in names if name not in fitted]


def fit_one_number(
    candidate: Candidate, start: float, readings: Mapping[str, Reading], fitted: Sequence[str], study: Study
) -> Fitted:
    """Fit a number to some of the readings; compare the others."""
    others = [name for name in readings if name not in fitted]
    errors = _errors(start, readings, study)
    u, D = (_array({name: getattr(readings[name], of) for name in fitted}, fitted) for of in ("u", "value"))
    limits = math.log(candidate.low), math.log(candidate.high)
    known: dict[float, Array] = {}

    def residuals(x: Array) -> Array:
        if (at := float(x[0])) not in known:
            known[at] = _array(errors(at), fitted) / u
        return known[at]

    def secant(x: Array) -> Array:
        """Slope through the nearest point that is already computed; at the start through one at the distance STEP."""
        if len(known) == 1:
            residuals(x + STEP)
        here, beside = sorted(known, key=lambda other: abs(other - x[0]))[:2]
        return (known[beside] - known[here])[:, None] / (beside - here)

    best = least_squares(residuals, [0.0], secant, limits, x_scale=0.1, xtol=CLOSE, ftol=CLOSE**2)
    x, span = float(best.x[0]), limits[1] - limits[0]
    slopes, J = _slopes(errors, x, fitted)
    vanished = float((J / u) @ (J / u)) * span**2 < 1.0
    determined = not vanished or _moves(errors, fitted, u, span)
    at_limit = determined and (vanished or min(x - limits[0], limits[1] - x) < NEAR_LIMIT)
    compared = {name: study.compared[name] for name in others}
    u_x, scatter = math.inf, 0.0
    if determined and not at_limit:
        scatter, dx = _scatter(best.fun * u, J, u, np.abs(D))
        weights = np.hypot(u, scatter * D)
        x, u_x = x + dx, 1.0 / float(np.linalg.norm(J / weights))
        now = errors(x)
        for name in others:
            left = [_not_compensated(name, each, slopes, J, weights, fitted) for each in study.inputs.values()]
            value = readings[name].value
            u_input = math.hypot(*left, slopes[name] * u_x, scatter * value)
            compared[name] = compared[name]._replace(simulated=value + now[name], u_input=u_input)
    before = _array({name: study.compared[name].error for name in fitted}, fitted) / u
    misfits = [float(np.linalg.norm(r)) / math.sqrt(len(fitted)) for r in (before, best.fun)]
    value = start * math.exp(x) if determined else start
    return Fitted(value, u_x, at_limit, misfits[0], misfits[1], scatter, compared)


def _scatter(E: Array, J: Array, u: Array, D: Array) -> tuple[float, float]:
    """Relative scatter c that explains the misfit of errors E with slopes J, and the change of x with these weights."""

    def step(c: float) -> float:
        weights = u**2 + (c * D) ** 2
        return -float(J @ (E / weights)) / float(J @ (J / weights))

    def excess(c: float) -> float:
        return float(np.sum((E + J * step(c)) ** 2 / (u**2 + (c * D) ** 2))) - (len(E) - 1)

    if len(E) < 2 or excess(0.0) <= 0.0:
        return 0.0, 0.0
    c = float(brentq(excess, 0.0, float(np.abs(E / D).max()) * math.sqrt(len(E))))
    return c, step(c)


def _errors(start: float, readings: Mapping[str, Reading], study: Study) -> Callable[[float], dict[str, float]]:
    """E = S − D of every quantity as a function of x."""
    free = study.predict(None)
    finer = {name: study.compared[name].simulated - free[name] for name in readings}

    def errors(x: float) -> dict[str, float]:
        found = study.predict(start * math.exp(x))
        return {name: found[name] + finer[name] - each.value for name, each in readings.items()}

    return errors


def _slopes(
    errors: Callable[[float], dict[str, float]], x: float, fitted: Sequence[str]
) -> tuple[dict[str, float], Array]:
    """dE/dx of every quantity, and of the fitted ones as an array."""
    low, high = errors(x - STEP), errors(x + STEP)
    slopes = {name: (high[name] - low[name]) / (2 * STEP) for name in low}
    return slopes, _array(slopes, fitted)


def _moves(errors: Callable[[float], dict[str, float]], fitted: Sequence[str], u: Array, span: float) -> bool:
    """Whether the fitted quantities depend on the number at its start."""
    j = _slopes(errors, 0.0, fitted)[1] / u
    return float(j @ j) * span**2 > 1.0


def _array(values: Mapping[str, float], names: Sequence[str]) -> Array:
    return np.array([values[name] for name in names])


def _not_compensated(
    name: str, effect: Mapping[str, float], slopes: Mapping[str, float], J: Array, weights: Array, fitted: Sequence[str]
) -> float:
    """Effect of an input on a quantity after the number has been fitted again with the input changed."""
    shifts = _array(effect, fitted) / weights
    dx = -float((J / weights) @ shifts) / float((J / weights) @ (J / weights))
    return effect[name] + slopes[name] * dx


class Choice(NamedTuple):
    """The best candidate of a half, by name, with its unit; None if the half determines none."""

    name: str
    unit: str
    fitted: Fitted | None


def choose(
    wanted: OneNumber,
    fitted: Sequence[str],
    readings: Mapping[str, Reading],
    of: Callable[[Candidate], tuple[float, Study]],
) -> Choice:
    """Fit every candidate to some readings, and choose the one with the smallest misfit; `of` gives start and study."""
    found = [
        Choice(name, each.unit, fit_one_number(each, of(each)[0], readings, fitted, of(each)[1]))
        for name, each in wanted.candidate.items()
    ]
    usable = [each for each in found if each.fitted and each.fitted.usable]
    return min(usable, key=lambda each: each.fitted.after if each.fitted else 0.0, default=Choice("none", "", None))
