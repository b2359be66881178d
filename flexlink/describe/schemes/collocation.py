"""Collocation Runge-Kutta methods: nodes, and A and b computed from them, to more digits than float64.

The nodes of s stages on [0, 1] are zeros of combinations of P_k, the Legendre polynomials shifted to [0, 1]:

    Gauss       P_s(c) = 0                    order 2s
    Radau IIA   P_s(c) − P_s−1(c) = 0         order 2s − 1, c_s = 1

The method integrates the polynomial that interpolates the derivatives at the nodes, with Lagrange polynomials ℓ_j
(Hairer & Wanner, II, IV.5):

    a_ij = ∫_0^c_i ℓ_j(x) dx        b_j = ∫_0^1 ℓ_j(x) dx
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from math import comb

import numpy as np

from flexlink.common.polynomials import Polynomial, add, derivative, evaluate, integral, lagrange

Tableau = tuple[list[list[Fraction]], list[Fraction], list[Fraction]]

ORDER: dict[str, Callable[[int], int]] = {"Gauss": lambda s: 2 * s, "Radau IIA": lambda s: 2 * s - 1}
"""Order of each family by number of stages."""


@functools.cache
def tableau(family: str, stages: int) -> Tableau:
    """A, b and c of a method of a family, each accurate to 2^−255."""
    p = _legendre(stages)
    c = _zeros(p if family == "Gauss" else add(p, [-x for x in _legendre(stages - 1)]))
    integrals = [integral(p) for p in lagrange(c)]
    A = [[_rounded(evaluate(p, x)) for p in integrals] for x in c]
    return A, [_rounded(evaluate(p, Fraction(1))) for p in integrals], c


def weights_at(c: Sequence[Fraction], x: Fraction) -> list[Fraction]:
    """ℓ_j(x): interpolation weights, so that Σ_j ℓ_j(x) f_j is the interpolating polynomial's value at x."""
    return [evaluate(p, x) for p in lagrange(c)]


def _legendre(s: int) -> Polynomial:
    """Legendre polynomial P_s on [0, 1], with P_s(1) = 1."""
    return [Fraction((-1) ** (s + k) * comb(s, k) * comb(s + k, k)) for k in range(s + 1)]


def _zeros(p: Polynomial) -> list[Fraction]:
    """Simple zeros on [0, 1], ascending, from float64 values refined by Newton's method."""
    slope = derivative(p)
    zeros = [Fraction(float(x)) for x in np.sort(np.roots([float(x) for x in reversed(p)]).real)]
    for _doubling_of_digits in range(6):  # from 8 correct bits to 512
        zeros = [_rounded(x - evaluate(p, x) / evaluate(slope, x)) for x in zeros]
    return zeros


def _rounded(x: Fraction) -> Fraction:
    """Round to a multiple of 2^−256, 60 digits beyond float64, which makes rounding errors negligible."""
    return Fraction(round(x * 2**256), 2**256)
