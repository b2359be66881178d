"""Cross-validation over the runs of a fit: each run in turn is left out, predicted by a fit of the others.

    s = √((k − 1)/k Σ (x_i − x̄)²)

s is the jackknife estimate of a parameter's standard deviation from its values x_i without run i (Efron 1982). It
contains what differs between runs and a single fit cannot see; the deviation of a fit contains the noise only.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np
from msgspec.structs import replace

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.errors import ArgumentError, IdentifiabilityError
from flexlink.identification.fit import fit
from flexlink.identification.fitted import Fitted, FittedColumn
from flexlink.identification.grid import Grid
from flexlink.identification.problem import FitProblem


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
        common = [one.name for one in self.fits[0].numbers if all(one.name in names_of(each) for each in self.fits)]
        return {name: tuple(each[name].value for each in self.fits) for name in common}

    @property
    def deviations(self) -> dict[str, float]:
        """Jackknife standard deviation of each of these parameters."""
        k = len(self.fits)
        return {name: float(np.sqrt((k - 1) * np.var(several))) for name, several in self.values.items()}


def names_of(fitted: Fitted) -> set[str]:
    """Names of the parameters of a fit."""
    return {one.name for one in fitted.numbers}


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
    return Folds(tuple(fitted), tuple(_without(problem, fitted, grid, progress or (lambda _: None))))


def _without(problem: FitProblem, fitted: list[str], grid: Grid, report: Callable[[str], None]) -> Iterator[Fitted]:
    single = ("modes", "static", "frf")
    for name in fitted:
        runs = tuple(
            replace(run, use="check" if run.name == name else "fit") for run in problem.run if run.name in fitted
        )
        others = {key: tuple(one for one in getattr(problem, key) if one.use == "fit") for key in single}
        report(f"without run {name!r}")
        try:
            yield fit(replace(problem, run=runs, **others), grid=grid, progress=report)
        except IdentifiabilityError as error:
            raise IdentifiabilityError(f"without run {name!r}: {error}", error.check) from None
