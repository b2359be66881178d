"""Exact polynomials, given as lists of Fractions with the lowest power first, and exact sums of products."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction

import numpy as np

from flexlink.common.types import Array

Polynomial = list[Fraction]


def add(p: Polynomial, q: Polynomial) -> Polynomial:
    """p + q; p must not be shorter than q."""
    return [x + (q[k] if k < len(q) else 0) for k, x in enumerate(p)]


def multiply(p: Polynomial, q: Polynomial) -> Polynomial:
    """Product p q."""
    product = [Fraction(0)] * (len(p) + len(q) - 1)
    for i, x in enumerate(p):
        for k, y in enumerate(q):
            product[i + k] += x * y
    return product


def evaluate(p: Polynomial, x: Fraction) -> Fraction:
    """p(x) by Horner's rule."""
    value = Fraction(0)
    for coefficient in reversed(p):
        value = value * x + coefficient
    return value


def derivative(p: Polynomial) -> Polynomial:
    """Derivative p'."""
    return [k * x for k, x in enumerate(p)][1:]


def integral(p: Polynomial) -> Polynomial:
    """The integral of p, zero at 0."""
    return [Fraction(0), *(x / (k + 1) for k, x in enumerate(p))]


def lagrange(nodes: Sequence[Fraction]) -> list[Polynomial]:
    """Lagrange polynomials ℓ_j with ℓ_j(c_i) = δ_ij at the nodes c_i."""
    basis = []
    for j, x in enumerate(nodes):
        p = [Fraction(1)]
        for other in (*nodes[:j], *nodes[j + 1 :]):
            p = [y / (x - other) for y in multiply(p, [-other, Fraction(1)])]
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
