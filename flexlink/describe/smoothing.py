"""Rates and accelerations of measured angles: a zero-phase low-pass, differentiated exactly.

The smoothing spline f of angles y at times t makes Σ w_k (y_k − f(t_k))² + λ ∫ f″² dt least. With w_k the time that a
sample stands for and λ = (2π cutoff)⁻⁴ it passes 1 / (1 + (f/cutoff)⁴) of a frequency f without delay: what a
Butterworth low-pass of second order makes of a record when it is run forward, then backward. At the cutoff half of the
amplitude is left, at half of it 94 %, at a third 99 %. At both ends of the record the acceleration is 0.
(Reinsch 1967; Eilers & Marx 1996)
"""

from __future__ import annotations

import math

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array

FEWEST = 5
"""Samples that a smoothing spline needs."""


def smoothed(t: Array, y: Array, cutoff: float) -> tuple[Array, Array, Array]:
    """Values, rates and accelerations (samples,) of y (samples,) at times t [s] by a low-pass at `cutoff` [Hz].

    Raises
    ------
    SceneError
        Samples are fewer than five, or too far apart for the cutoff.
    """
    if len(t) < FEWEST:
        raise SceneError(f"cutoff = {cutoff!r}: {len(t)} samples are too few; expected {FEWEST} or more")
    apart = float(np.diff(t).max())
    if 2 * apart * cutoff >= 1:
        raise SceneError(
            f"cutoff = {cutoff!r}: samples are up to {apart:.6g} s apart; expected below {0.5 / apart:.6g} Hz, half "
            "of their rate"
        )
    from scipy.interpolate import make_smoothing_spline  # noqa: PLC0415  0.1 s that few scenes need

    weights = np.gradient(t)
    weights[[0, -1]] /= 2
    spline = make_smoothing_spline(t, y, w=weights, lam=(2 * math.pi * cutoff) ** -4)
    return tuple(np.asarray(spline(t, nu=order)) for order in range(3))  # type: ignore[return-value]
