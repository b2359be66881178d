"""Result of a fit: estimates with intervals, errors and verdicts, residuals, the fitted scene, JSON."""

import dataclasses
import math
from pathlib import Path
from types import ModuleType
from typing import Any

from flexlink.common.errors import Diagnostic
from flexlink.common.notebook import builder, html_table
from flexlink.common.output import write_text
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list
from flexlink.data.documents import in_json, require_path
from flexlink.describe.scene import Scene
from flexlink.dynamics.result import Result
from flexlink.identification.block import unit_in
from flexlink.identification.identifiability import Check
from flexlink.identification.problem import FitProblem
from flexlink.pages.verdict import Report


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


@dataclasses.dataclass(frozen=True, eq=False)
class FittedColumn:
    """Measurements and predictions of one column of a run, or of single measurements of one kind.

    Attributes
    ----------
    source, name, use
        Run, column with its SI unit, and whether it was fitted or checked.
    t
        Times [s]; None for single measurements.
    measured, before, after, linear
        Measurements; predictions of the scene before and after the fit; predictions of a free linear model, or None.
    gain, bias
        Optimal scale and offset.
    noise
        Standard deviation of the noise, stated or estimated from the residuals.
    stated
        Whether the problem states the noise.
    times_noise
        Root mean square of the residuals, each divided by the standard deviation of its noise.
    whiteness
        P-value of the residuals' whiteness (Ljung-Box); nan for single measurements.
    floor, floor_from
        Standard deviation of the noise from elsewhere than the residuals, and from where; None and "" if not known.
    within
        Whether the residuals of a fitted column are no more than this noise; None if this cannot be told.
    """

    source: str
    name: str
    use: str
    t: Array | None
    measured: Array
    before: Array
    after: Array
    linear: Array | None
    gain: float
    bias: float
    noise: float
    stated: bool
    times_noise: float
    whiteness: float
    floor: float | None = None
    floor_from: str = ""
    within: bool | None = None

    @property
    def unit(self) -> str:
        """Unit of the values."""
        return unit_in(self.name)

    def off(self, model: Array) -> float:
        """Root mean square (RMS) residual of a prediction."""
        return float(math.sqrt(((model - self.measured) ** 2).mean()))

    def residual(self, model: Array) -> float:
        """RMS residual, but at least the accuracy of the search, so that two fits of exact data are equally good."""
        share = 1e-7  # accuracy relative to the measurements, as parameters converge to 1e-8 of their values
        return max(self.off(model), share * float(abs(self.measured).max()))

    def fit(self, model: Array | None) -> float:
        """Fit 1 − |residual| / |measured − mean| [%]; nan for single measurements."""
        if model is None or self.t is None:
            return math.nan
        spread = float(self.measured.std())
        return 100 * (1 - self.off(model) / spread) if spread else math.nan

    @property
    def unexplained(self) -> float:
        """Share of the signal that the fitted scene leaves, |residual| / |measured − mean| [%]; nan as in `fit`."""
        return 100 - self.fit(self.after)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fitted(Result):
    """Result of a fit.

    Attributes
    ----------
    problem
        The problem.
    scene
        The scene with the estimates of the parameters of all runs.
    numbers
        Estimates: parameters of the scene, parameters of single runs, gains and biases.
    correlation
        Correlation matrix of the estimates.
    check
        Identifiability check at the solution.
    columns
        Measurements, and predictions before and after the fit.
    starts
        Solution for each initial guess, with half its sum of squared normalized residuals; the best solution first.
    runs
        Number of simulated runs.
    warnings
        Warnings about the estimates and the scene.
    covariance
        Covariance matrix of the estimates, in their units, with the error due to the number of segments.

    Examples
    --------
    >>> tapped = fl.fits.FitModes(hertz=(5.5,), deviation=(0.02,))
    >>> young = fl.fits.FitParameter(path="material.aluminium.young")
    >>> found = fl.fit(fl.fits.FitProblem(scene=scene, parameter=(young,), modes=(tapped,)))
    >>> print(found.passed, found["material.aluminium.young"].low < found.scene.arm.materials["aluminium"].young)
    True True
    """

    problem: FitProblem
    scene: Scene
    numbers: tuple[Estimate, ...]
    correlation: Array
    check: Check
    columns: tuple[FittedColumn, ...]
    starts: tuple[tuple[tuple[float, ...], float], ...]
    runs: int
    warnings: tuple[Diagnostic, ...]
    covariance: Array

    def __repr__(self) -> str:
        values = ", ".join(f"{one.name} = {one.value:.4g} ± {one.half:.2g} {one.unit}".rstrip() for one in self.numbers)
        return f"<Fitted {self.scene.name!r}: {values}>"

    def _repr_html_(self) -> str:
        heads = ("parameter", "initial guess", "estimate", "low", "high")
        rows = [(one.name, *(f"{v:.5g}" for v in (one.start, one.value, one.low, one.high))) for one in self.numbers]
        return html_table(repr(self), heads, rows)

    def __getitem__(self, name: str) -> Estimate:
        """Estimate of a path or name."""
        known = {key: one for one in self.numbers for key in (one.path, one.name)}
        if name not in known:
            raise KeyError(f"no parameter {name!r}{did_you_mean(name, known)}; allowed are {short_list([*known])}")
        return known[name]

    @property
    def verdict_columns(self) -> tuple[FittedColumn, ...]:
        """Columns that decide whether the fit is better: the check columns or, without any, the fitted columns."""
        return tuple(one for one in self.columns if one.use == "check") or self.columns

    @property
    def better(self) -> bool:
        """Whether the residuals of the `verdict_columns` are no larger than before the fit."""
        before, after = (
            sum((c.residual(getattr(c, when)) / (c.noise or 1.0)) ** 2 * len(c.measured) for c in self.verdict_columns)
            for when in ("before", "after")
        )
        return after <= before * (1 + 1e-9)

    @property
    def identifiable(self) -> bool:
        """Whether every parameter is identifiable from the data at the solution (`Estimate.doubt`)."""
        return self.check.passed and all(one.doubt is None for one in self.numbers)

    @property
    def explained(self) -> bool:
        """Whether nothing shows that the residuals are more than noise."""
        return all(one.id != "not-explained" for one in self.warnings)

    @property
    def passed(self) -> bool:
        """Whether every parameter is known from the data or its prior, the data explained, and the fit no worse."""
        return self.check.passed and all(one.determined for one in self.numbers) and self.better and self.explained

    def document(self) -> dict[str, Any]:
        """The result as plain numbers and texts, as in the JSON file."""
        return {
            "scene": self.scene.name,
            "passed": self.passed,
            "identifiable": self.identifiable,
            "better": self.better,
            "explained": self.explained,
            "numbers": [dataclasses.asdict(one) | {"verdict": one.verdict} for one in self.numbers],
            "correlation": self.correlation.tolist(),
            "columns": [_of_column(one) for one in self.columns],
            "directions": [{"id": one.text.id, "text": one.text} for one in self.check.directions],
            "starts": [{"values": values, "cost": cost} for values, cost in self.starts],
            "warnings": [{"id": one.id, "text": one} for one in self.warnings],
        }

    def report(self, folder: str | Path, *, command: str = "") -> Report:
        """Write a self-contained page, the fitted scene, JSON, and a CSV file for every table and picture.

        Parameters
        ----------
        folder
            Folder of the page and its files; created if missing.
        command
            Command that made the page, to be printed on the page.

        Raises
        ------
        MissingDependencyError
            matplotlib or jinja2 is not installed.
        OutputError
            The folder or a file in it cannot be written.

        Examples
        --------
        >>> young = fl.fits.FitParameter(path="material.aluminium.young")
        >>> tapped = fl.fits.FitModes(hertz=(5.5,), deviation=(0.02,))
        >>> page = fl.fit(fl.fits.FitProblem(scene=scene, parameter=(young,), modes=(tapped,))).report("fitted")
        >>> print(page.page)
        fitted/index.html
        """
        found: Report = building().build(self, require_path("folder", folder), command)
        return found

    def save(self, path: str | Path) -> Path:
        """Write `document` as JSON; non-finite numbers become null.

        Raises
        ------
        ArgumentError, OutputError
            `path` is not a path, or cannot be written.
        """
        path = require_path("path", path)
        write_text(path, f"{in_json(self.document())}\n")
        return path


def building() -> ModuleType:
    """Module that builds pages of fits or of checks; it needs matplotlib and jinja2."""
    return builder("flexlink.identification.page", "page")


def _of_column(one: FittedColumn) -> dict[str, Any]:
    models = {"before": one.before, "after": one.after} | ({} if one.linear is None else {"linear": one.linear})
    return {
        "source": one.source, "column": one.name, "use": one.use, "samples": len(one.measured),
        "off": {name: one.off(model) for name, model in models.items()},
        "fit": {name: one.fit(model) for name, model in models.items()},
        "gain": one.gain, "bias": one.bias, "noise": one.noise, "whiteness": one.whiteness,
        "unexplained": one.unexplained, "floor": one.floor, "floor_from": one.floor_from, "within": one.within,
    }  # fmt: skip
