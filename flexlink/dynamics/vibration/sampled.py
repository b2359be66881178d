"""Linear systems sampled by a digital controller: zero-order hold, with delays of inputs and outputs.

    x_k+1 = Φ x_k + Γ_r u_k-m + Γ_f u_k-m-1        delay of the inputs = (m + f) T,   0 ≤ f < 1

u_k is computed at t_k = k T. During the first part f T of a period u_k-m-1 still acts, during the rest u_k-m (Franklin,
Powell and Workman, Digital Control of Dynamic Systems, 1998, section 4.3). Inputs on their way are states, as are the
last values of delayed outputs. All of it is exact: Φ and Γ follow from matrix exponentials.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.types import Array
from flexlink.describe.whole_steps import is_whole


class Delay(NamedTuple):
    """A delay of `whole` sampling periods and a `part` of one, 0 ≤ part < 1."""

    whole: int
    part: float

    @property
    def samples(self) -> int:
        """Number of values that are on their way."""
        return self.whole + (self.part > 0.0)


def delay_in(period: float, delay: float) -> Delay:
    """A delay [s] in sampling periods [s]; whole if it differs from a whole number only by rounding."""
    periods = delay / period
    if is_whole(periods):
        return Delay(round(periods), 0.0)
    return Delay(math.floor(periods), periods - math.floor(periods))


def held(A: Array, B: Array, period: float, late: Delay, time: float) -> tuple[Array, Array]:
    """Φ and Γ of the state Φ x_k + Γ (u_k, u_k-1, …, u_k-late.samples) after a `time` ≤ `period` [s] from t_k on."""
    n, m = B.shape
    switch = late.part * period  # from here on u_k-m acts, until then u_k-m-1
    both = np.zeros((n + m, n + m))
    both[:n] = np.hstack([A, B])
    first, rest = (scipy.linalg.expm(both * t) for t in (min(time, switch), max(0.0, time - switch)))
    Γ = np.zeros((n, m * (late.samples + 1)))
    Γ[:, m * late.whole :][:, :m] = rest[:n, n:]
    if late.part:
        Γ[:, m * (late.whole + 1) :] = rest[:n, :n] @ first[:n, n:]
    return rest[:n, :n] @ first[:n, :n], Γ


def with_queue(A: Array, B: Array, period: float, late: Delay) -> tuple[Array, Array]:
    """Matrices of the state (x_k, u_k-1, …, u_k-late.samples) from instant to instant."""
    n, m = B.shape
    Φ, Γ = held(A, B, period, late, period)
    size = n + m * late.samples
    found, by_input = np.zeros((size, size)), np.zeros((size, m))
    found[:n, :n], found[:n, n:], by_input[:n] = Φ, Γ[:, m:], Γ[:, :m]
    if late.samples:
        by_input[n : n + m] = np.eye(m)
        found[n + m :, n:-m] = np.eye(size - n - m)
    return found, by_input


def discrete(
    matrices: tuple[Array, Array, Array, Array], period: float, delay: float, delays: Array
) -> tuple[tuple[Array, Array, Array, Array], list[int]]:
    """Sampled system A, B, C, D with a `period` [s], its inputs late by `delay` and each output by `delays` (p,) [s].

    Returns also the number of states of each output's queue, shape (p,). The states are x, then inputs on their way,
    the newest first, then the queue of each output, the newest first.
    """
    A, B, C, D = matrices
    n, m = B.shape
    late, outputs = delay_in(period, delay), [delay_in(period, each) for each in delays.tolist()]
    inner, by_input = with_queue(A, B, period, late)
    queues = [each.samples for each in outputs]
    size = len(inner) + sum(queues)
    Φ, Γ, H, J = (np.zeros(shape) for shape in ((size, size), (size, m), (len(C), size), (len(C), m)))
    Φ[: len(inner), : len(inner)], Γ[: len(inner)] = inner, by_input
    at = len(inner)
    for j, each in enumerate(outputs):
        row = _value(A, B, C[j], D[j], period, late, (1.0 - each.part) * period if each.part else 0.0)
        if not each.samples:
            J[j], H[j, : len(inner)] = row[n : n + m], np.delete(row, slice(n, n + m))
            continue
        Γ[at], Φ[at, : len(inner)] = row[n : n + m], np.delete(row, slice(n, n + m))
        Φ[at + 1 : at + each.samples, at : at + each.samples - 1] = np.eye(each.samples - 1)
        at += each.samples
        H[j, at - 1] = 1.0
    return (Φ, Γ, H, J), queues


def _value(A: Array, B: Array, c: Array, d: Array, period: float, late: Delay, time: float) -> Array:
    """Coefficients of c x + d u at t_k + `time`, for (x_k, u_k, u_k-1, …, u_k-late.samples)."""
    m = B.shape[1]
    Φ, Γ = held(A, B, period, late, time)
    row = np.concatenate([c @ Φ, c @ Γ])
    acting = late.whole + (time < late.part * period)
    row[len(A) + m * acting :][:m] += d
    return row
