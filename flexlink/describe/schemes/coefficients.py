"""Coefficients of Runge-Kutta methods computed to more digits than float64: of collocation and of dense output.

Collocation methods have nodes, from which A and b follow.

The nodes of s stages on [0, 1] are zeros of combinations of P_k, the Legendre polynomials shifted to [0, 1]:

    Gauss       P_s(c) = 0                    order 2s
    Radau IIA   P_s(c) − P_s−1(c) = 0         order 2s − 1, c_s = 1

The method integrates the polynomial that interpolates the derivatives at the nodes, with Lagrange polynomials ℓ_j
(Hairer & Wanner, II, IV.5):

    a_ij = ∫_0^c_i ℓ_j(x) dx        b_j = ∫_0^1 ℓ_j(x) dx
"""

import functools
from collections.abc import Callable, Sequence
from fractions import Fraction
from math import comb

import numpy as np
from numpy.polynomial.polynomial import polyadd, polyder, polyint, polymul, polysub, polyval

from flexlink.common.polynomials import Polynomial, float64, lagrange
from flexlink.common.types import Array

Tableau = tuple[list[list[Fraction]], list[Fraction], list[Fraction]]

ORDER: dict[str, Callable[[int], int]] = {"Gauss": lambda s: 2 * s, "Radau IIA": lambda s: 2 * s - 1}
"""Order of each family by number of stages."""


@functools.cache
def tableau(family: str, stages: int) -> Tableau:
    """A, b and c of a method of a family, each accurate to 2^−255."""
    p = _legendre(stages)
    c = _zeros(p if family == "Gauss" else polysub(p, _legendre(stages - 1)))
    integrals = [polyint(p) for p in lagrange(c)]
    A = [[_rounded(_value(p, x)) for p in integrals] for x in c]
    return A, [_rounded(_value(p, Fraction(1))) for p in integrals], c


def weights_at(c: Sequence[Fraction], x: Fraction) -> list[Fraction]:
    """ℓ_j(x): interpolation weights, so that Σ_j ℓ_j(x) f_j is the interpolating polynomial's value at x."""
    return [_value(p, x) for p in lagrange(c)]


def _value(p: Polynomial, x: Fraction) -> Fraction:
    return polyval(x, p)  # type: ignore[return-value]


def _legendre(s: int) -> Polynomial:
    """Legendre polynomial P_s on [0, 1], with P_s(1) = 1."""
    return [Fraction((-1) ** (s + k) * comb(s, k) * comb(s + k, k)) for k in range(s + 1)]


def _zeros(p: Polynomial) -> list[Fraction]:
    """Simple zeros on [0, 1], ascending, from float64 values refined by Newton's method."""
    slope = polyder(p)
    zeros = [Fraction(float(x)) for x in np.sort(np.roots([float(x) for x in reversed(p)]).real)]
    for _doubling_of_digits in range(6):  # from 8 correct bits to 512
        zeros = [_rounded(x - _value(p, x) / _value(slope, x)) for x in zeros]
    return zeros


def _rounded(x: Fraction) -> Fraction:
    """Round to a multiple of 2^−256, 60 digits beyond float64, which makes rounding errors negligible."""
    return Fraction(round(x * 2**256), 2**256)


# Dense output of explicit Runge-Kutta methods: stage weights as polynomials of the fraction x of a step.
#
# Published methods give rows d of weights for the s stages, for the derivative at the end of the step (number s + 1),
# and for e extra stages. At a fraction x of a step h from y to y + h Σ b_i K_i, the solution is interpolated as
# follows, where H is the cubic Hermite polynomial through both ends:
#
#     y(x) = H(x) + h x² (1 − x)² Σ w_i(x) K_i        w_i(x) = d_1i + x (d_2i + (1 − x) (d_3i + x (d_4i + …)))
#
# DOP853 has four rows, DOPRI5 one (Hairer, Nørsett & Wanner, Solving Ordinary Differential Equations I, II.6, and their
# codes). Here y(x) = y + h Σ β_i(x) K_i gives rates, and their integral α_i = ∫ β_i gives angles. An added cubic
# polynomial matches the angles at the end of the step, which have a higher order.


def polynomials(b: Sequence[Fraction], ends: Sequence[Fraction], rows: Sequence[Sequence[Fraction]]) -> Array:
    """Coefficients of β_i / x and of α_i / x² (2, s + 1 + e, powers), lowest power first.

    The step ends at q + h q̇ + h² Σ ends_i K_i and q̇ + h Σ b_i K_i; `rows` contains the rows of d.
    """
    s, stages = len(b), len(rows[0])
    powers = max(4, len(rows) + 3)
    once, twice, zeros = list[Polynomial](), list[Polynomial](), [Fraction(0)] * powers
    for i in range(stages):
        β = _weight(b[i] if i < s else Fraction(0), i == 0, i == s, [row[i] for row in rows])
        α: Polynomial = polyint(β)
        left = (ends[i] if i < s else Fraction(0)) - _value(α, Fraction(1))
        α = polyadd(α, _polynomial(0, 0, 3 * left, -2 * left))
        once.append([*β[1:], *zeros][:powers])
        twice.append([*α[2:], *zeros][:powers])
    return float64([once, twice])


def _weight(b: Fraction, first: bool, last: bool, d: Sequence[Fraction]) -> Polynomial:
    """β_i of a stage with weight b: the `first` stage, the derivative at the end (`last`), or another."""
    x, rest = _polynomial(0, 1), _polynomial(1, -1)
    bump = polymul(x, rest)
    β: Polynomial = _polynomial(0, 0, 3 * b, -2 * b)
    if first:
        β = polyadd(β, polymul(bump, rest))
    if last:
        β = polysub(β, polymul(x, bump))
    w: Polynomial = [Fraction(0)]
    for m in range(len(d) - 1, -1, -1):
        w = polyadd([d[m]], polymul(x if m % 2 == 0 else rest, w))
    return polyadd(β, polymul(polymul(bump, bump), w))


def _polynomial(*coefficients: int | Fraction) -> list[Fraction]:
    return [Fraction(x) for x in coefficients]
