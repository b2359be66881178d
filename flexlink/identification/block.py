"""Measurements of one instrument, and an autoregressive (AR) model of the noise in each column.

    e_t = − a₁ e_{t−1} − … − a_p e_{t−p} + w_t,  w white

The order p minimizes the Bayesian information criterion, n ln σ² + p ln n (Schwarz 1978); the coefficients are Burg's
estimates. Criteria with a smaller penalty (AICc) select too high orders, which make intervals 5 to 10 % too narrow.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import scipy

from flexlink.common.types import Array

SHARE = 12
"""Smallest number of samples per AR coefficient."""


class Colour(NamedTuple):
    """An autoregressive model of residuals: coefficients 1, a₁ … a_p, and the innovations, shape (n,)."""

    a: Array
    innovations: Array

    def whitened(self, X: Array) -> Array:
        """Whiten columns X, shape (n, columns); the result has the standard deviation of the innovations.

        The first p samples are predicted from the few samples before them and scaled to the same variance.
        """
        if not X.size:
            return X
        found, p, a, size = scipy.signal.lfilter(self.a, [1.0], X, axis=0), len(self.a) - 1, self.a, 1.0
        for t in range(p, 0, -1):  # reduce the predictor's order from t to t − 1 (Levinson-Durbin)
            k = a[t]
            a = (a - k * a[::-1])[:t] / (1 - k * k)
            size *= math.sqrt(1 - k * k)
            if t <= len(X):
                found[t - 1] = size * (a[::-1] @ X[:t])
        return np.asarray(found)

    @property
    def share(self) -> float:
        """Ratio of the standard deviations of innovations and noise."""
        a, size = self.a, 1.0
        for t in range(len(self.a) - 1, 0, -1):
            k = a[t]
            a, size = (a - k * a[::-1])[:t] / (1 - k * k), size * math.sqrt(1 - k * k)
        return size

    def pulled_back(self, J: Array, past: int) -> Array:
        """Hᵀ J, latest sample first, shape (n + past, k); H maps n + past innovations to n samples of the noise."""
        rows = np.vstack([J[::-1], np.zeros((past, J.shape[1]))])
        return np.asarray(scipy.signal.lfilter([1.0], self.a, rows, axis=0))

    @property
    def price(self) -> float:
        """Penalty that the information criterion adds for the coefficients, in units of −2 ln likelihood."""
        return _price(len(self.a) - 1, len(self.innovations))

    @property
    def memory(self) -> int:
        """Number of samples after which the impulse response has decayed to 1e-6, at most 10 000."""
        if len(self.a) == 1:
            return 0
        slowest = float(np.abs(np.roots(self.a)).max())
        return int(min(np.log(1e-6) / np.log(max(min(slowest, 1 - 1e-9), 1e-9)) + len(self.a), 10_000))

    @property
    def correlation_length(self) -> float:
        """Σ ρ² of the autocorrelation ρ; n samples give a mean square as accurately as n / Σ ρ² independent ones."""
        h = scipy.signal.lfilter([1.0], self.a, np.eye(1, self.memory + 1).ravel())
        full = np.correlate(h, h, "full")
        return float(np.sum((full / full[len(h) - 1]) ** 2))


def colour_of(e: Array) -> Colour:
    """Return the AR model of residuals, shape (n,)."""
    highest = 40  # largest order p to try
    n = len(e)
    if n < 3 * SHARE or not e.any():
        return Colour(np.ones(1), e)
    f, b, a, power = e[1:].copy(), e[:-1].copy(), np.ones(1), float(e @ e) / n
    best, least = a, n * np.log(power)
    for p in range(1, min(n // SHARE, highest) + 1):
        k = -2.0 * float(f @ b) / float(f @ f + b @ b)
        a = np.append(a, 0.0)
        a = a + k * a[::-1]
        power *= 1.0 - k * k
        if power <= 0 or len(f) < 2:
            break
        criterion = n * np.log(power) + _price(p, n)
        if criterion < least:
            best, least = a, criterion
        f, b = (f + k * b)[1:], (b + k * f)[:-1]
    return Colour(best, np.asarray(scipy.signal.lfilter(best, [1.0], e)))


def unlikelihood(e: Array, times: float = 1.0) -> float:
    """−2 ln likelihood of residuals, up to a constant: n ln(mean w²) + p ln n, w whitened by an AR model of order p.

    `times` is a factor of mean w².
    """
    colour = colour_of(e)
    w = colour.whitened(e[:, None])
    return len(w) * math.log(max(float(np.mean(w**2)) * times, 1e-300)) + colour.price


def _price(order: int, samples: int) -> float:
    return order * math.log(samples)


FAR = 6.0
"""Distance of an outlier from the median, in standard deviations estimated by the median absolute deviation."""


def outlying(e: Array) -> npt.NDArray[np.bool_]:
    """Whether each residual is an outlier; none is if most residuals are equal."""
    off = np.abs(e - np.median(e))
    return np.asarray((off > FAR * 1.4826 * np.median(off)) & (np.median(off) > 0))


def whiteness(e: Array) -> float:
    """P-value of the Ljung-Box test: probability that white noise is at least as autocorrelated as e, to 20 lags."""
    n, lags = len(e), min(20, len(e) // 5)
    power = float(e @ e)
    if lags < 1 or not power:
        return 1.0
    ρ = np.array([float(e[lag:] @ e[:-lag]) for lag in range(1, lags + 1)]) / power
    return float(scipy.special.chdtrc(lags, n * (n + 2) * np.sum(ρ**2 / (n - np.arange(1, lags + 1)))))


@dataclasses.dataclass(frozen=True, eq=False)
class Block:
    """Measurements of one instrument, with a description of their noise.

    Attributes
    ----------
    name
        What was measured, with the unit; for a run, the name of its column.
    y
        Measured values in SI units, shape (n,), finite.
    σ
        Standard deviation of the noise in `y`, shape (n,).
    stated
        Whether the problem states the noise; otherwise it is estimated from the residuals.
    t
        Times of a run's samples [s], shape (n,); None for single measurements, whose noise is independent.
    colour
        AR model of the noise, None for white noise. With a model, σ is the standard deviation of the innovations.
    gain, bias, drift
        Whether scale, offset, and a linear drift of the offset are unknown.
    left_out
        Outliers, whose residual counts as zero, shape (n,); None if all samples are used.
    """

    name: str
    y: Array
    σ: Array
    stated: bool
    t: Array | None = None
    colour: Colour | None = None
    gain: bool = False
    bias: bool = False
    drift: bool = False
    left_out: npt.NDArray[np.bool_] | None = None

    @property
    def used(self) -> Array:
        """1 for samples that are used, 0 for outliers that are left out, shape (n,)."""
        return np.ones(len(self.y)) if self.left_out is None else np.where(self.left_out, 0.0, 1.0)

    @property
    def linear(self) -> list[str]:
        """Unknowns of the instrument that enter linearly, in the order of the columns of a Jacobian."""
        return [what for what in ("gain", "bias", "drift") if getattr(self, what)]

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return unit_in(self.name)


def unit_in(name: str) -> str:
    """Return the unit in the name of a column.

    >>> print(unit_in("tip x [m]"))
    m
    """
    return name.rpartition("[")[2].rstrip("]")
