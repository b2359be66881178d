"""fit(problem) and check_fit(problem): identifiability, the search, and intervals of the estimates."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import get_args

import numpy as np
from msgspec.structs import replace

from flexlink.chain.arguments import integer, require_callable, require_one_of, require_type
from flexlink.common.errors import Diagnostic, FlexlinkError, IdentifiabilityError
from flexlink.common.types import Array
from flexlink.describe.variants import refined, segments_in_words
from flexlink.identification import systematic
from flexlink.identification.block import Block, with_noise_of_data
from flexlink.identification.columns import columns_of, warnings_of_floors, with_floors
from flexlink.identification.coordinates import Coordinate, coordinates_of, guess_of
from flexlink.identification.data import sources_of
from flexlink.identification.faults import mixups, warnings_of_faults
from flexlink.identification.fitted import Estimate, Fitted
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.interval import Rise, estimates, profiled, spread_at, widened
from flexlink.identification.likelihood import in_two_steps, information_of, likelihood
from flexlink.identification.problem import FitProblem
from flexlink.identification.remarks import mixed_up, notes, ranges_apart, warnings, with_reasons
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Bar, Found, Search, start_points, watch_with
from flexlink.identification.systematic import Grid, Systematic


def check_fit(problem: FitProblem) -> Check:
    """Check which parameters are identifiable from the data, before any are fitted.

    The check takes the Jacobian of all data at the initial guess, divided by the noise that the problem states. Noise
    that is not stated is estimated from the data at high frequencies, where it is white and the motion is small;
    elsewhere 1 % of the range of all columns of the same unit is assumed. It finds parameters without effect,
    combinations that are not identifiable, the expected 95 % intervals, and the expected errors due to the number of
    segments.

    Parameters
    ----------
    problem
        The problem.

    Returns
    -------
    Check
        Names, singular values, directions that are not identifiable, expected standard deviations.

    Raises
    ------
    DataFileError
        The file of a run is invalid, for example because of an unknown column, or times that do not increase.
    SceneError
        A path is unknown, an initial guess is out of bounds, or the scene cannot be simulated there.

    Examples
    --------
    >>> sought = tuple(fl.fits.FitParameter(path=f"material.aluminium.{name}") for name in ("young", "density"))
    >>> bare = scene.varied({"tip.mass": 0.0})
    >>> tapped = fl.fits.FitModes(hertz=(11.0, 50.0), deviation=(0.01,))
    >>> check = fl.fits.check_fit(fl.fits.FitProblem(scene=bare, parameter=sought, modes=(tapped,)))
    >>> print(check.passed, check.directions[0].names)
    False ('material.aluminium.young', 'material.aluminium.density')
    """
    problem = require_type("problem", problem, FitProblem)
    coordinates, sources = coordinates_of(problem), sources_of(problem, "fit")
    data_notes = notes([*sources, *sources_of(problem, "check")])
    blocks = [with_noise_of_data(source.blocks) for source in sources]
    return _check(Signals(sources, coordinates), guess_of(coordinates), blocks, data_notes, problem.tolerance)


def fit(
    problem: FitProblem, *, starts: int = 1, profile: bool = False, grid: Grid = "check",
    progress: Callable[[str], None] | None = None, bar: Bar | None = None,
) -> Fitted:  # fmt: skip
    """Estimate parameters of a scene from measurements, with 95 % intervals.

    The identifiability check comes first (`check_fit`). Single measurements are fitted first, then runs in growing
    windows, by `scipy.optimize.least_squares` on the logarithms of positive parameters. Gains and biases are eliminated
    (variable projection). Intervals account for the autocorrelation of the residuals, and for the grid error: the
    change of every parameter if the fit is repeated with twice the hinges.

    Parameters
    ----------
    problem
        The problem.
    starts
        Number of initial guesses: first the problem's own values, then points spread around them within the bounds.
    profile
        Whether to compute profile intervals as well, with each parameter in turn fixed and all others refitted.
    grid
        "check": estimate the grid error. "auto": take enough segments to make it small against the intervals.
        "ignore": leave it out, for data that were simulated with the same segments.
    progress
        Called with a line of text after each step.
    bar
        Called after each iteration with the fraction done and the name of the present part, such as 'guess 2 of 3'.

    Returns
    -------
    Fitted
        The fitted scene, every parameter with its 95 % interval, correlations, residuals.

    Raises
    ------
    IdentifiabilityError
        Parameters are not identifiable; the message names those without effect, or the combination.
    DataFileError, SceneError
        As in `check_fit`.

    Examples
    --------
    >>> recorded = fl.simulate(scene.varied({"tip.mass": 4.5, "run.duration": 0.5}))
    >>> data = {"t [s]": recorded.t, "tip y [m]": recorded.tip[:, 1]}
    >>> sought, fall = fl.fits.FitParameter(path="tip.mass"), fl.fits.FitRun(name="fall", columns=data)
    >>> found = fl.fit(fl.fits.FitProblem(scene=scene, parameter=(sought,), run=(fall,)), grid="ignore")
    >>> print(f"{found['tip.mass'].value:.4f} kg")
    4.5000 kg
    """
    problem = require_type("problem", problem, FitProblem)
    require_callable("progress", progress)
    require_callable("bar", bar)
    require_one_of("grid", grid, dict.fromkeys(get_args(Grid)))
    count, report, most = integer("starts", starts, 1), progress or (lambda _: None), 4  # most: largest number of fits
    found = _fit(problem, count, profile=profile, grid=grid, report=report, bar=bar)
    for _ in range(most - 1 if grid == "auto" else 0):
        factor = systematic.factor_needed(*np.array([(one.u_num, one.statistical) for one in found.numbers]).T)
        if factor <= 1:
            break
        problem = replace(problem, scene=refined(problem.scene, factor))
        report(f"grid error too large: fitted again with {segments_in_words(problem.scene)}")
        found = _fit(problem, count, profile=profile, grid=grid, report=report, bar=bar)
    return found


def _fit(
    problem: FitProblem, starts: int, *, profile: bool, grid: Grid, report: Callable[[str], None], bar: Bar | None
) -> Fitted:
    coordinates, sources, checks = coordinates_of(problem), sources_of(problem, "fit"), sources_of(problem, "check")
    signals = Signals(sources, coordinates)
    watch = watch_with(bar, starts + 2 * len(coordinates) * profile)
    search = Search(signals, problem.loss, coloured=problem.noise == "coloured", watch=watch)
    start, blocks = guess_of(coordinates), [with_noise_of_data(source.blocks) for source in sources]
    check = _check(signals, start, blocks, notes([*sources, *checks]))
    if not check.passed:
        raise IdentifiabilityError("; also ".join(one.text for one in check.lost), check)
    report("identifiability at the initial guess: passed")
    found = _searched(search, start_points(coordinates, starts), report)
    best = found[0]
    at = search.at(best.x, best.blocks)
    spread = spread_at(at, problem.loss)
    after = checked(at.scaled, check.error, check.names, check.notes)
    numbers = tuple(estimates(at, spread))
    errors = Systematic()
    if not after.passed:
        numbers = tuple(dataclasses.replace(one, low=-np.inf, high=np.inf, deviation=np.inf) for one in numbers)
    else:
        of_scene, rise = numbers[: len(coordinates)], Rise(search, best, at)
        of_scene = tuple(profiled(rise, of_scene, report)) if profile else of_scene
        numbers = (*widened(rise, of_scene), *numbers[len(coordinates) :])
        errors = systematic.systematic_errors(search, best, at, problem, grid, report)
        numbers = errors.added(numbers, coordinates, best.x, spread.wide)
    numbers = tuple(map(systematic.within_bounds, numbers))
    columns = columns_of(problem, signals, best, start, checks, report)
    changes = {by.path: one.value for one, by in zip(numbers, coordinates, strict=False) if not by.run}
    at_start = tuple(note for note in check.notes if note.id.startswith("likely-"))
    found_warnings = at_start + warnings(numbers, coordinates, after, found, columns, [*sources, *checks])
    found_warnings += errors.warnings(problem.scene, numbers)
    finest, at_finest = errors.refined or (search, best)
    columns = with_floors(columns, likelihood(finest.signals, at_finest.x, at_finest.blocks), problem.run, checks)
    # an error of the input resembles faults
    named = () if systematic.warnings_of_inputs(numbers, errors.inputs) else warnings_of_faults(finest, at_finest)
    causes = [one for one in named if one.id not in ("faults-untested", "likely-outliers")]
    found_warnings += (*named, *warnings_of_floors(columns, causes))
    covariance = systematic.covariance_of(coordinates, best.x, spread.covariance, errors.shifts)
    return Fitted(
        problem, problem.scene.varied(changes), numbers, spread.correlation, after, columns,
        tuple((tuple(map(Coordinate.value, coordinates, end.x.tolist())), end.cost) for end in found), signals.runs,
        found_warnings, covariance,
    )  # fmt: skip


def quick_estimates(problem: FitProblem, worth: float) -> tuple[Estimate, ...]:
    """Estimate the parameters by one rough search with white noise, without an identifiability check.

    Return an empty tuple if the model, linearized at the initial guess, explains no more than the fraction `worth` of
    the sum of squares.
    """
    coordinates, sources = coordinates_of(problem), sources_of(problem, "fit")
    search, x = Search(Signals(sources, coordinates), problem.loss), guess_of(coordinates)
    blocks = [list(source.blocks) for source in sources]
    at = search.at(x, blocks)
    explained = at.slopes @ np.linalg.lstsq(at.slopes, at.residual, rcond=None)[0]
    if not explained @ explained > worth * (at.residual @ at.residual):
        return ()
    at = search.at(search.least(x, blocks, rough=True), blocks)
    return tuple(estimates(at, spread_at(at)))


def _searched(search: Search, points: Sequence[Array], report: Callable[[str], None]) -> list[Found]:
    """Search from all initial guesses; return the results, best first. Only the first search must succeed."""
    found = []
    for k, x in enumerate(points):
        search.watch(f"guess {k + 1} of {len(points)}")
        try:
            found.append(search.from_start(x))
        except FlexlinkError:
            if k == 0:
                raise
            continue
        size = np.sqrt(2 * found[-1].cost / sum(len(b.y) for part in found[-1].blocks for b in part))
        report(f"initial guess {k + 1} of {len(points)}: residual {size:.2g} × assumed noise")
    return sorted(found, key=lambda end: end.cost)


def _check(
    signals: Signals, x: Array, blocks: Sequence[Sequence[Block]], data_notes: Sequence[Diagnostic],
    tolerance: float | None = None,
) -> Check:  # fmt: skip
    """Check identifiability and the Jacobian's error by two step sizes; with a `tolerance` of runs, the grid's."""
    at, finer = in_two_steps(signals, x, blocks)
    doubts = [*data_notes, *ranges_apart(at), *mixed_up(at), *mixups(at)]
    check = information_of(at, finer).check
    check = check._replace(directions=with_reasons(signals, x, check.directions), notes=tuple(doubts))
    if check.lost or tolerance is None or not systematic.bends(at.sources[0].scene):
        return check
    errors, more = systematic.grid_ahead(at, check, tolerance)
    return check._replace(grid=errors, notes=(*check.notes, *more))
