"""Closed loops: a plant with delays of its inputs, sampled, and a linear control law.

    x_k+1 = A x_k + B u_k       y_k = C x_k       z_k+1 = F z_k + G y_k       u_k = H z_k + K y_k

Without a rate all of it is continuous, with ẋ in place of x_k+1. A controller that reads a torque or an acceleration at
the instant at which its own torque begins to act still sees the torque before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.types import Array
from flexlink.dynamics.vibration.sampled import discrete
from flexlink.motion.loop.law import LinearLaw
from flexlink.motion.loop.plant import Plant


class OpenLoop(NamedTuple):
    """ẋ = A x + B u or x_k+1 = A x_k + B u_k, with outputs y = C x."""

    A: Array  # (s, s)
    B: Array  # (s, m)
    C: Array  # (p, s)
    period: float  # sampling period [s]; 0: continuous

    def closed(self, law: LinearLaw, broken: int | None = None) -> Array:
        """Matrix of the closed loop for the state (x, z); without the feedback to input `broken`."""
        u = self.feedback(law)
        B = self.B if broken is None else np.delete(self.B, broken, axis=1)
        u = u if broken is None else np.delete(u, broken, axis=0)
        whole = np.zeros((len(self.A) + len(law.F),) * 2)
        s = len(self.A)
        whole[:s, :s], whole[s:, :s], whole[s:, s:] = self.A, law.G @ self.C, law.F
        whole[:s] += B @ u
        return whole

    def feedback(self, law: LinearLaw) -> Array:
        """Coefficients (m, s + z) of u for the state (x, z)."""
        return np.hstack([law.K @ self.C, law.H])


def open_loop(plant: Plant, rate: float, delay: ArrayLike = 0.0) -> OpenLoop:
    """The plant sampled at a `rate` [Hz], its inputs late by `delay` [s], one or (m,); continuous if the rate is 0."""
    if not rate:
        return OpenLoop(plant.A, plant.B, plant.C, 0.0)
    (A, B, C, D), _ = discrete(plant.matrices, 1.0 / rate, delay, plant.delays)
    if not D.any():
        return OpenLoop(A, B, C, 1.0 / rate)
    s, m = B.shape
    before = np.zeros((s + m, s + m))  # u_k-1 are further states
    before[:s, :s] = A
    return OpenLoop(before, np.vstack([B, np.eye(m)]), np.hstack([C, D]), 1.0 / rate)


def growth_of(matrix: Array, period: float) -> float:
    """Growth factor of the fastest growing motion, per sampling period, or per second if it is continuous."""
    if not np.isfinite(matrix).all():
        return np.inf
    λ = np.asarray(np.linalg.eigvals(matrix), np.complex128)
    if period:
        return float(np.abs(λ).max(initial=0.0))
    with np.errstate(over="ignore"):
        return float(np.exp(λ.real.max(initial=-np.inf)))
