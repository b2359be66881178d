"""Measurements of one instrument, and an autoregressive (AR) model of the noise in each column.

    e_t = − a₁ e_{t−1} − … − a_p e_{t−p} + w_t,  w white

The order p minimizes the Bayesian information criterion, n ln σ² + p ln n (Schwarz 1978); the coefficients are Burg's
estimates. Criteria with a smaller penalty (AICc) select too high orders, which make intervals 5 to 10 % too narrow.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.types import Array, Mask

SHARE = 12  # smallest number of samples per AR coefficient


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
        found = scipy.signal.lfilter(self.a, [1.0], X, axis=0)
        for a, size in self._shorter():
            if len(a) <= len(X):
                found[len(a) - 1] = size * (a[::-1] @ X[: len(a)])
        return np.asarray(found)

    def _shorter(self) -> Iterator[tuple[Array, float]]:
        """Predictors of orders p − 1 … 0 (Levinson-Durbin), and innovations over the deviation of their errors."""
        a, size = self.a, 1.0
        while len(a) > 1:
            k = a[-1]
            a, size = (a - k * a[::-1])[:-1] / (1 - k * k), size * math.sqrt(1 - k * k)
            yield a, size

    @property
    def share(self) -> float:
        """Ratio of the standard deviations of innovations and noise."""
        return [1.0, *(size for _, size in self._shorter())][-1]

    def pulled_back(self, J: Array, past: int) -> Array:
        """Hᵀ J, latest sample first, shape (n + past, k); H maps n + past innovations to n samples of the noise."""
        rows = np.vstack([J[::-1], np.zeros((past, J.shape[1]))])
        return np.asarray(scipy.signal.lfilter([1.0], self.a, rows, axis=0))

    @property
    def price(self) -> float:
        """Penalty that the information criterion adds for the coefficients, in units of −2 ln likelihood."""
        return (len(self.a) - 1) * math.log(len(self.innovations))

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
        criterion = n * np.log(power) + p * math.log(n)
        if criterion < least:
            best, least = a, criterion
        f, b = (f + k * b)[1:], (b + k * f)[:-1]
    return Colour(best, np.asarray(scipy.signal.lfilter(best, [1.0], e)))


def unlikelihood(e: Array, times: float = 1.0) -> float:
    """−2 ln likelihood of residuals, up to a constant: n ln(`times` mean w²) + p ln n, w whitened by an AR(p) model."""
    colour = colour_of(e)
    w = colour.whitened(e[:, None])
    return len(w) * math.log(max(float(np.mean(w**2)) * times, 1e-300)) + colour.price


FAR = 6.0  # distance of an outlier from the median, in standard deviations estimated by the median absolute deviation


def outlying(e: Array) -> Mask:
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


LINEAR = "gain", "bias", "drift"  # unknowns of an instrument that enter linearly


@dataclasses.dataclass(frozen=True, eq=False)
class Block:
    """Measurements of one instrument, with a description of their noise."""

    name: str  # what was measured, with the unit; for a run, the name of its column
    y: Array  # measured values in SI units, shape (n,), finite
    σ: Array  # standard deviation of the noise in `y`, shape (n,)
    stated: bool  # whether the problem states the noise; otherwise it is estimated from the residuals
    # times of a run's samples [s], shape (n,); None for single measurements, whose noise is independent
    t: Array | None = None
    # AR model of the noise, None for white noise. With a model, σ is the standard deviation of the innovations
    colour: Colour | None = None
    # gain, bias, drift: whether scale, offset, and a linear drift of the offset are unknown
    gain: bool = False
    bias: bool = False
    drift: bool = False
    # outliers, whose residual counts as zero, shape (n,); None if all samples are used
    left_out: Mask | None = None

    @property
    def used(self) -> Array:
        """1 for samples that are used, 0 for outliers that are left out, shape (n,)."""
        return np.ones(len(self.y)) if self.left_out is None else np.where(self.left_out, 0.0, 1.0)

    def with_deviation(self, σ: float | None) -> "Block":
        """The block with this standard deviation of all its noise; itself if it is None."""
        return self if σ is None else dataclasses.replace(self, σ=np.full(len(self.y), σ))

    @property
    def linear(self) -> list[str]:
        """Unknowns of the instrument that enter linearly, in the order of the columns of a Jacobian."""
        return [what for what in LINEAR if getattr(self, what)]

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return unit_in(self.name)


def unit_in(name: str) -> str:
    """Return the unit in the name of a column, such as m in "tip x [m]"."""
    return name.rpartition("[")[2].rstrip("]")


# Noise and outliers of a column, estimated from its samples alone.
#
# White noise has the same power at all frequencies, a measured motion has little at high ones. Three bands below the
# Nyquist frequency with equal power therefore contain noise only:
#
#     σ² = P̄ / Σ w²,  P̄ the mean of |Σ w y e^{−iωt}|² over these bands, w a Hann window
#
# Unequal bands show a motion, coloured noise, or a filter; the noise is then not determined.


FEWEST = 60  # powers in a band: fewer do not distinguish white from coloured noise


def with_noise_of_data(blocks: Sequence[Block]) -> list[Block]:
    """The blocks of a run; where the noise is neither stated nor coloured, it is estimated from the data."""
    return [block.with_deviation(noise_in(block)) for block in blocks]


def noise_in(block: Block, fewest: int = FEWEST) -> float | None:
    """Standard deviation of unstated white noise, from a column's longest even part; None if not well determined."""
    if block.stated or block.t is None:
        return None
    y = block.y[max(even_parts(block.t, UNEVEN), key=lambda part: part.stop - part.start)]
    n, good = np.arange(len(y)), ~_spikes(y)
    y = np.interp(n, n[good], y[good]) if good.any() else y  # outliers are replaced between neighbours
    return white_noise(y, fewest)


