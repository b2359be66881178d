"""Stability function R of a Runge-Kutta method, y_new = R(hλ) y for y' = λ y, and the extent of its stability region.

    R(z) = 1 + z b·(1 − zA)⁻¹·1 = P(z) / Q(z)        Q(z) = det(1 − zA)        (Hairer & Wanner, II, IV.3)

A step is stable if |R| ≤ 1 + g. Along a direction d this depends on the sign of a polynomial,

    E_d(x) = (1 + g)² |Q(xd)|² − |P(xd)|² ≥ 0

which for d = i is a polynomial in x². If E_i has no zero and the poles of R lie in the right half-plane, |R| ≤ 1 + g
on the entire left half-plane, by the maximum principle. A Sturm sequence in rational numbers counts the zeros of E_i.
"""

import functools
from collections.abc import Iterable, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.polynomials import dot, float64
from flexlink.common.types import Array, Complex
from flexlink.describe.schemes.methods import Method

Polynomial = list[Fraction]

GROWTH = Fraction(1, 10**6)
"""Growth g of the amplitude per step that still counts as stable: a factor e in a million steps. With g = 0, RK2 would
be unstable for every h, since its amplitude grows by (ω h)⁴/8 per step."""

SQUARE = float((1 + GROWTH) ** 2)
EPS = float(np.finfo(np.float64).eps)


def stability_function(method: Method, z: NDArray[Any]) -> Complex:
    """R(z), with the shape of `z`."""
    P, Q = (np.polynomial.polynomial.polyval(z, float64(p)) for p in stability_polynomials(method))
    return np.asarray(P / Q)


@functools.lru_cache(maxsize=64)
def stability_polynomials(method: Method) -> tuple[Polynomial, Polynomial]:
    """Exact P and Q: as P = R Q has degree s, s + 1 terms of the series R = 1 + Σ b A^(k−1) 1 z^k determine it."""
    A, b, _ = method.exact
    series, power = [Fraction(1)], [Fraction(1)] * method.stages
    for _ in range(method.stages):
        series.append(dot(b, power))
        power = [dot(row, power) for row in A]
    Q = [Fraction(1)] if method.explicit else _determinant(A)
    return np.convolve(series, Q)[: method.stages + 1].tolist(), Q  # type: ignore[type-var]


def stable_reach(method: Method, directions: Complex) -> Array:
    """Largest r with |R(xd)| ≤ 1 + g for 0 ≤ x ≤ r, inf if for all x, at unit complex d (m,) in the left half-plane."""
    if is_stable_everywhere(method):
        return np.full(directions.shape, np.inf)
    if method.explicit:
        return np.array([_reach_of_polynomial(method, d, int(stable_half_disc(method))) for d in directions.tolist()])
    P, Q = (float64(p) for p in stability_polynomials(method))
    return np.array([_first_zero(SQUARE * _square(Q, d) - _square(P, d)) for d in directions])


@functools.lru_cache(maxsize=64)
def _reach_of_polynomial(method: Method, direction: complex, stable: int) -> float:
    """Return `stable_reach` of an explicit method, by a search for zeros of E_d interval by interval.

    E_d has degree 2 s, so 2 s + 1 values determine it. Its coefficients in powers of x suffer from cancellation, which
    grows with the number of stages; values of R computed by the stages do not. The search starts at x = `stable`, below
    which the method is known to be stable, and always ends: if |R| ≤ 1 on [0, x], R'(0) = 1 and the degree is s, then
    x ≤ 2 s² in any direction (Markov's inequality).
    """
    nodes, to_series = _series_of(2 * method.stages)
    for start in range(stable, 2 * method.stages**2 + 1):
        E = SQUARE - np.abs(_by_stages(method, direction * (start + (1 + nodes) / 2))) ** 2
        zeros = _zeros_of_series((np.array([E, E]) @ to_series.T)[0])  # two rows, since BLAS rounds differently for one
        if zeros.size:
            return float(start + (1 + zeros.min()) / 2)
    return 2.0 * method.stages**2


@functools.lru_cache(maxsize=64)
def stable_half_disc(method: Method) -> float:
    """Largest r such that |R(z)| ≤ 1 + g for all |z| ≤ r with Re z ≤ 0, to eight digits, rounded down.

    By the maximum principle it suffices to check the boundary. The imaginary axis is stable up to `stable_reach`; on
    the arc |R(r exp iφ)|² is a polynomial of degree s in cos φ, so s + 1 values determine it. Half discs are nested,
    so bisection works. For implicit methods that are not A-stable r = 0 is returned.
    """
    if is_stable_everywhere(method):
        return np.inf
    if not method.explicit:
        return 0.0
    stable, beyond, close = 0.0, _reach_of_polynomial(method, 1j, 0), 1e-8
    if _is_stable_on_the_arc(method, beyond):
        return beyond
    middle = (1 - close) * beyond  # for many methods the axis is the limit, up to rounding
    while beyond - stable > close * beyond:
        if _is_stable_on_the_arc(method, middle):
            stable = middle
        else:
            beyond = middle
        middle = (stable + beyond) / 2
    return stable


