"""Chains of linear filters in state space, exact for a signal that is linear between samples.

    ż = A z + B u        y = C z + D u        H(s) = C (s − A)⁻¹ B + D

Each filter is a product of sections in s/ω, at most of second order except for filters given by coefficients. A
Butterworth filter of order n consists of low-pass sections with ζ_k = sin(π(2k + 1)/(2n)), and 1/(s/ω + 1) if n is odd.

For a signal that changes from u by Δu in a time τ, z(τ) = Φ z + Γ u + Ψ Δu with

    | Φ  Γ  Ψ |         | τA  τB  0 |
    | 0  1  1 |  =  exp | 0   0   1 |
    | 0  0  1 |         | 0   0   0 |
"""

import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.filters import Filter


class LinearFilter(NamedTuple):
    """Matrices of a filter with one input and one output; without states, y = D u."""

    A: Array  # (f, f) [1/s]
    B: Array  # (f,) [1/s]
    C: Array  # (f,)
    D: float

    @property
    def settled(self) -> Array:
        """Steady state (f,) for a constant signal of 1."""
        return np.asarray(-np.linalg.solve(self.A, self.B))

    @property
    def gain(self) -> float:
        """Static gain H(0)."""
        return float(self.C @ self.settled + self.D)


@functools.lru_cache(maxsize=64)
def linear_filter(filters: tuple[Filter, ...]) -> LinearFilter:
    """Matrices of filters in series."""
    A, B, C, D = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for ω, b, a in (section for each in filters for section in _sections(each)):
        n = len(a) - 1  # the section in companion form; a[0] = 1
        own_A, own_B = np.eye(n, k=1), np.zeros(n)
        if n:
            own_A[-1], own_B[-1] = -a[:0:-1], 1.0
        own = LinearFilter(ω * own_A, ω * own_B, (b - b[0] * a)[:0:-1], float(b[0]))
        A = np.block([[A, np.zeros((len(B), len(own.B)))], [np.outer(own.B, C), own.A]])
        B, C, D = np.concatenate([B, own.B * D]), np.concatenate([own.D * C, own.C]), own.D * D
    for array in (A, B, C):
        array.setflags(write=False)
    return LinearFilter(A, B, C, D)


def _sections(filter_: Filter) -> list[tuple[float, Array, Array]]:
    """Return ω and the coefficients of numerator and denominator, equally many, in descending powers of s/ω."""
    if filter_.numerator is not None and filter_.denominator is not None:
        return [_scaled(filter_.numerator, filter_.denominator)]
    ζ, ω = filter_.damping, 2 * math.pi * (filter_.low_pass or filter_.notch or 0.0)
    if filter_.notch is not None and ζ is not None:
        return [(ω, np.array([1.0, 0.0, 1.0]), np.array([1.0, 2 * ζ, 1.0]))]
    n = filter_.order or 1
    ratios = [math.sin(math.pi * (2 * k + 1) / (2 * n)) for k in range(n // 2)] if ζ is None else [ζ]
    denominators = [np.array([1.0, 2 * ratio, 1.0]) for ratio in ratios] + [np.ones(2)] * (ζ is None and n % 2)
    return [(ω, np.eye(len(a))[-1], a) for a in denominators]


def _scaled(numerator: Sequence[float], denominator: Sequence[float]) -> tuple[float, Array, Array]:
    """Return a section in s/ω, where ω is the geometric mean of the poles' magnitudes."""
    n = len(denominator) - 1
    ω = abs(denominator[-1] / denominator[0]) ** (1 / max(n, 1))
    scale = denominator[0] * ω ** np.arange(n + 1.0)
    b, a = np.zeros(n + 1), np.array(denominator)
    b[max(n + 1 - len(numerator), 0) :] = numerator[-(n + 1) :]
    return ω, b / scale, a / scale


@functools.lru_cache(maxsize=1024)
def transition(filters: tuple[Filter, ...], τ: float) -> tuple[Array, Array, Array]:
    """Φ (f, f), Γ (f,), Ψ (f,): the change of the states in a time τ ≥ 0 [s], z(τ) = Φ z + Γ u + Ψ Δu."""
    chain = linear_filter(filters)
    f = len(chain.B)
    M = np.zeros((f + 2, f + 2))
    M[:f, :f], M[:f, f], M[f, f + 1] = τ * chain.A, τ * chain.B, 1.0
    E = _exp(M)
    return E[:f, :f], E[:f, f], E[:f, f + 1]


def _exp(M: Array) -> Array:
    """Matrix exponential: Taylor series of M/2^k, at most 1/2 in size, squared k times."""
    terms = 15  # the remainder is at most 0.5^16/16! relative to 1
    k = max(0, math.ceil(math.log2(np.abs(M).sum(axis=1).max())) + 1)
    part, one = M / 2.0**k, np.eye(len(M))
    E = one
    for term in range(terms, 0, -1):
        E = one + part @ E / term
    for _ in range(k):
        E = E @ E
    return E
