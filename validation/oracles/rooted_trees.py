"""Order conditions of Runge-Kutta methods by rooted trees (Butcher; Hairer, Nørsett & Wanner, I, section II.2).

A tree is the tuple of its subtrees. A method has order p if b·u(t) = 1/γ(t) for all trees t of up to p nodes, with

    u(t)_i = Π_children (A u(child))_i        γ(t) = |t| Π_children γ(child)        |t| = 1 + Σ |child|
"""

from __future__ import annotations

import functools
from collections.abc import Iterator
from fractions import Fraction
from typing import Any, TypeAlias

from mpmath import mp, mpf

from flexlink.describe.schemes.methods import Method
from validation.oracles.collocation import collocation

Tree: TypeAlias = "tuple[Tree, ...]"
Coefficients: TypeAlias = tuple[list[list[Any]], list[Any]]  # A, b in mpmath
DIGITS = 80


@functools.cache
def trees(order: int) -> tuple[Tree, ...]:
    """All rooted trees with `order` nodes; there are 1, 1, 2, 4, 9, 20, 48, 115, 286, 719, …"""
    return tuple(_forests(order - 1, order - 1))


@functools.cache
def _forests(nodes: int, largest: int) -> tuple[Tree, ...]:
    """All multisets of trees with `nodes` nodes in total, each of at most `largest` nodes."""
    if nodes == 0:
        return ((),)
    return tuple(forest for size in range(1, min(nodes, largest) + 1) for forest in _starting_with(size, nodes))


def _starting_with(size: int, nodes: int) -> Iterator[Tree]:
    """Multisets whose largest tree has `size` nodes; trees of equal size are in the order of `trees`."""
    same = trees(size)
    rank = {tree: k for k, tree in enumerate(same)}
    for first in same:
        for rest in _forests(nodes - size, size):
            if not rest or _nodes(rest[0]) < size or rank[rest[0]] >= rank[first]:
                yield (first, *rest)


@functools.cache
def _nodes(tree: Tree) -> int:
    return 1 + sum(map(_nodes, tree))


@functools.cache
def density(tree: Tree) -> int:
    """γ(t): the node count of the tree times the densities of its subtrees."""
    product = _nodes(tree)
    for child in tree:
        product *= density(child)
    return product


def residuals(method: Coefficients, order: int) -> list[Any]:
    """|b·u(t) − 1/γ(t)| of every tree with `order` nodes, to `DIGITS` digits.

    The elementary weights of smaller trees are cached, so a condition costs one product per stage.
    """
    A, b = method
    stages = range(len(b))

    @functools.cache
    def weight(tree: Tree) -> tuple[Any, ...]:
        u = [mpf(1)] * len(b)
        for child in tree:
            v = below(child)
            u = [x * y for x, y in zip(u, v, strict=True)]
        return tuple(u)

    @functools.cache
    def below(tree: Tree) -> tuple[Any, ...]:
        u = weight(tree)
        return tuple(mp.fsum(A[i][j] * u[j] for j in stages if A[i][j]) for i in stages)

    with mp.workdps(DIGITS):
        return [abs(mp.fdot(b, weight(t)) - mpf(1) / density(t)) for t in trees(order)]


def coefficients(method: Method) -> Coefficients:
    """A and b, from the exact strings of a tableau, or from an independent reference for a family."""
    with mp.workdps(DIGITS):
        if method.family is not None:
            A, b, _ = collocation(method.family, method.stages)
            return A, b
        rows, weights, _ = method.exact
        return [[as_mpf(x) for x in row] for row in rows], [as_mpf(x) for x in weights]


def embedded(method: Method, row: int) -> Coefficients:
    """Embedded method of an explicit method, b̂ = b − e, with e a row of error weights; its end is a stage."""
    with mp.workdps(DIGITS):
        A, b = coefficients(method)
        given = [as_mpf(Fraction(x)) for x in method.error_rows[row]]
        e = given + [mpf(0)] * (len(b) + 1 - len(given))
        A = [[*stage, mpf(0)] for stage in (*A, b)]
        return A, [x - y for x, y in zip([*b, mpf(0)], e, strict=True)]


def inside(method: Method, x: Fraction) -> Coefficients:
    """The dense output of an explicit method at a fraction x of its step, as a method with that shorter step.

    The nested polynomials of Hairer's codes are evaluated for each stage.
    """
    with mp.workdps(DIGITS):
        rows, b = coefficients(method)
        d = [[as_mpf(Fraction(weight)) for weight in row] for row in method.dense_rows]
        beyond = [[as_mpf(Fraction(weight)) for weight in row] for row in method.dense_stages]
        s, stages, part = len(b), len(d[0]), as_mpf(x)
        A = [[*stage, *[mpf(0)] * (stages - len(stage))] for stage in (*rows, b, *beyond)]

        def weight(i: int) -> Any:
            change, first, last = b[i] if i < s else mpf(0), mpf(i == 0), mpf(i == s)
            nested = mpf(0)
            for m in range(len(d) - 1, -1, -1):
                nested = d[m][i] + (part if m % 2 == 0 else 1 - part) * nested
            nested = 2 * change - first - last + (1 - part) * nested
            return change + (1 - part) * (first - change + part * nested)

        return [[a / part for a in stage] for stage in A], [weight(i) for i in range(stages)]


def as_mpf(x: Fraction) -> Any:
    """A fraction as mpf in the working precision."""
    return mpf(x.numerator) / x.denominator
