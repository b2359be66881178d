"""Estimates with intervals that account for the autocorrelation of the residuals.

    C = B⁻¹ M B⁻¹,  B = Σ JᵀJ,  M = Σ Jᵀ Γ J,  J the Jacobians of the residuals,  Γ the covariance of the noise

For the columns of a run, Γ follows from an AR model of the residuals; columns are correlated like their innovations
(Morelli and Klein, Accuracy of aerodynamic model parameters estimated from flight test data, 1997). The noise of single
measurements is as stated. Student's t distribution accounts for the finite number of independent samples.
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.block import Colour, colour_of
from flexlink.identification.fitted import Estimate
from flexlink.identification.likelihood import LOSSES, Likelihood
from flexlink.identification.problem import Loss
from flexlink.identification.solve import Found, Search

Part = tuple[Sequence[Array], Sequence[Array], bool]
"""Blocks with correlated noise: residuals (n,), Jacobians (n, parameters), and whether they are columns of a run."""


class Spread(NamedTuple):
    """Covariance of all parameters, and the half-width of an interval in standard deviations."""

    covariance: Array
    wide: float

    @property
    def deviations(self) -> Array:
        """Standard deviation of each parameter; inf if it is not identifiable."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of all parameters."""
        σ = self.deviations
        return np.asarray(self.covariance / np.where(σ > 0, σ, 1.0)[:, None] / np.where(σ > 0, σ, 1.0))


def spread_of(parts: Sequence[Part], priors: Array, coefficients: int = 0) -> Spread:
    """Covariance of all parameters; `priors` is the Jacobian of the prior residuals, shape (priors, parameters).

    `coefficients` is the number k of AR coefficients that whiten the residuals. They are estimated from the same n
    samples as the parameters, so the mean square of future noise is (n + k)/(n − k) times the mean square of the
    residuals (Akaike's final prediction error).
    """
    level = 0.95  # confidence level of the intervals
    bread = meat = priors.T @ priors
    independent, samples, lost = 0.0, 0, bread.shape[0] - len(priors)
    single = [e for residuals, _, is_run in parts if not is_run for e in residuals]
    count = sum(map(len, single)) - (0 if any(is_run for _, _, is_run in parts) else lost)
    worse = max(1.0, sum(float(e @ e) for e in single) / max(count, 1))  # mean square of single measurements
    for residuals, slopes, is_run in parts:
        bread = bread + sum(J.T @ J for J in slopes)
        of_part = [colour_of(e) if is_run else Colour(np.ones(1), e) for e in residuals]
        meat = meat + (_meat(residuals, slopes, of_part) if is_run else worse * sum(J.T @ J for J in slopes))
        if is_run:
            independent += sum(len(e) / one.correlation_length for e, one in zip(residuals, of_part, strict=True))
            samples += sum(map(len, residuals))
            coefficients += sum(len(one.a) - 1 for one in of_part)
    size = np.sqrt(np.diag(bread))
    size = np.where(size > 0, size, 1.0)  # so that the result does not depend on units
    inverse = np.linalg.pinv(bread / size[:, None] / size, rcond=1e-14, hermitian=True) / size[:, None] / size
    if samples:
        meat = meat * (samples + coefficients) / max(samples - coefficients, 1)
    freedom = max(independent - lost, 1.0) if samples else math.inf
    wide = float(scipy.special.stdtrit(freedom, (1 + level) / 2)) if math.isfinite(freedom) else 1.959963984540054
    covariance = inverse @ meat @ inverse
    meat = meat + sum(_absorbed(slopes, covariance) for _, slopes, is_run in parts if is_run)
    return Spread(inverse @ meat @ inverse, wide)


def _meat(residuals: Sequence[Array], slopes: Sequence[Array], colours: Sequence[Colour]) -> Array:
    past = max(one.memory for one in colours)
    pulled = [one.pulled_back(J, past) for one, J in zip(colours, slopes, strict=True)]
    lengths = [len(e) for e in residuals]
    total = np.zeros((slopes[0].shape[1],) * 2)
    for a, (one, G) in enumerate(zip(colours, pulled, strict=True)):
        for b, (other, H) in enumerate(zip(colours, pulled, strict=True)):
            if a == b or lengths[a] == lengths[b]:
                total += float(one.innovations @ other.innovations) / lengths[a] * (G.T @ H)
    return total


