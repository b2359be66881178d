"""Runge-Kutta methods that collocate: nodes, and A and b that follow from them, in more digits than float64 holds.

The nodes of s stages on [0, 1] are zeros of combinations of P_k, Legendre's polynomials moved there:

    Gauss       P_s(c) = 0                    order 2s
    Radau IIA   P_s(c) − P_s−1(c) = 0         order 2s − 1, c_s = 1

The method integrates the polynomial through the slopes at the nodes, ℓ_j Lagrange's (Hairer & Wanner, II, IV.5):

    a_ij = ∫_0^c_i ℓ_j(x) dx        b_j = ∫_0^1 ℓ_j(x) dx
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from math import comb

import numpy as np

Polynomial = list[Fraction]  # lowest power first
Tableau = tuple[list[list[Fraction]], list[Fraction], list[Fraction]]

ORDER: dict[str, Callable[[int], int]] = {"Gauss": lambda s: 2 * s, "Radau IIA": lambda s: 2 * s - 1}
"""Order of each family by number of stages."""


@functools.cache
def tableau(family: str, stages: int) -> Tableau:
    """A, b, c of a method of a family, each within 2^−255."""
    p = _legendre(stages)
    c = _zeros(p if family == "Gauss" else _sum(p, [-x for x in _legendre(stages - 1)]))
    integrals = [[Fraction(0), *(x / (k + 1) for k, x in enumerate(p))] for p in _lagrange(c)]
    A = [[_rounded(_value(p, x)) for p in integrals] for x in c]
    return A, [_rounded(_value(p, Fraction(1))) for p in integrals], c


def weights_at(c: Sequence[Fraction], x: Fraction) -> list[Fraction]:
    """ℓ_j(x): the polynomial through values at the nodes c has the value Σ_j ℓ_j(x) f_j at x."""
    return [_value(p, x) for p in _lagrange(c)]


def _legendre(s: int) -> Polynomial:
    """P_s of Legendre on [0, 1], P_s(1) = 1."""
    return [Fraction((-1) ** (s + k) * comb(s, k) * comb(s + k, k)) for k in range(s + 1)]


def _zeros(p: Polynomial) -> list[Fraction]:
    """The zeros on [0, 1], all simple, ascending: those that float64 finds, then Newton's method."""
    slope = [k * x for k, x in enumerate(p)][1:]
    found = [Fraction(float(x)) for x in np.sort(np.roots([float(x) for x in reversed(p)]).real)]
    for _doubling_of_digits in range(6):  # 8 → 512 bits
        found = [_rounded(x - _value(p, x) / _value(slope, x)) for x in found]
    return found


def _lagrange(c: Sequence[Fraction]) -> list[Polynomial]:
    """The polynomials ℓ_j with ℓ_j(c_i) = δ_ij."""
    found = []
    for j, x in enumerate(c):
        p = [Fraction(1)]
        for other in (*c[:j], *c[j + 1 :]):
            p = _sum([Fraction(0), *p], [-other * y for y in p])
            p = [y / (x - other) for y in p]
        found.append(p)
    return found


def _sum(p: Polynomial, q: Polynomial) -> Polynomial:
    """p + q, p the longer."""
    return [x + (q[k] if k < len(q) else 0) for k, x in enumerate(p)]


def _value(p: Polynomial, x: Fraction) -> Fraction:
    """p(x) by Horner's rule."""
    result = Fraction(0)
    for coefficient in reversed(p):
        result = result * x + coefficient
    return result


def _rounded(x: Fraction) -> Fraction:
    """To a multiple of 2^−256, 60 digits behind those of float64: what solves and powers of A lose is nothing."""
    return Fraction(round(x * 2**256), 2**256)
