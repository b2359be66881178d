"""Linear systems sampled by a digital controller: zero-order hold, with delays of inputs and outputs.

    x_k+1 = Φ x_k + Γ_r u_k-m + Γ_f u_k-m-1        delay of the inputs = (m + f) T,   0 ≤ f < 1

u_k is computed at t_k = k T. During the first part f T of a period u_k-m-1 still acts, during the rest u_k-m (Franklin,
Powell and Workman, Digital Control of Dynamic Systems, 1998, section 4.3). Inputs on their way are states, as are the
last values of delayed outputs. All of it is exact: Φ and Γ follow from matrix exponentials.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.common.types import Array
from flexlink.describe.numbers import is_whole


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


def held(A: Array, B: Array, period: float, late: Sequence[Delay], time: float) -> tuple[Array, list[Array]]:
    """Φ and Γ_i of the state Φ x_k + Σ_i Γ_i (u_k, u_k-1, …, u_k-samples)_i after a `time` ≤ `period` [s] from t_k on.

    `late` contains the delay of each input i; Γ_i has shape (n, samples_i + 1).
    """
    n, m = B.shape
    both = np.zeros((n + m, n + m))
    both[:n] = np.hstack([A, B])
    Φ, Γ = np.eye(n), [np.zeros((n, each.samples + 1)) for each in late]
    for part in sorted({each.part for each in late} or {0.0}):
        switch = min(part * period, time)  # from here on u_k-whole acts, until then u_k-whole-1
        first, rest = (scipy.linalg.expm(both * t) if t else np.eye(n + m) for t in (switch, time - switch))
        Φ = rest[:n, :n] @ first[:n, :n]
        for i, each in enumerate(late):
            if each.part == part:
                Γ[i][:, each.whole] = rest[:n, n + i]
                if part:
                    Γ[i][:, each.whole + 1] = rest[:n, :n] @ first[:n, n + i]
    return Φ, Γ


def with_queue(A: Array, B: Array, period: float, late: Sequence[Delay]) -> tuple[Array, Array]:
    """Matrices of the state (x_k, queue of input 1, queue of input 2, …) from instant to instant.

    The queue of an input contains u_k-1, …, u_k-samples.
    """
    n, m = B.shape
    Φ, Γ = held(A, B, period, late, period)
    size = n + sum(each.samples for each in late)
    found, by_input = np.zeros((size, size)), np.zeros((size, m))
    found[:n, :n], at = Φ, n
    for i, each in enumerate(late):
        by_input[:n, i], queue = Γ[i][:, 0], slice(at, at := at + each.samples)
        if each.samples:
            found[:n, queue], by_input[queue.start, i] = Γ[i][:, 1:], 1.0
            found[queue, queue] = np.eye(each.samples, k=-1)
    return found, by_input


Matrices = tuple[Array, Array, Array, Array]
"""A, B, C, D of a linear system."""


def discrete(matrices: Matrices, period: float, delay: ArrayLike, delays: Array) -> tuple[Matrices, list[int]]:
    """Sampled system A, B, C, D with a `period` [s], its inputs late by `delay` and each output by `delays` (p,) [s].

    `delay` is one number or one per input. Returns also the number of states of each output's queue, shape (p,). The
    states are x, then the queue of each input (`with_queue`), then the queue of each output, the newest value first.
    """
    A, B, C, D = matrices
    late = [delay_in(period, each) for each in np.broadcast_to(delay, B.shape[1]).tolist()]
    outputs = [delay_in(period, each) for each in delays.tolist()]
    inner, by_input = with_queue(A, B, period, late)
    queues = [each.samples for each in outputs]
    size, m = len(inner) + sum(queues), B.shape[1]
    Φ, Γ, H, J = (np.zeros(shape) for shape in ((size, size), (size, m), (len(C), size), (len(C), m)))
    Φ[: len(inner), : len(inner)], Γ[: len(inner)] = inner, by_input
    times = [(1.0 - each.part) * period if each.part else 0.0 for each in outputs]
    values = {time: _values((A, B, C, D), period, late, time) for time in set(times)}
    at = len(inner)
    for j, (each, time) in enumerate(zip(outputs, times, strict=True)):
        by_state, by_new = values[time]
        if not each.samples:
            J[j], H[j, : len(inner)] = by_new[j], by_state[j]
            continue
        Γ[at], Φ[at, : len(inner)] = by_new[j], by_state[j]
        Φ[at + 1 : at + each.samples, at : at + each.samples - 1] = np.eye(each.samples - 1)
        at += each.samples
        H[j, at - 1] = 1.0
    return (Φ, Γ, H, J), queues


def _values(matrices: Matrices, period: float, late: Sequence[Delay], time: float) -> tuple[Array, Array]:
    """Coefficients of y = C x + D u at t_k + `time`, for the state of `with_queue`, and for the newest inputs u_k."""
    A, B, C, D = matrices
    Φ, Γ = held(A, B, period, late, time)
    columns = [C @ each for each in Γ]
    for i, each in enumerate(late):
        columns[i][:, each.whole + (time < each.part * period)] += D[:, i]
    newest = np.column_stack([each[:, 0] for each in columns]) if columns else np.zeros((len(C), 0))
    return np.hstack([C @ Φ, *(each[:, 1:] for each in columns)]), newest
