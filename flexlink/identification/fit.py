"""fit(problem) and check_fit(problem): what the data can tell, the search, and how well its result is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from flexlink.chain.arguments import integer, require_callable, require_type
from flexlink.common.errors import FlexlinkError, IdentifiabilityError
from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate, coordinates_of, prior_rows
from flexlink.identification.data import sources_of
from flexlink.identification.fitted import Estimate, Fitted
from flexlink.identification.identifiability import Check, checked
from flexlink.identification.interval import estimates, linear_estimates, parts_of, spread_of, without_ends
from flexlink.identification.judge import columns_of
from flexlink.identification.likelihood import large_changes, linear_names, priors_of, row_of, stacked
from flexlink.identification.problem import FitProblem
from flexlink.identification.profile import profiled, widened
from flexlink.identification.reasons import with_reasons
from flexlink.identification.remarks import notes, ranges_apart, warnings
from flexlink.identification.signals import STEP, Signals
from flexlink.identification.solve import Found, Search, start_points
from flexlink.motion.slopes_of_runs import CENTRAL_4


def check_fit(problem: FitProblem) -> Check:
    """Which parameters are identifiable from the data, before any are fitted.

    From the slopes of all data at the start, over the noise that the problem states (where it states none, 1 % of the
    range of the columns of one unit): parameters without effect, combinations that are not identifiable, expected ±.

    Parameters
    ----------
    problem
        The problem.

    Returns
    -------
    Check
        Names, singular values, directions that are not identifiable, in words, expected standard deviations.

    Raises
    ------
    DataFileError
        A file of a run cannot be read: a column or a unit that is not known, times that do not increase …
    SceneError
        A path leads nowhere, or a start is out of bounds; or the scene cannot be computed there.

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
    told = notes([*sources, *sources_of(problem, "check")])
    x = np.array([one.x(one.start) for one in coordinates])
    return _check(Signals(sources, coordinates), x, [list(source.blocks) for source in sources], told)


def fit(
    problem: FitProblem, *, starts: int = 1, profile: bool = False, progress: Callable[[str], None] | None = None
) -> Fitted:  # fmt: skip
    """Estimate numbers of a scene from measurements, with intervals.

    Checked first (`check_fit`). Single numbers are fitted first, then runs in growing windows, by
    `scipy.optimize.least_squares` with logarithms of positive numbers; gains and biases are at their best throughout
    (variable projection). Intervals count the autocorrelation of residuals.

    Parameters
    ----------
    problem
        The problem.
    starts
        How many starts: the scene's values, then points that fill the bounds.
    profile
        Whether each interval is found by fitting all other numbers anew, too, with this one held beside its best value.
    progress
        Called with a line on every part that is done.

    Returns
    -------
    Fitted
        The fitted scene, each number with its 95 % interval, correlations, residuals.

    Raises
    ------
    IdentifiabilityError
        Parameters are not identifiable: the message names those without effect, or the combination.
    DataFileError, SceneError
        As in `check_fit`.

    Examples
    --------
    >>> recorded = fl.simulate(scene.varied({"tip.mass": 4.5, "run.duration": 0.5}))
    >>> data = {"t [s]": recorded.t, "tip y [m]": recorded.tip[:, 1]}
    >>> sought, fall = fl.fits.FitParameter(path="tip.mass"), fl.fits.FitRun(name="fall", columns=data)
    >>> found = fl.fit(fl.fits.FitProblem(scene=scene, parameter=(sought,), run=(fall,)))
    >>> print(f"{found['tip.mass'].value:.4f} kg")
    4.5000 kg
    """
    problem = require_type("problem", problem, FitProblem)
    require_callable("progress", progress)
    count, tell = integer("starts", starts, 1), progress or (lambda _: None)
    coordinates, sources, kept = coordinates_of(problem), sources_of(problem, "fit"), sources_of(problem, "check")
    signals = Signals(sources, coordinates)
    search = Search(signals, problem.loss, coloured=problem.noise == "coloured")
    own = np.array([one.x(one.start) for one in coordinates])
    check = _check(signals, own, [list(source.blocks) for source in sources], notes([*sources, *kept]))
    if not check.passed:
        raise IdentifiabilityError("; also ".join(one.text for one in check.lost), check)
    tell("checked: every number is held by the data")
    found = _searched(search, start_points(coordinates, count), tell)
    best = found[0]
    rows = search.rows(best.x, best.blocks)
    colours = [block.colour for part in best.blocks for block in part if block.colour is not None]
    coefficients = sum(len(one.a) - 1 for one in colours)
    spread = spread_of(parts_of(sources, rows), priors_of(coordinates, best.x, rows), coefficients)
    after = _check_after(signals, best, check)
    numbers = (*estimates(coordinates, best.x, spread), *linear_estimates(sources, rows, spread, len(coordinates)))
    if not after.passed:
        numbers = tuple(map(without_ends, numbers))
    else:
        of_scene, others = numbers[: len(coordinates)], numbers[len(coordinates) :]
        numbers = (*widened(search, best, profiled(search, best, of_scene, tell) if profile else of_scene), *others)
    columns = columns_of(problem, signals, best, own, kept, tell)
    changes = {one.path: one.value for one in numbers if one.path and not _of_run(one, coordinates)}
    told = warnings(numbers, coordinates, after, found, columns, [*sources, *kept])
    return Fitted(
        problem, problem.scene.varied(changes), numbers, spread.correlation, after, columns,
        tuple((_values(coordinates, end.x), end.cost) for end in found), signals.runs, told,
    )  # fmt: skip


