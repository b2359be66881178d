"""Comparison of several models of the same data by the Bayesian information criterion and by data not fitted.

    BIC = −2 ln L + k ln n,  −2 ln L = Σ_columns n_c ln(mean w²) + Σ_single (e/σ)²

w are the residuals of a column whitened by their own AR model, whose coefficients count as well, and k is the number
of unknowns (Schwarz 1978). A difference above 10 is very strong evidence (Kass and Raftery 1995), if the residuals are
noise; if they contain what all models lack, held-out data are the better judge.

In cross-validation over the runs of a fit (`folds`), each run in turn is left out, predicted by a fit of the others:

    s = √((k − 1)/k Σ (x_i − x̄)²)

s is the jackknife estimate of a parameter's standard deviation from its values x_i without run i (Efron 1982). It
contains what differs between runs and a single fit cannot see; the deviation of a fit contains the noise only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.errors import ArgumentError, Diagnostic, IdentifiabilityError
from flexlink.common.notebook import html_table
from flexlink.common.types import Array
from flexlink.identification.block import unlikelihood
from flexlink.identification.fit import fit
from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.problem import FitProblem
from flexlink.identification.systematic import Grid
from flexlink.pages.tables import Cell, Table


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class FitComparison:
    """Fits of several models to the same data.

    Attributes
    ----------
    names
        Name of each model.
    fits
        The fit of each model.
    folds
        Fits of each model without each of its runs; empty if not requested.
    """

    names: tuple[str, ...]
    fits: tuple[Fitted, ...]
    folds: tuple[Folds, ...] = ()

    def __repr__(self) -> str:
        return f"<FitComparison: {', '.join(self.names)}; preferred: {self.preferred}>"

    def _repr_html_(self) -> str:
        table = self.tables[0]
        return html_table(repr(self), table.heads, [["" if c is None else c for c in line] for line in table.lines])

    @property
    def bic(self) -> Array:
        """Bayesian information criterion of each model, up to a constant of the data, shape (models,)."""
        return np.array([_bic(one) for one in self.fits])

    @property
    def held_out(self) -> Array:
        """RMS residual over the noise in data that were not fitted, shape (models,); nan if there are none.

        These are the runs left out in turn or, without `folds`, the data with `use = "check"`. The noise is that of
        the model with the smallest BIC.
        """
        several = [one.columns for one in (self.folds or self.fits)]
        return np.array([self._size([one for one in columns if one.use == "check"]) for columns in several])

    @property
    def fitted(self) -> Array:
        """RMS residual over the noise in the fitted data, shape (models,)."""
        return np.array([self._size([one for one in each.columns if one.use == "fit"]) for each in self.fits])

    @property
    def preferred(self) -> str:
        """Name of the model with the smallest BIC."""
        return self.names[int(np.argmin(self.bic))]

    def _size(self, columns: Sequence[FittedColumn]) -> float:
        noise = {(one.source, one.name): one.noise for one in self.fits[int(np.argmin(self.bic))].columns}
        scale = [noise.get((one.source, one.name), one.noise) or one.noise or 1.0 for one in columns]
        pairs = zip(columns, scale, strict=True)
        squares = [len(one.measured) * (one.off(one.after) / above_zero) ** 2 for one, above_zero in pairs]
        return math.sqrt(sum(squares) / sum(len(one.measured) for one in columns)) if columns else math.nan

    @property
    def findings(self) -> tuple[Diagnostic, ...]:
        """Which model is preferred, by how much, whether data that were not fitted agree, and scatter between runs."""
        far = 3.0  # scatter between the folds, in standard deviations of the fit, above which runs differ
        scattered = [
            Diagnostic(
                f"{name}: {one.name} differs between the runs: standard deviation {without.deviations[one.name]:.2g} "
                f"from folds, {one.deviation:.2g} from the fit; the model lacks what differs",
                "runs-differ",
            )
            for name, each, without in zip(self.names, self.fits, self.folds, strict=False)
            for one in each.numbers
            if one.name in without.deviations and without.deviations[one.name] > far * one.deviation > 0
        ]
        return (*(self._preference() if len(self.names) > 1 else ()), *scattered)

    def _preference(self) -> list[Diagnostic]:
        strong, alike = 10.0, 1.05  # difference of BIC that is very strong evidence; ratio of equal residuals
        bic, held_out = self.bic, self.held_out
        best, second = np.argsort(bic, kind="stable")[:2].tolist()
        difference = float(bic[second] - bic[best])
        text = f"{self.names[best]} is preferred to {self.names[second]}: its BIC is {difference:.3g} smaller"
        text += "" if difference > strong else "; differences above 10 are very strong evidence"
        found = [Diagnostic(text, "preferred-model")]
        if np.isfinite(held_out).all():
            least = int(np.argmin(held_out))
            if held_out[best] > alike * held_out[least]:
                text = f"data that were not fitted prefer {self.names[least]}: residual {held_out[least]:.3g} × noise, "
                text += f"{self.names[best]} {held_out[best]:.3g}; the BIC counts what all models lack as noise"
                found.append(Diagnostic(text, "held-out-prefers-another"))
        return found

    @property
    def tables(self) -> tuple[Table, ...]:
        """Tables of the models, of their parameters, and of the residuals of every column."""
        bic, fitted, held_out = self.bic, self.fitted, self.held_out
        rows: list[tuple[Cell, ...]] = [
            (name, len(one.numbers), float(bic[k]), float(bic[k] - bic.min()), float(fitted[k]),
             float(held_out[k]) if np.isfinite(held_out[k]) else None, "yes" if one.passed else "no")
            for k, (name, one) in enumerate(zip(self.names, self.fits, strict=True))
        ]  # fmt: skip
        heads = ("model", "unknowns", "BIC", "above the smallest", "fitted: residual / noise",
                 "held out: residual / noise", "passed")  # fmt: skip
        return Table("models", "Models of the same data", heads, tuple(rows)), self._numbers(), self._columns()

    def _numbers(self) -> Table:
        heads = ("model", "parameter", "unit", "fitted", "from", "to", "standard deviation", "from folds")
        lines = []
        for k, (name, one) in enumerate(zip(self.names, self.fits, strict=True)):
            scatter = self.folds[k].deviations if self.folds else {}
            lines += [(name, each.name, each.unit or "1", each.value, each.low, each.high, each.deviation,
                       scatter.get(each.name)) for each in one.numbers]  # fmt: skip
        return Table("numbers", "Parameters of every model", heads, tuple(lines))

    def _columns(self) -> Table:
        heads = ("source", "column", "use", *(f"RMS residual of {name}" for name in self.names))
        every = [one.columns for one in self.fits]
        if self.folds:
            every = [(*one, *each.columns) for one, each in zip(every, self.folds, strict=True)]
        lines = tuple(
            (one[0].source, one[0].name, one[0].use, *(each.off(each.after) for each in one))
            for one in zip(*every, strict=True)
        )
        return Table("columns", "Residuals of every column", heads, lines)

    def document(self) -> dict[str, Any]:
        """The comparison as plain numbers and texts."""
        return {
            "preferred": self.preferred,
            **{one.name: [dict(zip(one.heads, line, strict=True)) for line in one.lines] for one in self.tables},
            "findings": [{"id": one.id, "text": one} for one in self.findings],
        }


def compare_fits(
    fits: Sequence[FitProblem | Fitted], names: Sequence[str] = (), *, by_folds: bool = False, grid: Grid = "check",
    progress: Callable[[str], None] | None = None,
) -> FitComparison:  # fmt: skip
    """Compare several models of the same data: friction laws, root springs or none, more or fewer parameters.

    Parameters
    ----------
    fits
        Two or more problems, or results of fits, with the same data.
    names
        Name of each; default: "model 1" and so on.
    by_folds
        Whether each run in turn is left out and predicted by a fit of the others (`folds`).
    grid
        As in `fit`, for problems.
    progress
        Called with a line of text after each step.

    Returns
    -------
    FitComparison
        BIC, residuals of data that were fitted and that were not, parameters, and the preferred model.

    Raises
    ------
    ArgumentError
        The data differ, there are fewer than two fits, or not one name for each.
    IdentifiabilityError
        Parameters of a model are not identifiable; the message names the model.
    DataFileError, SceneError
        As in `fit`.

    Examples
    --------
    >>> tapped = fl.fits.FitModes(hertz=(5.5, 6.6, 24.2), deviation=(0.02,))
    >>> young = fl.fits.FitParameter(path="material.aluminium.young")
    >>> one = fl.fits.FitProblem(scene=scene, parameter=(young,), modes=(tapped,))
    >>> two = fl.fits.FitProblem(
    ...     scene=scene, parameter=(young, fl.fits.FitParameter(path="tip.mass")), modes=(tapped,)
    ... )
    >>> found = fl.fits.compare_fits([one, two], ["E", "E and mass"], grid="ignore")
    >>> print(found.preferred)
    E and mass
    """
    given = [one if isinstance(one, Fitted) else require_type("fits", one, FitProblem) for one in fits]
    if len(given) < 2:
        raise ArgumentError(f"fits: {len(given)} given; expected at least two", id="too-few-fits")
    called = tuple(names) or tuple(f"model {k}" for k in range(1, len(given) + 1))
    if len(called) != len(given):
        raise ArgumentError(f"names = {list(called)}: expected {len(given)}, one per fit", id="one-per-fit")
    found, without = [], []
    for name, one in zip(called, given, strict=True):
        try:
            found.append(one if isinstance(one, Fitted) else fit(one, grid=grid, progress=progress))
            _require_same(called[0], found[0], name, found[-1])
            if by_folds:
                without.append(folds(found[-1].problem, progress=progress))
        except IdentifiabilityError as error:
            raise IdentifiabilityError(f"{name}: {error}", error.check) from None
    return FitComparison(called, tuple(found), tuple(without))


def _require_same(name: str, one: Fitted, other_name: str, other: Fitted) -> None:
    """Refuse fits of different data."""
    mine, theirs = ({(c.source, c.name, c.use): c for c in each.columns} for each in (one, other))
    apart = [*(mine.keys() ^ theirs.keys())]
    apart += [
        key for key in mine.keys() & theirs.keys()
        if not all(np.array_equal(getattr(mine[key], what), getattr(theirs[key], what)) for what in ("t", "measured"))
    ]  # fmt: skip
    if apart:
        source, column, use = min(apart)
        text = f"{column} of {source} ({use}) differs; expected the same data in all fits"
        raise ArgumentError(f"{name} and {other_name}: {text}", id="data-differ")


def _bic(fitted: Fitted) -> float:
    total, count = 0.0, 0
    for one in fitted.columns:
        if one.use != "fit":
            continue
        count += len(one.measured)
        if one.t is None:
            total += len(one.measured) * one.times_noise**2
        else:
            least = (one.residual(one.after) / max(one.off(one.after), 1e-300)) ** 2  # 1, but for exact data
            total += unlikelihood(one.after - one.measured, least)
    return total + len(fitted.numbers) * math.log(count)


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Folds:
    """Fits of a problem, each without one of its runs.

    Attributes
    ----------
    held_out
        Names of the runs that were left out.
    fits
        The fit without each of these runs, which is a run to check it.
    """

    held_out: tuple[str, ...]
    fits: tuple[Fitted, ...]

    def __repr__(self) -> str:
        return f"<Folds: without {', '.join(self.held_out)}>"

    @property
    def columns(self) -> tuple[FittedColumn, ...]:
        """All columns, each predicted by the fit without its run."""
        pairs = zip(self.held_out, self.fits, strict=True)
        return tuple(one for name, found in pairs for one in found.columns if one.source == name)

    @property
    def values(self) -> dict[str, tuple[float, ...]]:
        """Estimates of every parameter that all fits have in common, one per fit."""
        names = [{one.name for one in each.numbers} for each in self.fits]
        common = [one.name for one in self.fits[0].numbers if all(one.name in each for each in names)]
        return {name: tuple(each[name].value for each in self.fits) for name in common}

    @property
    def deviations(self) -> dict[str, float]:
        """Jackknife standard deviation of each of these parameters."""
        k = len(self.fits)
        return {name: float(np.sqrt((k - 1) * np.var(several))) for name, several in self.values.items()}


def folds(problem: FitProblem, *, grid: Grid = "ignore", progress: Callable[[str], None] | None = None) -> Folds:
    """Fit a problem without each of its fitted runs in turn, and predict that run.

    Parameters
    ----------
    problem
        A problem with two or more fitted runs. Runs to check the fit are left out; other measurements stay.
    grid
        As in `fit`; residuals do not need the error due to the number of segments.
    progress
        Called with a line of text after each step.

    Returns
    -------
    Folds
        The fits, the columns of every run predicted without it, and the scatter of the estimates.

    Raises
    ------
    ArgumentError
        There are fewer than two fitted runs.
    IdentifiabilityError
        Parameters are not identifiable without one of the runs, which the message names.
    DataFileError, SceneError
        As in `fit`.

    Examples
    --------
    >>> runs = []
    >>> for number, kilograms in enumerate((4.4, 4.5, 4.6)):  # the payload differs between the runs
    ...     run = fl.simulate(scene.varied({"tip.mass": kilograms, "run.duration": 0.2}))
    ...     data = {"t [s]": run.t, "tip y [m]": run.tip[:, 1]}
    ...     runs.append(fl.fits.FitRun(name=f"fall {number}", columns=data))
    >>> sought = fl.fits.FitParameter(path="tip.mass")
    >>> found = fl.fits.folds(fl.fits.FitProblem(scene=scene, parameter=(sought,), run=tuple(runs)))
    >>> print(found.held_out, f"{found.deviations['tip.mass']:.2f} kg")
    ('fall 0', 'fall 1', 'fall 2') 0.06 kg
    """
    problem = require_type("problem", problem, FitProblem)
    require_callable("progress", progress)
    fitted = [run.name for run in problem.run if run.use == "fit"]
    if len(fitted) < 2:
        raise ArgumentError(f"folds: {len(fitted)} fitted runs; at least two are needed", id="too-few-runs")
    single, found = ("modes", "static", "frf"), list[Fitted]()
    for name in fitted:
        runs = (replace(run, use="check" if run.name == name else "fit") for run in problem.run if run.name in fitted)
        others = {key: tuple(one for one in getattr(problem, key) if one.use == "fit") for key in single}
        if progress is not None:
            progress(f"without run {name!r}")
        try:
            found.append(fit(replace(problem, run=tuple(runs), **others), grid=grid, progress=progress))
        except IdentifiabilityError as error:
            raise IdentifiabilityError(f"without run {name!r}: {error}", error.check) from None
    return Folds(tuple(fitted), tuple(found))