def _absorbed(slopes: Sequence[Array], covariance: Array) -> Array:
    """First-order correction of M: the fit absorbs part of the noise, so residuals underestimate its covariance.

    It is Σ J_tᵀ g(t − s) J_s with the autocovariance g(k) = 1/n Σ J_t C J_{t+k}ᵀ of J δ; δ is the error of the
    parameters, with covariance C. Even many samples do not help if noise is slow, or near the model's frequencies.
    Without the correction, one in twelve true values lies outside the interval. With the correction, the interval of
    a constant is up to √(5/3) times too wide.
    """
    values, vectors = np.linalg.eigh(covariance)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    total = np.zeros_like(covariance)
    for J in slopes:
        n = len(J)
        F = np.fft.rfft(J, 2 * n, axis=0)
        g = (np.abs(F @ half) ** 2).sum(axis=1) / n
        twice = np.full(n + 1, 2.0)
        twice[[0, -1]] = 1.0
        total += ((F.conj().T * (twice * g)) @ F).real / (2 * n)
    return total


def spread_at(at: Likelihood, loss: Loss = "linear") -> Spread:
    """Covariance of all parameters at a solution, whose noise may be whitened by AR models.

    Residuals e are replaced by ψ(e) / mean(ψ'(e)), so that the covariance of least squares is that of the M-estimator.
    """
    psi = LOSSES[loss].psi
    parts = [
        ([psi(row.residual) for row in part], slopes, source.is_run)
        for source, part, slopes in zip(at.sources, at.rows, at.jacobians, strict=True)
    ]
    colours = [row.block.colour for row in at.every if row.block.colour is not None]
    return spread_of(parts, at.priors, sum(len(one.a) - 1 for one in colours))


def estimates(at: Likelihood, spread: Spread) -> list[Estimate]:
    """Estimates of all parameters: those of the scenes, then gains, biases and drifts."""
    found = []
    for one, x, σ in zip(at.coordinates, at.x.tolist(), spread.deviations.tolist(), strict=False):
        low, high = (one.value(x + far * spread.wide * σ) for far in (-1, 1))
        edge = 1e-6 * max(1.0, abs(x))
        bound = any(math.isfinite(end) and abs(x - end) < edge for end in one.bounds)
        value = one.value(x)
        found.append(Estimate(
            one.name, one.path, one.start, value, low, high, one.size(value) * σ, bound,
            unit=one.measured_in, log=one.log, between=one.between, prior=one.prior,
        ))  # fmt: skip
    count, kinds = len(at.x), [(row.block, what) for row in at.every for what in row.block.linear]
    linear = zip(kinds, at.names[count:], at.linear.tolist(), spread.deviations[count:].tolist(), strict=True)
    for (block, what), name, value, σ in linear:
        start, unit = {"gain": (1.0, ""), "bias": (0.0, block.unit), "drift": (0.0, f"{block.unit}/s")}[what]
        low, high = value - spread.wide * σ, value + spread.wide * σ
        found.append(Estimate(name, "", start, value, low, high, σ, unit=unit))
    return found


# Profile intervals: one parameter is fixed at values near its estimate, and all others are refitted.
#
#     √(2 (cost(x) − least cost)) = half of the interval / standard deviation with white noise
#
# defines the ends of the interval; for a quadratic cost, they equal the ends of the linear estimate's interval.


OUTWARDS = tuple(1.5**k for k in range(7))
"""Distances from the estimate at which ends are tried, relative to the end of the linear estimate's interval."""
HALVINGS = 3  # number of bisections for an end beyond the initial guess


class Rise:
    """Increase of the cost from its minimum, and the points at which it reaches the ends of intervals.

    C is the covariance of the coordinates at the best solution, for white noise of the assumed size.
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
    """First rejected value moving outwards, by bisection; the last one if none is rejected; None if the first is."""
    if not (at := next((k for k, value in enumerate(values) if rejected(value)), None)):
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
        found.append(dataclasses.replace(one, low=low, high=high, widened=(low, high) != (one.low, one.high)))
    return found
