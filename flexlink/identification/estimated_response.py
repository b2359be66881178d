"""Frequency response from records of an input and an output: the H1 estimate by Welch's method.

    H = S_uy / S_uu        γ² = |S_uy|² / (S_uu S_yy)
    n = K / (1 + 2 Σ_k (1 − k/K) c_k²),  c_k = Σ w_i w_{i+kD} / Σ w_i²

S are averages over K segments with a Hann window w and half overlap D. Overlapping segments are correlated, so they are
worth n independent averages (Welch 1967). Noise in y only does not bias H.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.chain.arguments import positive, vector
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex


class FrequencyResponse(NamedTuple):
    """An estimated frequency response.

    Attributes
    ----------
    f
        Frequencies [Hz], shape (k,).
    H
        Response, in units of output over input, shape (k,).
    coherence
        Coherence γ², shape (k,).
    averages
        Number of independent averages.
    """

    f: Array
    H: Complex
    coherence: Array
    averages: float

    @property
    def columns(self) -> dict[str, tuple[float, ...]]:
        """Columns as `FitFrf` takes them."""
        parts = {"f [Hz]": self.f, "real": self.H.real, "imaginary": self.H.imag, "coherence": self.coherence}
        return {head: tuple(column.tolist()) for head, column in parts.items()}


def frequency_response(t: ArrayLike, u: ArrayLike, y: ArrayLike, *, segment: float) -> FrequencyResponse:
    """Estimate a frequency response from records of an input and an output (H1, Welch).

    Parameters
    ----------
    t
        Evenly spaced times, shape (n,) [s].
    u, y
        Input and output at these times, shape (n,).
    segment
        Length of a segment [s]. The frequencies are multiples of its inverse. A resonance of the damping ratio ζ needs
        several times 1/(2 ζ ω) to decay within a segment; longer segments leave fewer averages.

    Returns
    -------
    FrequencyResponse
        Response, coherence, and number of averages.

    Raises
    ------
    ArgumentError
        Arrays of different lengths, uneven times, or a segment longer than two thirds of the record.

    Examples
    --------
    >>> t = np.linspace(0.0, 100.0, 20_001)
    >>> u = np.random.default_rng(0).standard_normal(len(t))
    >>> found = fl.fits.frequency_response(t, u, 3.0 * u, segment=2.0)
    >>> print(np.round(abs(found.H[:3]), 6), round(found.averages))
    [3. 3. 3.] 94
    """
    times = vector("t", t, len(np.atleast_1d(np.asarray(t))))
    n, length = len(times), positive("segment", segment)
    inputs, outputs = vector("u", u, n), vector("y", y, n)
    between = np.diff(times)
    if n < 2 or not (between > 0).all() or np.ptp(between) > 1e-3 * between.mean():
        raise ArgumentError("t: expected two or more evenly spaced, increasing times", id="uneven-times")
    rate = (n - 1) / float(times[-1] - times[0])
    size = round(length * rate)
    if size < 4 or (n - size) // (size - size // 2) < 1:
        raise ArgumentError(
            f"segment = {length:g}: expected at least 4 samples, and at most two thirds of the record, "
            f"{2 * n / (3 * rate):.3g} s", id="out-of-range",
        )  # fmt: skip
    how = {"fs": rate, "window": "hann", "nperseg": size, "noverlap": size // 2}
    f, across = scipy.signal.csd(inputs, outputs, **how)
    of_input, of_output = scipy.signal.welch(inputs, **how)[1], scipy.signal.welch(outputs, **how)[1]
    known = (f > 0) & (of_input > 0) & (of_output > 0)
    H = across[known] / of_input[known]
    coherence = np.abs(across[known]) ** 2 / (of_input[known] * of_output[known])
    return FrequencyResponse(f[known], H, np.minimum(coherence, 1.0), _averages(n, size))


def _averages(samples: int, size: int) -> float:
    """Number of independent averages that half-overlapping segments are worth."""
    window, step = scipy.signal.get_window("hann", size), size - size // 2
    count = (samples - size) // step + 1
    total = 1.0
    for k in range(1, min(count, -(-size // step))):
        overlap = float(window[k * step :] @ window[: size - k * step]) / float(window @ window)
        total += 2 * (1 - k / count) * overlap**2
    return count / total
