"""What a fit gives: values with intervals, residuals, verdicts, the fitted scene, JSON."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from types import ModuleType
from typing import Any

from flexlink.common.notebook import html_table
from flexlink.common.output import write_text
from flexlink.common.types import Array
from flexlink.data.documents import require_path
from flexlink.describe.scene import Scene
from flexlink.identification.block import unit_in
from flexlink.identification.identifiability import Check
from flexlink.identification.problem import FitProblem
from flexlink.pages.builders import builder
from flexlink.pages.verdict import Report


@dataclasses.dataclass(frozen=True)
class Estimate:
    """A number that was sought.

    Attributes
    ----------
    name, path
        How it is called, and its path in the scene; "" of a gain or a bias.
    start, value
        Before and after the fit, in the path's own unit.
    low, high
        95 % interval, autocorrelation of the residuals counted; without ends where a number is not identifiable.
    deviation
        Standard deviation.
    at_bound
        Whether the search ended at a bound of it.
    widened
        Whether the interval is wider than slopes say, because the data do not reject what is there: far from linear.
    profile
        The interval where all other numbers are fitted anew with this one held; None if nobody asked.
    unit
        Of all these; "" of a pure number.
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

    @property
    def half(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2


@dataclasses.dataclass(frozen=True, eq=False)
class FittedColumn:
    """One instrument of one run, or the single numbers of one kind.

    Attributes
    ----------
    source, name, use
        Run, column with its SI unit, and whether it was fitted or checked.
    t
        Times [s]; None of single numbers.
    measured, before, after, linear
        What was measured; what the scene gives before and after the fit; what a free linear model gives, None without.
    gain, bias
        At their best.
    noise
        Standard deviation of the noise, stated or of the residuals.
    stated
        Whether the problem states it.
    times_noise
        Root mean square of the residuals over the noise.
    whiteness
        Probability that white noise looks like the residuals; nan of single numbers.
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

    @property
    def unit(self) -> str:
        """Unit of the numbers."""
        return unit_in(self.name)

    def off(self, model: Array) -> float:
        """Root mean square difference."""
        return float(math.sqrt(((model - self.measured) ** 2).mean()))

    def left(self, model: Array) -> float:
        """The same, but no less than a search can leave: two fits of exact data are as good as each other."""
        share = 1e-7  # of what was measured: searches end 1e-8 beside the least, in parts of the numbers
        return max(self.off(model), share * float(abs(self.measured).max()))

    def fit(self, model: Array | None) -> float:
        """1 − |difference| / |measured less its mean| [%]; nan of single numbers."""
        if model is None or self.t is None:
            return math.nan
        spread = float(self.measured.std())
        return 100 * (1 - self.off(model) / spread) if spread else math.nan


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Fitted:
    """A fit.

    Attributes
    ----------
    problem
        What was asked.
    scene
        The scene with what was found for all runs.
    numbers
        What was sought: numbers of the scene, those of single runs, gains and biases.
    correlation
        Of all of them, shape (numbers, numbers).
    check
        What the data can tell, at the solution.
    columns
        What was measured beside what the scene gives.
    starts
        Values that each initial guess led to, and half the sum of squared residuals over the noise, the best first.
    runs
        How many runs were computed.
    warnings
        What is to be known of the fit.

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
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        told = ", ".join(f"{one.name} = {one.value:.4g} ± {one.half:.2g} {one.unit}".rstrip() for one in self.numbers)
        return f"<Fitted {self.scene.name!r}: {told}>"

    def _repr_html_(self) -> str:
        heads = ("number", "start", "value", "low", "high")
        rows = [(one.name, *(f"{v:.5g}" for v in (one.start, one.value, one.low, one.high))) for one in self.numbers]
        return html_table(repr(self), heads, rows)

    def __getitem__(self, name: str) -> Estimate:
        """The number of a path or name."""
        return next(one for one in self.numbers if name in (one.path, one.name))

    @property
    def judged(self) -> tuple[FittedColumn, ...]:
        """Columns by which the fit is judged: those kept to check it, else those fitted."""
        return tuple(one for one in self.columns if one.use == "check") or self.columns

    @property
    def better(self) -> bool:
        """Whether residuals are smaller than before, over all columns by which the fit is judged."""
        before = sum((one.left(one.before) / (one.noise or 1.0)) ** 2 * len(one.measured) for one in self.judged)
        after = sum((one.left(one.after) / (one.noise or 1.0)) ** 2 * len(one.measured) for one in self.judged)
        return after <= before * (1 + 1e-9)

    @property
    def identifiable(self) -> bool:
        """Whether every number is identifiable where the search ended, and none of them at a bound."""
        return self.check.passed and not any(one.at_bound for one in self.numbers)

    @property
    def passed(self) -> bool:
        """Whether every number is identifiable, and the fitted scene is no worse than the one before."""
        return self.identifiable and self.better

    def document(self) -> dict[str, Any]:
        """Plain numbers and texts, as in the JSON file."""
        return {
            "scene": self.scene.name,
            "passed": self.passed,
            "identifiable": self.identifiable,
            "better": self.better,
            "numbers": [dataclasses.asdict(one) for one in self.numbers],
            "correlation": self.correlation.tolist(),
            "columns": [_of_column(one) for one in self.columns],
            "directions": [one.text for one in self.check.directions],
            "starts": [{"values": values, "cost": cost} for values, cost in self.starts],
            "warnings": list(self.warnings),
        }

    def report(self, folder: str | Path, *, command: str = "") -> Report:
        """Write a page that stands alone, the fitted scene, JSON, and a CSV of every table and picture.

        Parameters
        ----------
        folder
            For the page and its files; made if missing.
        command
            What the page says that it was made by.

        Raises
        ------
        MissingDependencyError
            matplotlib or jinja2 is not installed.
        OutputError
            The folder cannot be made, or a file in it not be written.

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
        """Write `document` as JSON; numbers that are not finite are null.

        Raises
        ------
        ArgumentError, OutputError
            `path` is no path, or cannot be written.
        """
        path = require_path("path", path)
        write_text(path, json.dumps(_finite(self.document()), indent=1, ensure_ascii=False) + "\n")
        return path


def building(page: str = "page") -> ModuleType:
    """The module that builds pages of fits, or of checks, which needs matplotlib and jinja2.

    Raises
    ------
    MissingDependencyError
        One of them is not installed.
    """
    return builder(f"flexlink.identification.{page}", "page")


def _of_column(one: FittedColumn) -> dict[str, Any]:
    models = {"before": one.before, "after": one.after} | ({} if one.linear is None else {"linear": one.linear})
    return {
        "source": one.source, "column": one.name, "use": one.use, "samples": len(one.measured),
        "off": {name: one.off(model) for name, model in models.items()},
        "fit": {name: one.fit(model) for name, model in models.items()},
        "gain": one.gain, "bias": one.bias, "noise": one.noise, "whiteness": one.whiteness,
    }  # fmt: skip


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
