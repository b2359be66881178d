"""Loss functions ρ of residuals e, and their influence functions ψ = ρ'/2 (Huber, Robust statistics, 1981)."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.identification.problem import Loss


class LossFunction(NamedTuple):
    """A loss function of residuals, which are divided by the standard deviation of the noise.

    Attributes
    ----------
    rho
        Loss ρ(e); e² for least squares.
    psi
        Influence ψ(e), divided by its mean slope: residuals with which least squares has the same covariance.
    """

    rho: Callable[[Array], Array]
    psi: Callable[[Array], Array]


def _huber(e: Array) -> Array:
    return np.clip(e, -1.0, 1.0) / max(float(np.mean(np.abs(e) <= 1)), 0.1)


def _soft_l1(e: Array) -> Array:
    return np.asarray(e / np.sqrt(1 + e**2) / np.mean((1 + e**2) ** -1.5))


SQUARES = LossFunction(np.square, np.asarray)
LOSSES: dict[Loss, LossFunction] = {
    "linear": SQUARES,
    "trimmed": SQUARES,
    "huber": LossFunction(lambda e: np.where(np.abs(e) <= 1, e**2, 2 * np.abs(e) - 1), _huber),
    "soft_l1": LossFunction(lambda e: 2 * (np.sqrt(1 + e**2) - 1), _soft_l1),
}
"""Loss functions by name, as `scipy.optimize.least_squares` defines them for a scale of 1."""
