"""Uncertainty of a comparison with a measurement, in the terms of ASME V&V 20.

    E = S − D,        u_val² = u_num² + u_input² + u_D²

S is what the simulation says, D what was measured. All u are standard uncertainties, in the unit of S.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, get_args

Verdict = Literal["validated to u_val", "not validated", "cannot be told"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

COVERAGE = 2.0
"""Of an interval of 95 %: its half width over the standard uncertainty."""

SAFETY, SAFETY_UNORDERED = 1.25, 3.0
"""Roache's factors of the grid convergence index: with an observed order, and without one that could be trusted."""

ONE_SIDED = 1.15
"""Half width of a grid convergence index over its standard uncertainty (V&V 20): the error has a known sign."""


def standard(half_width: float) -> float:
    """Standard uncertainty of a value of which only its bounds are known, ± half_width: a rectangular distribution."""
    return half_width / math.sqrt(3.0)


class Convergence(NamedTuple):
    """What three grids, each twice as fine, say of the finest.

    Attributes
    ----------
    order
        Observed, ln((S₁ − S₂)/(S₂ − S₄)) / ln 2; nan where the differences change sign, or do not shrink.
    grid_index
        Grid convergence index of the finest, in the unit of S: its error is at most this.
    """

    order: float
    grid_index: float

    @classmethod
    def stated(cls, u_num: float) -> Convergence:
        """Of a code that tells its own standard uncertainty."""
        return cls(math.nan, ONE_SIDED * u_num)

    @property
    def u_num(self) -> float:
        """Standard uncertainty."""
        return self.grid_index / ONE_SIDED


def grid_convergence(coarse: float, middle: float, fine: float, formal: float, rounding: float = 0.0) -> Convergence:
    """Grid convergence index of S₄ from S₁, S₂, S₄ with N, 2N, 4N hinges or steps (Roache 1994).

    An order above the `formal` one is luck, and does not make the index smaller. Without an order the largest of the
    differences, times 3, is what the error may be; `rounding` is the least that it can be.
    """
    first, second = middle - coarse, fine - middle
    if first * second > 0 and abs(second) < abs(first):
        order = math.log2(first / second)
        return Convergence(order, max(SAFETY * abs(second) / (2 ** min(order, formal) - 1), rounding))
    return Convergence(math.nan, max(SAFETY_UNORDERED * max(abs(first), abs(second)), rounding))


class Comparison(NamedTuple):
    """A measured quantity beside the simulated one; all in its unit.

    Attributes
    ----------
    simulated, measured
        S and D.
    convergence
        What the grids say.
    u_input, u_measured
        From the tolerances of the inputs, and of D itself.
    wanted
        The largest |E| that the use allows: a comparison that is less certain than this tells nothing.
    """

    simulated: float
    measured: float
    convergence: Convergence
    u_input: float
    u_measured: float
    wanted: float

    @property
    def error(self) -> float:
        """E = S − D."""
        return self.simulated - self.measured

    @property
    def u_val(self) -> float:
        """Validation uncertainty."""
        return math.hypot(self.convergence.u_num, self.u_input, self.u_measured)

    @property
    def verdict(self) -> Verdict:
        """In words.

        "not validated": |E| > 2 u_val, so that the model is wrong by at least |E| − 2 u_val. "cannot be told": E is
        within what data, inputs and grid explain, but that is more than what is wanted. Else "validated to u_val".
        """
        within = COVERAGE * self.u_val
        if not abs(self.error) <= within:  # so is nan
            return "not validated"
        return "validated to u_val" if within <= self.wanted else "cannot be told"

    def words(self, unit: str) -> str:
        """One line with every number of it."""
        _, index = self.convergence
        order = "no order" if math.isnan(self.convergence.order) else f"order {self.convergence.order:.2f}"
        return (
            f"S = {self.simulated:.5g}, D = {self.measured:.5g}, E = {self.error:+.3g} {unit}; "
            f"u_num = {self.convergence.u_num:.2g} (grid convergence index {index:.2g}, {order}), "
            f"u_input = {self.u_input:.2g}, u_D = {self.u_measured:.2g}, u_val = {self.u_val:.2g} {unit}: "
            f"{self.verdict}."
        )
