"""Families of lumping rules for a refinement study: their numbers of hinges, and the orders of their errors."""

from __future__ import annotations

from typing import NamedTuple


class Family(NamedTuple):
    """Lumping rules of one kind, for all numbers of hinges that the family offers."""

    order: float  # order of the errors of the tip's path
    order_in_space: float  # the same, in large bending in space
    asymptotic: int  # smallest number of hinges from which on errors fall with this order
    safe: float  # lower bound of the change of the extrapolated limit, relative to the error of the limit
    step: int  # numbers of hinges above two are multiples of this

    def rounded_up(self, hinges: int) -> int:
        """Smallest number of hinges that the family offers and that is at least `hinges`."""
        return hinges if hinges <= FEW else -(-hinges // self.step) * self.step

    def fewer(self, hinges: int) -> set[int]:
        """Smaller numbers of hinges to try; 0 makes the link rigid."""
        tried = (hinges - 1, hinges - 2, 0) if self.step == 1 else (0, 1, FEW, hinges - self.step)
        return {count for count in tried if 0 <= count < hinges}


FEW = 2
"""In every family, all numbers of hinges up to this one are tried."""

GAUSS = "gauss"
"""The family that every study starts with."""

FAMILIES = {
    # `safe` was measured on 22 scenes; cells use the value of gauss, which tests of advice check with finer models
    GAUSS: Family(order=2.0, order_in_space=2.0, asymptotic=6, safe=1.5, step=1),
    "legendre": Family(order=2.0, order_in_space=2.0, asymptotic=6, safe=1.2, step=1),
    "lobatto": Family(order=4.0, order_in_space=2.0, asymptotic=12, safe=1.5, step=4),
}


def rule_of(family: str, hinges: int) -> str:
    """The lumping rule of a family for this number of hinges.

    `gauss` needs an even number of hinges. Cells have four hinges or two. A single hinge is at the middle of the link.
    """
    if hinges == 1:
        return "midpoint"
    if family == "lobatto":
        return "lobatto2" if hinges % 4 else "lobatto4"
    return "legendre" if hinges % 2 else family
