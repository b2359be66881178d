"""Noise and outliers of a column, estimated from its samples alone.

White noise has the same power at all frequencies, a measured motion has little at high ones. Three bands below the
Nyquist frequency with equal power therefore contain noise only:

    σ² = P̄ / Σ w²,  P̄ the mean of |Σ w y e^{−iωt}|² over these bands, w a Hann window

Unequal bands show a motion, coloured noise, or a filter; the noise is then not determined.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import scipy

from flexlink.common.types import Array
from flexlink.identification.block import Block


def with_noise_of_data(blocks: Sequence[Block]) -> list[Block]:
    """The blocks of a run; where the noise is neither stated nor coloured, it is estimated from the data."""
    found = []
    for block in blocks:
        σ = noise_in(block)
        found.append(block if σ is None else dataclasses.replace(block, σ=np.full(len(block.y), σ)))
    return found


def noise_in(block: Block) -> float | None:
    """Standard deviation of the unstated white noise of a column; None if it is not well determined.

    Only the longest part with evenly spaced samples is used.
    """
    if block.stated or block.t is None:
        return None
    longest = max(even_parts(block.t, UNEVEN), key=lambda part: part.stop - part.start)
    return white_noise(without_outliers(block.y[longest]))


GAP, UNEVEN = 0.5, 0.1
"""Deviation of a sampling interval from the median, relative to it, beyond which it is a gap (longer), or uneven."""


def even_parts(t: Array, apart: float) -> list[slice]:
    """Parts of a record in which no sampling interval deviates from the median by more than the fraction `apart`."""
    between = np.diff(t)
    usual = float(np.median(between)) if len(between) else 0.0
    cuts = [0, *(np.flatnonzero(np.abs(between - usual) > apart * usual) + 1).tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(cuts)]


def white_noise(y: Array) -> float | None:
    """Standard deviation of the white noise in evenly spaced samples, shape (n,); None if it is not well determined."""
    edges = (0.4, 0.6, 0.8, 0.995)  # of the bands, relative to the Nyquist frequency
    fewest = 60  # powers in a band: fewer do not distinguish white from coloured noise
    equal = 1.4  # largest ratio of the powers of two bands that count as equal
    least = 1e-5  # smallest noise, relative to the range: less is rounding
    n = len(y)
    if n * (edges[1] - edges[0]) / 2 < fewest:
        return None
    window, number = np.hanning(n), np.arange(n)
    power = np.abs(np.fft.rfft(window * (y - np.polyval(np.polyfit(number, y, 1), number)))) ** 2
    bands = [power[math.ceil(a * n / 2) : math.ceil(b * n / 2)] for a, b in itertools.pairwise(edges)]
    sizes = [_without_lines(band) for band in bands]
    σ = math.sqrt(float(np.mean(sizes)) / float(window @ window))
    return σ if 0 < max(sizes) < equal * min(sizes) and σ > least * float(np.ptp(y)) else None


def _without_lines(power: Array) -> float:
    """Mean of exponentially distributed powers, without the few that are larger, for example those of mains hum."""
    far = 10.0  # medians; noise exceeds them once in a thousand times
    return float(power[power <= far * np.median(power)].mean())


def outliers_in(t: Array, y: Array, predicted: Array) -> npt.NDArray[np.bool_]:
    """Whether each sample at times t, shape (n,), lies far from its neighbours, in the data and in the residual.

    Samples on either side of a gap are no neighbours.
    """
    parts = even_parts(t, GAP)
    return np.concatenate([_spikes(y[part]) & _spikes((y - predicted)[part]) for part in parts])


def without_outliers(y: Array) -> Array:
    """The samples, shape (n,), with outliers replaced by values between their neighbours."""
    n, good = np.arange(len(y)), ~_spikes(y)
    return np.asarray(np.interp(n, n[good], y[good])) if good.any() else y


def _spikes(y: Array) -> npt.NDArray[np.bool_]:
    """Samples off a cubic through the two on either side; the largest are removed first, since they move the others.

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
