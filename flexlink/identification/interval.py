"""How well numbers are known that a fit has found, where residuals hang together in time.

    C = B⁻¹ M B⁻¹,  B = Σ JᵀJ,  M = Σ Jᵀ Γ J,  Γ the covariance of the residuals

Γ of a run's columns is that of autoregressive noise fitted to what is left, columns correlated as their innovations are
(Morelli and Klein, Accuracy of aerodynamic model parameters estimated from flight test data, 1997). Single numbers have
the noise that the problem states. A mean square is as uncertain as its samples are few and dependent: Student's t.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

from flexlink.common.types import Array
from flexlink.identification.colour import Colour, colour_of

LEVEL = 0.95
"""Part of all intervals that hold the true value."""


class Part(NamedTuple):
    """Blocks whose noise hangs together: residuals, slopes (n, all), and whether they are columns of a run."""

    residuals: Sequence[Array]
    slopes: Sequence[Array]
    is_run: bool


class Spread(NamedTuple):
    """Covariance of all numbers, and half the width of an interval over a standard deviation."""

    covariance: Array
    wide: float
    colours: list[list[Colour]]

    @property
    def deviations(self) -> Array:
        """Standard deviation of each number; inf of one that the data do not hold."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def correlation(self) -> Array:
        """Of all numbers."""
        σ = self.deviations
        return np.asarray(self.covariance / np.where(σ > 0, σ, 1.0)[:, None] / np.where(σ > 0, σ, 1.0))


def spread_of(parts: Sequence[Part], priors: Array) -> Spread:
    """How well all numbers are known; `priors` are the slopes of prior knowledge, shape (priors, all)."""
    bread = meat = priors.T @ priors
    independent, samples, colours = 0.0, 0, []
    worse = _worse(parts, bread.shape[0] - len(priors))
    for part in parts:
        bread = bread + sum(J.T @ J for J in part.slopes)
        of_part = [colour_of(e) if part.is_run else Colour(np.ones(1), e) for e in part.residuals]
        meat = meat + (_meat(part, of_part) if part.is_run else worse * sum(J.T @ J for J in part.slopes))
        colours.append(of_part)
        if part.is_run:
            independent += sum(len(e) / one.correlation_length for e, one in zip(part.residuals, of_part, strict=True))
            samples += sum(len(e) for e in part.residuals)
    lost = bread.shape[0] - len(priors)
    inverse = _inverse(bread)
    if samples:
        meat = meat * samples / max(samples - lost, 1)  # what the fit has taken off the residuals
    freedom = max(independent - lost, 1.0) if samples else math.inf
    wide = float(student.ppf((1 + LEVEL) / 2, freedom)) if math.isfinite(freedom) else 1.959963984540054
    return Spread(inverse @ meat @ inverse, wide, colours)


def _worse(parts: Sequence[Part], sought: int) -> float:
    """Mean square of the residuals of single numbers over their noise where that is more than 1."""
    single = [e for part in parts if not part.is_run for e in part.residuals]
    count = sum(map(len, single)) - (sought if len(single) == sum(len(part.residuals) for part in parts) else 0)
    return max(1.0, sum(float(e @ e) for e in single) / max(count, 1))


def _meat(part: Part, colours: Sequence[Colour]) -> Array:
    past = max(one.memory for one in colours)
    pulled = [one.pulled_back(J, past) for one, J in zip(colours, part.slopes, strict=True)]
    lengths = [len(e) for e in part.residuals]
    total = np.zeros((part.slopes[0].shape[1],) * 2)
    for a, (one, G) in enumerate(zip(colours, pulled, strict=True)):
        for b, (other, H) in enumerate(zip(colours, pulled, strict=True)):
            if a == b or lengths[a] == lengths[b]:
                total += float(one.innovations @ other.innovations) / lengths[a] * (G.T @ H)
    return total


def _inverse(bread: Array) -> Array:
    """The inverse of a sum of squares, scaled so that units do not matter."""
    size = np.sqrt(np.diag(bread))
    size = np.where(size > 0, size, 1.0)
    return np.asarray(np.linalg.pinv(bread / size[:, None] / size, rcond=1e-14, hermitian=True) / size[:, None] / size)