def quick_estimates(problem: FitProblem, worth: float) -> tuple[Estimate, ...]:
    """The numbers of a problem by one rough search from their own values, noise being white; nothing is checked.

    None where the slopes there promise to explain no more than a part `worth` of the sum of squares.

    Raises
    ------
    DataFileError, SceneError
        As in `check_fit`.
    """
    coordinates, sources = coordinates_of(problem), sources_of(problem, "fit")
    search, x = Search(Signals(sources, coordinates), problem.loss), np.array([one.x(one.start) for one in coordinates])
    blocks = [list(source.blocks) for source in sources]
    rows = [row for part in search.rows(x, blocks) for row in part]
    r, J = np.concatenate([row.residual for row in rows]), np.vstack([row.slopes for row in rows])
    explained = J @ np.linalg.lstsq(J, r, rcond=None)[0]
    if not explained @ explained > worth * (r @ r):
        return ()
    x = search.near(x)
    found = search.rows(x, blocks)
    return tuple(estimates(coordinates, x, spread_of(parts_of(sources, found), priors_of(coordinates, x, found))))


def _values(coordinates: Sequence[Coordinate], x: Array) -> tuple[float, ...]:
    return tuple(one.value(float(at)) for one, at in zip(coordinates, x, strict=True))


def _searched(search: Search, points: Sequence[Array], tell: Callable[[str], None]) -> list[Found]:
    """Where the starts lead, the best first; only the problem's own must lead somewhere."""
    found = []
    for k, x in enumerate(points):
        try:
            found.append(search.from_start(x))
        except FlexlinkError:
            if k == 0:
                raise
            continue
        left = np.sqrt(2 * found[-1].cost / sum(len(b.y) for part in found[-1].blocks for b in part))
        tell(f"start {k + 1} of {len(points)}: what is left is {left:.4g} times the noise, stated or assumed at first")
    return sorted(found, key=lambda end: end.cost)


def _check(signals: Signals, x: Array, blocks: Sequence[Sequence[Block]], told: Sequence[str]) -> Check:
    """Slopes twice, with two steps: their difference is how well they are known."""
    signals.ahead([*signals.around(x, CENTRAL_4), *signals.around(x, CENTRAL_4, STEP / 2)])
    slopes, finer = signals.slopes(x, CENTRAL_4), signals.slopes(x, CENTRAL_4, STEP / 2)
    J = _of_all(signals, x, blocks, slopes)
    error = float(np.linalg.norm(J - _of_all(signals, x, blocks, finer), 2))
    check = checked(J, error, _names(signals), [*told, *ranges_apart(signals.sources, signals.model(x))])
    return check._replace(directions=with_reasons(signals, x, check.directions))


def _check_after(signals: Signals, best: Found, before: Check) -> Check:
    """The same where the search ended, with slopes at hand."""
    J = _of_all(signals, best.x, best.blocks, signals.slopes(best.x))
    return checked(J, before.error, before.names, before.notes)


def _of_all(signals: Signals, x: Array, blocks: Sequence[Sequence[Block]], slopes: list[list[Array]]) -> Array:
    """Slopes of all residuals to large changes of all numbers."""
    parts = zip(blocks, signals.model(x), slopes, strict=True)
    rows = [[row_of(b, y, J) for b, y, J in zip(*part, strict=True)] for part in parts]
    _, known = prior_rows(signals.coordinates, x)
    whole = stacked(rows, len(x), known)
    return np.asarray(whole * np.array([1.0] * len(x) + large_changes(blocks)))


def _names(signals: Signals) -> list[str]:
    return [*(one.name for one in signals.coordinates), *linear_names(signals.sources)]


def _of_run(one: Estimate, coordinates: Sequence[Coordinate]) -> bool:
    return any(other.run and other.name == one.name for other in coordinates)