def _is_stable_on_the_arc(method: Method, r: float) -> bool:
    nodes, to_series = _series_of(method.stages)
    cosine = (nodes - 1) / 2
    E = SQUARE - np.abs(_by_stages(method, r * (cosine + 1j * np.sqrt(1 - cosine**2)))) ** 2
    return bool((E > 0).all()) and not _zeros_of_series(to_series @ E).size


@functools.cache
def _series_of(degree: int) -> tuple[NDArray[Any], Array]:
    """Nodes in [−1, 1], and the matrix that maps values of a polynomial there to its Chebyshev coefficients."""
    nodes = np.polynomial.chebyshev.chebpts1(degree + 1)
    return nodes, np.asarray(np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, degree)), dtype=np.float64)


def _by_stages(method: Method, z: NDArray[Any]) -> Complex:
    """R(z) = 1 + z Σ b_i Y_i of an explicit method, from its stages Y_i = 1 + z Σ a_ij Y_j."""
    A, b, _ = method.arrays
    stages: list[Complex] = []
    for row in (*A, b):
        stages.append(1 + z * sum(a * Y for a, Y in zip(row, stages, strict=False) if a))
    return stages[-1]


def _zeros_of_series(series: Array) -> Array:
    """Real zeros in [−1, 1] of Σ c_k T_k; none if |c_0| exceeds the sum of the other |c_k|, since |T_k| ≤ 1."""
    size = np.abs(series)
    if series[0] > size[1:].sum():
        return np.empty(0)
    zeros = np.polynomial.chebyshev.chebroots(np.polynomial.chebyshev.chebtrim(series, EPS * size.max()))
    return np.asarray(zeros[(zeros.imag == 0) & (np.abs(zeros) <= 1)].real)


@functools.lru_cache(maxsize=64)
def is_stable_everywhere(method: Method) -> bool:
    """Whether |R| ≤ 1 + g on the left half-plane; `Method` ensures that the poles of R, 1/λ(A), are not there."""
    if method.explicit:  # R is a polynomial
        return False
    P, Q = stability_polynomials(method)
    square = (1 + GROWTH) ** 2
    return not _positive_zeros(_trimmed(square * x - y for x, y in zip(_along_i(Q), _along_i(P), strict=True)))


def _along_i(p: Polynomial) -> Polynomial:
    """|p(iy)|² in powers of y²: the even powers of p(iy) p(−iy); its odd powers vanish."""
    turned = np.convolve(p, [(-1) ** k * x for k, x in enumerate(p)])  # p(z) p(−z), even; z² = −y²
    return [(-1) ** k * x for k, x in enumerate(turned[::2])]


def _positive_zeros(p: Polynomial) -> int:
    """Number of distinct zeros x > 0 of p, by a Sturm sequence; requires p(0) ≠ 0."""
    sequence = [p, [k * x for k, x in enumerate(p)][1:]]
    while len(sequence[-1]) > 0:
        sequence.append([-x for x in _remainder(sequence[-2], sequence[-1])])
    ends = ([q[end] for q in sequence[:-1] if q[end] != 0] for end in (0, -1))  # signs at 0 and at infinity
    at_zero, at_infinity = (sum(x * y < 0 for x, y in pairwise(signs)) for signs in ends)
    return at_zero - at_infinity


def _remainder(p: Polynomial, q: Polynomial) -> Polynomial:
    """Remainder of p / q, scaled by a positive number to a leading coefficient of ±1."""
    p = list(p)
    while len(p) >= len(q):
        factor, shift = p[-1] / q[-1], len(p) - len(q)
        p = _trimmed(x - (factor * q[k - shift] if k >= shift else 0) for k, x in enumerate(p[:-1]))
    return [x / abs(p[-1]) for x in p]


def _trimmed(p: Iterable[Fraction]) -> Polynomial:
    """Remove zero coefficients of the highest powers."""
    found = list(p)
    while found and found[-1] == 0:
        found.pop()
    return found


def _determinant(A: Sequence[Sequence[Fraction]]) -> Polynomial:
    """det(1 − zA) by the Faddeev-LeVerrier algorithm: M_1 = 1, c_k = −tr(A M_k) / k, M_k+1 = A M_k + c_k 1."""
    stages = range(len(A))
    M, c = [[Fraction(i == j) for j in stages] for i in stages], [Fraction(1)]
    for k in range(1, len(A) + 1):
        columns = list(zip(*M, strict=True))
        M = [[dot(row, column) for column in columns] for row in A]
        c.append(-sum((M[i][i] for i in stages), Fraction(0)) / k)
        for i in stages:
            M[i][i] += c[k]
    return c


def _square(p: Array, d: complex) -> Array:
    """|p(xd)|² in powers of x."""
    along = p * d ** np.arange(len(p))
    return np.asarray(np.convolve(along, along.conj()).real)


def _first_zero(p: Array) -> float:
    """Smallest x > 0 with p(x) = 0; inf if there is none. Rounding decides whether a double zero is found."""
    zeros = np.roots(p[::-1])
    return float(zeros[(zeros.imag == 0) & (zeros.real > 0)].real.min(initial=np.inf))
