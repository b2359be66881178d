"""Families of lumping rules that a study refines: which hinges they have, and how fast their errors fall with more."""

from __future__ import annotations

from typing import NamedTuple


class Family(NamedTuple):
    """Rules of one kind, for any number of hinges that the family has."""

    order: float  # by which errors of the tip's path fall
    asymptotic: int  # hinges from which they do
    safe: float  # change of the extrapolated limit over its error, at least
    step: int  # its numbers of hinges beyond two are multiples of this

    def rounded_up(self, hinges: int) -> int:
        """The least number of hinges that the family has, of so many or more."""
        return hinges if hinges <= FEW else -(-hinges // self.step) * self.step

    def fewer(self, hinges: int) -> set[int]:
        """Numbers of hinges to try in place of so many, 0 of a rigid link among them."""
        tried = (hinges - 1, hinges - 2, 0) if self.step == 1 else (0, 1, FEW, hinges - self.step)
        return {count for count in tried if 0 <= count < hinges}


FEW = 2
"""Hinges up to which every number is tried, whatever the family."""

GAUSS = "gauss"
"""The family that every study begins with."""

FAMILIES = {
    # safe: measured on 22 scenes; of cells taken from gauss, and held by the tests of advice on finer models
    GAUSS: Family(order=2.0, asymptotic=6, safe=1.5, step=1),
    "legendre": Family(order=2.0, asymptotic=6, safe=1.2, step=1),
    "lobatto": Family(order=4.0, asymptotic=12, safe=1.5, step=4),
}


def rule_of(family: str, hinges: int) -> str:
    """The lumping rule of a family for so many hinges.

    `gauss` takes even numbers, cells are of four hinges, or of two; a single hinge is in the middle.
    """
    if hinges == 1:
        return "midpoint"
    if family == "lobatto":
        return "lobatto2" if hinges % 4 else "lobatto4"
    return "legendre" if hinges % 2 else family
