"""An estimated parameter: value, 95 % interval, the parts of its error, and its verdict."""

from __future__ import annotations

import dataclasses
import math

from flexlink.common.errors import Diagnostic


@dataclasses.dataclass(frozen=True)
class Estimate:
    """An estimated parameter.

    Attributes
    ----------
    name, path
        Name of the parameter, and its path in the scene; the path of a gain or a bias is "".
    start, value
        Initial guess and estimate, in the unit of the path.
    low, high
        95 % interval, which accounts for the autocorrelation of the residuals; infinite if not identifiable.
    deviation
        Standard deviation.
    at_bound
        Whether the search ended at a bound.
    widened
        Whether the interval is wider than the linear estimate, because the likelihood is far from quadratic.
    profile
        Profile interval, for which this parameter is fixed and all others are refitted; None if not requested.
    unit
        Unit of all these values; "" for a dimensionless number.
    log
        Whether the logarithm was estimated.
    between
        Lower and upper bound of the search.
    prior
        Mean and standard deviation of the prior, if there is one.
    u_num
        Error due to the number of segments, which the interval and the deviation contain.
    u_input
        Error due to noise and filter of recorded motions, also contained.
    statistical
        Half the width of the interval without these two errors; infinite if none was estimated.
    """

    name: str
    path: str
    start: float
    value: float
    low: float
    high: float
    deviation: float
    at_bound: bool = False
    widened: bool = False
    profile: tuple[float, float] | None = None
    unit: str = ""
    log: bool = False
    between: tuple[float, float] = (-math.inf, math.inf)
    prior: tuple[float, float] | None = None
    u_num: float = 0.0
    u_input: float = 0.0
    statistical: float = math.inf

    def shifted(self, error: float) -> str:
        """An error in words, relative to the value if it is not zero."""
        return f"{self.name} by " + (f"{100 * error / abs(self.value):.2g} %" if self.value else f"{error:.2g}")

    @property
    def half(self) -> float:
        """Half the width of the 95 % interval."""
        return (self.high - self.low) / 2

    @property
    def doubt(self) -> Diagnostic | None:
        """Why the parameter is not identifiable from the data; None if it is identifiable.

        The 95 % interval reaches a bound, or spans more than a factor of 10 for a positive parameter; or the error due
        to the number of segments or to a recorded motion exceeds half the interval; or the prior determines the
        estimate more than the data do, that is, the variance is more than half the prior's variance.
        """
        widest = 10.0  # largest ratio of the interval's ends
        low, high = self.between
        by_prior = self.prior is not None and self.deviation**2 > self.prior[1] ** 2 / 2
        doubts = (
            (not math.isfinite(self.half), Diagnostic("the interval is unbounded", "unbounded-interval")),
            (self.at_bound, Diagnostic("the estimate is at a bound", "estimate-at-bound")),
            (self.low <= low or self.high >= high, Diagnostic("the interval reaches a bound", "interval-at-bound")),
            (self.log and self.high > widest * self.low,
             Diagnostic(f"the interval spans more than a factor of {widest:g}", "wide-interval")),
            (self.u_num > self.statistical, Diagnostic("its grid error exceeds half its 95 % interval", "grid-error")),
            (self.u_input > self.statistical,
             Diagnostic("its input error exceeds half its 95 % interval", "input-error")),
            (by_prior, Diagnostic("its prior determines the estimate more than the data do", "prior-dominated")),
        )  # fmt: skip
        return next((doubt for applies, doubt in doubts if applies), None)

    @property
    def verdict(self) -> str:
        """Result of the check: "identifiable", or "not identifiable" or "inaccurate" with the reason."""
        if self.doubt is None:
            return "identifiable"
        inaccurate = self.doubt.id in ("grid-error", "input-error")
        return f"{'inaccurate' if inaccurate else 'not identifiable'}: {self.doubt}"

    @property
    def determined(self) -> bool:
        """Whether the parameter is known from the data or its prior."""
        return self.doubt is None or self.doubt.id == "prior-dominated"
