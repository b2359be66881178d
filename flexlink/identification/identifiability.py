"""What data can tell, before any is fitted: from slopes at the start and the noise that is stated.

    J = ∂(data / noise)/∂x = U S Vᵀ

A direction v in which the expected standard deviation 1/s is a whole factor e, or s is no more than the error of J, is
not held by the data: a number without effect, or a combination that changes nothing that was measured.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array

WIDE = 1.96
"""Half of a 95 % interval over its standard deviation."""
COUNTS = 0.2
"""Share of the largest effect among a direction's numbers that makes another one part of it."""
EQUAL = 1e-6
"""Relative difference up to which sizes are equal, and the problem's order decides: slopes are known to no more."""


class Direction(NamedTuple):
    """A combination of numbers that is hardly identifiable.

    Attributes
    ----------
    names
        The numbers in it, the one with the largest part first.
    parts
        How far each goes.
    deviation
        Expected standard deviation along it, a part of the numbers or of their units.
    lost
        Whether it is not identifiable at all.
    why
        What its numbers do move, if that is known; "" else.
    """

    names: tuple[str, ...]
    parts: tuple[float, ...]
    deviation: float
    lost: bool
    why: str = ""

    @property
    def text(self) -> str:
        """A sentence."""
        if len(self.names) == 1:
            if not np.isfinite(self.deviation):
                return f"{self.names[0]} has no effect on the data{self.why}"
            how = "has too weak an effect on the data" if self.lost else "is hardly held by the data"
            return f"{self.names[0]} {how}: expected ± {WIDE * 100 * self.deviation:.2g} % (95 %){self.why}"
        how = "cannot be told apart" if self.lost else "can hardly be told apart"
        moved = ", ".join(
            f"{name} {10 * p / self.parts[0]:+.2g} %" for name, p in zip(self.names, self.parts, strict=True)
        )
        return f"{' and '.join(self.names)} {how}: {moved} changes nothing that was measured by more than its noise"


class Check(NamedTuple):
    """What the data can tell.

    Attributes
    ----------
    names
        Parameters: numbers of the scene, then gains and biases.
    singular_values
        Of the slopes over the noise, largest first.
    directions
        Combinations that are hardly identifiable, the worst first.
    expected
        Expected standard deviation of each, a part of the number or of its unit; inf of one that is not held.
    notes
        What was found of columns, rates and noise.
    error
        Error of the slopes, a norm.
    """

    names: tuple[str, ...]
    singular_values: Array
    directions: tuple[Direction, ...]
    expected: Array
    notes: tuple[str, ...] = ()
    error: float = 0.0

    @property
    def lost(self) -> tuple[Direction, ...]:
        """Combinations that are not identifiable: the fit is refused."""
        return tuple(one for one in self.directions if one.lost)

    @property
    def passed(self) -> bool:
        """Whether every number can be found."""
        return not self.lost


def checked(J: Array, error: float, names: Sequence[str], notes: Sequence[str] = ()) -> Check:
    """Judge slopes J of all residuals, shape (data, all), known up to `error`, of each column a large change's.

    A number without effect stands alone; combinations of the others are as short as they can be. Nothing here
    depends on the basis in which rounding gives directions of equal effect, nor on its order and signs.
    """
    nothing_from = 100.0  # half of an expected interval; a search tries ± 6.9 at most, rounding of slopes gives 1e5
    weak_from = 0.1  # the same from which on it is reported
    free = 1.0  # expected deviation of a direction, a part of its numbers, from which on it is lost
    unknown = 10 * error
    least, nothing = max(1 / free, unknown), max(WIDE / nothing_from, unknown)

    def deviation(effect: float) -> float:
        return 1 / effect if effect > nothing else np.inf

    size = np.linalg.norm(J, axis=0)
    moved = np.flatnonzero(size > least)
    directions = [
        Direction((names[k],), (1.0,), deviation(float(size[k])), True) for k in np.flatnonzero(size <= least).tolist()
    ]
    some = J[:, moved]
    _, s, V = np.linalg.svd(np.vstack([some, np.zeros((len(moved),) * 2)]), full_matrices=False)
    lost = s <= least
    of_some = [names[k] for k in moved.tolist()]
    for v in _short(V[lost]):
        along = float(np.linalg.norm(some @ v))
        directions.append(_direction(of_some, v, size[moved], deviation(along), lost=True))
    weak = np.flatnonzero(~lost & (s < 1 / weak_from))[::-1]
    for equal in np.split(weak, np.flatnonzero(np.diff(s[weak]) > EQUAL * s[weak[1:]]) + 1):
        for v in _short(V[equal]):
            directions.append(_direction(of_some, v, size[moved], 1 / float(s[equal[0]]), lost=False))
    expected = np.full(len(names), np.inf)
    unheld = (V[lost] ** 2).sum(axis=0) > COUNTS**2 / 10
    expected[moved] = np.where(unheld, np.inf, np.sqrt((V[~lost].T ** 2 / s[~lost] ** 2).sum(axis=1)))
    return Check(
        tuple(names), np.append(s, np.zeros(len(names) - len(s))), tuple(directions), expected, tuple(notes), error
    )


def _largest(sizes: Array) -> int:
    """Where the largest of sizes is, the first of equal ones."""
    return int(np.flatnonzero(sizes >= (1 - EQUAL) * sizes.max())[0])


def _short(basis: Array) -> Array:
    """Directions of unit length that span the same, with as many zeros as elimination finds.

    Pivots are the numbers that lie farthest in what they span, one after the other, whatever basis is given.
    """
    left, pivots = basis.copy(), []
    for _ in basis:
        pivots.append(_largest(np.linalg.norm(left, axis=0)))
        along = left[:, pivots[-1]] / np.linalg.norm(left[:, pivots[-1]])
        left -= np.outer(along, along @ left)
    rows = np.linalg.solve(basis[:, sorted(pivots)], basis)
    return np.asarray(rows / np.linalg.norm(rows, axis=1)[:, None])


def _direction(names: Sequence[str], v: Array, effects: Array, deviation: float, lost: bool) -> Direction:
    """The numbers in it are those whose effects on the data cancel, or would be noticed alone; the first goes up."""
    effect = np.abs(v) * effects
    rest, order = np.where(effect > COUNTS * effect.max(), np.abs(v), 0.0), []
    while rest.any():
        order.append(_largest(rest))
        rest[order[-1]] = 0.0
    v = v * np.sign(v[order[0]])
    return Direction(tuple(names[k] for k in order), tuple(float(v[k]) for k in order), float(deviation), lost)
