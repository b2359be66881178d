"""Uncertainty of a comparison with a measurement, in the terms of ASME V&V 20.

    E = S − D,        u_val² = u_num² + u_input² + u_D²

S is the simulated value, D the measured one. All u are standard uncertainties in the unit of S: of E (u_val), due to
discretization (u_num), due to the inputs' tolerances (u_input), and of D (u_D).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from scipy.stats import t as student

from flexlink.common.types import Array

Verdict = Literal["validated to u_val", "not validated", "cannot be told"]
VERDICTS: tuple[Verdict, ...] = get_args(Verdict)

COVERAGE = 2.0
"""Coverage factor of a 95 % interval, its half width divided by the standard uncertainty."""

SAFETY, SAFETY_UNORDERED = 1.25, 3.0
"""Safety factors of Roache's grid convergence index: with an observed order, and without a reliable one."""

ONE_SIDED = 1.15
"""Ratio of the grid convergence index to the standard uncertainty (V&V 20), for an error of known sign."""


def standard(half_width: float) -> float:
    """Standard uncertainty of a value known only within ± half_width: a rectangular distribution."""
    return half_width / math.sqrt(3.0)


def of_mean(values: Sequence[float] | Array) -> float:
    """Standard uncertainty of the mean of a few values: half of Student's 95 % interval, over the coverage factor.

    With s, the deviation of n values, u = t s / (2 √n), where t is the 97.5 % point for n − 1 degrees of freedom:
    4.30 for 3 values, 2.78 for 5.
    """
    n = len(values)
    return float(student.ppf(0.975, n - 1) * np.std(values, ddof=1) / math.sqrt(n)) / COVERAGE


def of_one(values: Sequence[float]) -> float:
    """Standard uncertainty of one more value like a few others: half of Student's 95 % interval about one of them."""
    return of_mean(values) * math.sqrt(len(values))


class Convergence(NamedTuple):
    """Discretization error of S₄ on the finest of three grids; S₁, S₂, S₄ are computed with N, 2 N and 4 N hinges.

    Attributes
    ----------
    order
        Observed order, ln((S₁ − S₂)/(S₂ − S₄)) / ln 2; nan if the differences change sign or do not decrease.
    grid_index
        Grid convergence index of the finest grid, in the unit of S: a bound of its error.
    """

    order: float
    grid_index: float

    @property
    def u_num(self) -> float:
        """Standard numerical uncertainty."""
        return self.grid_index / ONE_SIDED


def grid_convergence(coarse: float, middle: float, fine: float, formal: float, rounding: float = 0.0) -> Convergence:
    """Grid convergence index of S₄ from S₁, S₂, S₄ with N, 2N, 4N hinges or steps (Roache 1994).

    An observed order above the `formal` one is ignored. If no order is observed, the index is 3 times the largest
    difference. The index is at least `rounding`.
    """
    first, second = middle - coarse, fine - middle
    if first * second > 0 and abs(second) < abs(first):
        order = math.log2(first / second)
        return Convergence(order, max(SAFETY * abs(second) / (2 ** min(order, formal) - 1), rounding))
    return Convergence(math.nan, max(SAFETY_UNORDERED * max(abs(first), abs(second)), rounding))


class Comparison(NamedTuple):
    """A measured quantity and its simulated value, in the same unit.

    Attributes
    ----------
    simulated, measured
        S and D.
    convergence
        Result of the grid convergence study.
    u_input, u_measured
        Standard uncertainties due to the tolerances of the inputs, and of D.
    wanted
        The largest |E| that the application allows; if the uncertainty is larger, there is no verdict.
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
        """The verdict in words.

        "not validated" means |E| > 2 u_val, so the model error is at least |E| − 2 u_val. "cannot be told" means that
        data, inputs and grid explain E, but their uncertainty exceeds `wanted`. Otherwise "validated to u_val".
        """
        within = COVERAGE * self.u_val
        if not abs(self.error) <= within:  # also if nan
            return "not validated"
        return "validated to u_val" if within <= self.wanted else "cannot be told"

    def words(self, unit: str) -> str:
        """One line with all numbers; if validated, with the accuracy that this shows, which is 2 u_val and not E."""
        _, index = self.convergence
        shown = f" (accuracy ± {100 * COVERAGE * self.u_val / abs(self.measured):.2g} %)"
        order = "no order" if math.isnan(self.convergence.order) else f"order {self.convergence.order:.2f}"
        return (
            f"S = {self.simulated:.5g}, D = {self.measured:.5g}, E = {self.error:+.3g} {unit}; "
            f"u_num = {self.convergence.u_num:.2g} (grid convergence index {index:.2g}, {order}), "
            f"u_input = {self.u_input:.2g}, u_D = {self.u_measured:.2g}, u_val = {self.u_val:.2g} {unit}: "
            f"{self.verdict}{shown if self.verdict == VERDICTS[0] else ''}."
        )