GAP, UNEVEN = 0.5, 0.1
"""Deviation of a sampling interval from the median, relative to it, beyond which it is a gap (longer), or uneven."""


def even_parts(t: Array, apart: float) -> list[slice]:
    """Parts of a record in which no sampling interval deviates from the median by more than the fraction `apart`."""
    between = np.diff(t)
    usual = float(np.median(between)) if len(between) else 0.0
    cuts = [0, *(np.flatnonzero(np.abs(between - usual) > apart * usual) + 1).tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]


def white_noise(y: Array, fewest: int = FEWEST) -> float | None:
    """Standard deviation of the white noise in evenly spaced samples, shape (n,); None if it is not well determined.

    Bands of fewer powers than `FEWEST` differ more by chance, by the root of their number.
    """
    edges = (0.4, 0.6, 0.8, 0.995)  # of the bands, relative to the Nyquist frequency
    equal = 1.4  # largest ratio of the powers of two bands that count as equal, of FEWEST lines
    least = 1e-5  # smallest noise, relative to the range: less is rounding
    n = len(y)
    if n * (edges[1] - edges[0]) / 2 < fewest:
        return None
    window, number = np.hanning(n), np.arange(n)
    power = np.abs(np.fft.rfft(window * (y - np.polyval(np.polyfit(number, y, 1), number)))) ** 2
    bands = [power[math.ceil(a * n / 2) : math.ceil(b * n / 2)] for a, b in itertools.pairwise(edges)]
    far = 10.0  # medians: noise exceeds them once in a thousand times, unlike lines of mains hum
    sizes = [float(band[band <= far * np.median(band)].mean()) for band in bands]
    σ = math.sqrt(float(np.mean(sizes)) / float(window @ window))
    equal **= math.sqrt(max(FEWEST / min(map(len, bands)), 1.0))
    return σ if 0 < max(sizes) < equal * min(sizes) and σ > least * float(np.ptp(y)) else None


def outliers_in(t: Array, y: Array, predicted: Array) -> Mask:
    """Whether each sample at times t, (n,), is far from its neighbours, none across a gap, in data and residual."""
    return np.concatenate([_spikes(y[part]) & _spikes((y - predicted)[part]) for part in even_parts(t, GAP)])


def _spikes(y: Array) -> Mask:
    """Whether each sample is far from the cubic through 4 neighbours; the farthest are corrected first, round by round.

    Distances are compared with the median distance nearby, and in the whole column.
    """
    far_from = 5.0  # distance of an outlier, in standard deviations
    rounds, near, even = 100, 101, 1.4826  # even: standard deviation of noise over its median distance
    found, y = np.zeros(len(y), bool), y.copy()
    if len(y) < 2 * len(OF_FOUR):
        return found
    steps = np.abs(np.diff(y))
    resolution = 0.3 * float(steps[steps > 0].min(initial=np.inf))
    off = np.abs(_off(y))
    usual = np.maximum(scipy.ndimage.median_filter(off, min(near, len(y)), mode="nearest"), np.median(off))
    limit = far_from * np.maximum(even * usual, resolution)
    for _ in range(rounds):
        far = (off > limit) & (off >= scipy.ndimage.maximum_filter(off, len(OF_FOUR)))
        if not far.any():
            break
        found |= far
        y -= np.where(far, _off(y), 0.0)
        off = np.abs(_off(y))
    return found


OF_FOUR = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6
"""Distance of a sample from the cubic through the two samples on either side."""


def _off(y: Array) -> Array:
    """Distance of every sample from its neighbours, shape (n,); 0 for the two at either end."""
    return np.pad(np.convolve(y, OF_FOUR, "valid"), len(OF_FOUR) // 2)
