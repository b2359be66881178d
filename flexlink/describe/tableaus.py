"""Explicit Runge-Kutta methods as data: exact coefficient strings, stages, order, source."""

from __future__ import annotations

import re
from fractions import Fraction
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.describe import catalogue
from flexlink.describe.spec import Spec, short

Array = NDArray[np.float64]


COEFFICIENT = re.compile(r"[+-]?\d+(/0*[1-9]\d*|(\.\d*)?([eE][+-]?\d{1,2})?)")
"""Short exponents: a Fraction of "1e999999999" would take all the memory there is."""


class Tableau(Spec, frozen=True):
    """Butcher tableau of an explicit method; coefficients are decimal strings or fractions such as "1/6".

    Raises
    ------
    SceneError
        A coefficient is not a number, or the rows do not form a strictly lower triangle with c_i = Σ_j a_ij.
    """

    about: str
    source: str
    order: Annotated[int, msgspec.Meta(ge=1)]
    c: tuple[str, ...]
    b: tuple[str, ...]
    A: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        stages = len(self.c)
        if len(self.b) != stages or [len(row) for row in self.A] != list(range(stages)):
            raise SceneError(f"A, b, c: {stages} stages need b of {stages} and rows of A of 0, 1, …, {stages - 1}")
        for x in (*self.b, *self.c, *(x for row in self.A for x in row)):
            if not COEFFICIENT.fullmatch(x):
                raise SceneError(f"A, b, c: {short(x)}: a coefficient is a decimal or a fraction such as '1/6'")
        A, b, c = self.exact
        if abs(sum(b, Fraction(0)) - 1) > Fraction(1, 10**15):
            raise SceneError(f"b = {short(self.b)}: must sum to 1")
        for i, row in enumerate(A):
            if abs(sum(row, Fraction(0)) - c[i]) > Fraction(1, 10**15):
                raise SceneError(f"A[{i}] = {short(self.A[i])}: must sum to c[{i}] = {short(self.c[i])}")

    @property
    def stages(self) -> int:
        """Number of evaluations of the right-hand side in a step."""
        return len(self.c)

    @property
    def exact(self) -> tuple[list[list[Fraction]], list[Fraction], list[Fraction]]:
        """A (square, strictly lower), b and c as exact fractions of their strings."""
        rows = [[Fraction(x) for x in row] for row in self.A]
        b, c = [Fraction(x) for x in self.b], [Fraction(x) for x in self.c]
        return [row + [Fraction(0)] * (len(c) - len(row)) for row in rows], b, c

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """A (s, s), b (s,), c (s,), each rounded once to float64."""
        A, b, c = self.exact
        return np.array(A, dtype=np.float64), np.array(b, dtype=np.float64), np.array(c, dtype=np.float64)


def tableau(name: str) -> Tableau:
    """Load a method that comes with flexlink ("RK2", "RK4", "RK10"), or the user's own TOML file.

    Raises
    ------
    ArgumentError
        Unknown name.
    DataFileError
        A file that is not a valid tableau.
    """
    return catalogue.load("tableaus", "method", name, Tableau)
