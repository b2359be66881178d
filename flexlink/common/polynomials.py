"""Exact polynomials, given as Fractions with the lowest power first, and exact sums of products.

Functions of `numpy.polynomial.polynomial` are exact for Fractions, but not if an integer or a float is among them.
"""

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polymul

from flexlink.common.types import Array

Polynomial = Any  # list or array of Fractions, of which NumPy's types know nothing


def lagrange(nodes: Sequence[Fraction]) -> list[Polynomial]:
    """Lagrange polynomials ℓ_j with ℓ_j(c_i) = δ_ij at the nodes c_i."""
    basis = []
    for j, x in enumerate(nodes):
        p: Any = [Fraction(1)]
        for other in (*nodes[:j], *nodes[j + 1 :]):
            p = polymul(p, [-other, Fraction(1)]) / (x - other)
        basis.append(p)
    return basis


def dot(x: Iterable[Fraction], y: Iterable[Fraction]) -> Fraction:
    """Σ x_i y_i over a common denominator, because a plain sum reduces the fraction after every term, which is slow."""
    products = [(a.numerator * b.numerator, a.denominator * b.denominator) for a, b in zip(x, y, strict=True) if a]
    common = math.lcm(*(below for _, below in products))
    return Fraction(sum(above * (common // below) for above, below in products), common)


def float64(exact: Sequence[Fraction] | Sequence[Sequence[Fraction]]) -> Array:
    """Fractions rounded to float64."""
    return np.array(exact, dtype=np.float64)
