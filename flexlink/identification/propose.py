"""propose(problem): rank experiments by how much each would narrow the widest 95 % interval.

    s(B + J_cᵀ J_c),  B = Jᵀ J of the present data and priors,  J_c = ∂(data of the experiment / noise)/∂x

Both Jacobians are taken at the same values of the parameters: the initial guess, or the solution of a fit, where B is
the inverse of the fit's covariance. Gains, biases and parameters of single runs are unknowns throughout. The estimate
is linear, as in the identifiability check.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from flexlink.chain.arguments import require_type
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.block import Block, with_noise_of_data
from flexlink.identification.candidates import Addition, Bench, Candidate
from flexlink.identification.coordinates import Coordinate, coordinates_of, guess_of, run_coordinates
from flexlink.identification.data import Source, recorded
from flexlink.identification.experiments import Experiments, built_in
from flexlink.identification.fitted import Fitted
from flexlink.identification.identifiability import Check, Direction
from flexlink.identification.likelihood import Information, Likelihood, in_two_steps, information_of
from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun
from flexlink.identification.proposals import Change, Proposal, Proposals
from flexlink.identification.remarks import notes
from flexlink.identification.signals import Signals
from flexlink.identification.sources import sagged, sources_of, tapped


def propose(problem: FitProblem | Fitted, experiments: str | Path | Experiments | None = None) -> Proposals:
    """Rank experiments by how much each would narrow the widest 95 % interval of a fit.

    The candidates are further columns and sensors in a repeat of a recorded run, static deflections under known
    weights, tap tests, other motions, and measurements of a parameter itself. All predictions are linear in the
    parameters. If no single experiment makes every parameter identifiable, sets of up to three are chosen one by one.

    Parameters
    ----------
    problem
        A problem, evaluated at its initial guess; or the result of a fit, evaluated at its solution with its
        covariance.
    experiments
        A TOML file of experiments, or `Experiments`, in addition to the built-in ones.

    Returns
    -------
    Proposals
        The ranked experiments, each with its predicted intervals and with the tables to add to the problem file.

    Raises
    ------
    DataFileError, SceneError
        As in `check_fit`; or the file of experiments is invalid.

    Examples
    --------
    >>> sought = tuple(fl.fits.FitParameter(path=f"material.aluminium.{name}") for name in ("young", "density"))
    >>> bare = scene.varied({"tip.mass": 0.0, "run.duration": 0.1})
    >>> tapped = fl.fits.FitModes(hertz=(11.0, 50.0), deviation=(0.01,))
    >>> found = fl.fits.propose(fl.fits.FitProblem(scene=bare, parameter=sought, modes=(tapped,)))
    >>> print(found.check.passed, found.ranked[0].lost)
    False 0
    """
    fitted = problem if isinstance(problem, Fitted) else None
    of = problem.problem if isinstance(problem, Fitted) else require_type("problem", problem, FitProblem)
    coordinates, sources = coordinates_of(of), sources_of(of, "fit")
    x = guess_of(coordinates)
    if fitted is not None:
        x, sources = _at_solution(fitted, coordinates, sources)
    else:
        for source in sources:
            source.blocks = tuple(with_noise_of_data(source.blocks))
    known = _present(fitted, coordinates, sources, x)
    of_noise = {"assumed-noise", "estimated-noise"}
    assumed = () if fitted is not None else tuple(one for one in notes(sources) if one.id in of_noise)
    bench = Bench(of, sources, coordinates, x)
    given = _given(experiments)
    before = known.check
    found = [*_accurate(bench, known, _informed(bench, given, coordinates, x))]
    ranked = sorted((_proposal(before, coordinates, x, known, [one]) for one in found), key=_rank)
    sets = [] if any(not one.lost for one in ranked) else _sets(before, coordinates, x, known, found)
    separating = tuple(_separating(direction, found) for direction in before.lost)
    return Proposals(
        before, _values(coordinates, x), fitted is not None,
        tuple(ranked), tuple(sets), separating, tuple(bench.skipped), len(found), assumed,
    )  # fmt: skip


def _given(experiments: str | Path | Experiments | None) -> Experiments:
    if experiments is None:
        return built_in()
    more = experiments if isinstance(experiments, Experiments) else Experiments.load(experiments)
    base = built_in()
    return Experiments(**{key: getattr(base, key) + getattr(more, key) for key in Experiments.__struct_fields__})


def _at_solution(
    fitted: Fitted, coordinates: Sequence[Coordinate], sources: Sequence[Source]
) -> tuple[Array, list[Source]]:
    """Coordinates at the solution of a fit, and the sources with the noise that it estimated."""
    values = {one.name: one.value for one in fitted.numbers}
    noise = {(one.source, one.name): one.noise for one in fitted.columns}
    for source in sources:
        source.blocks = tuple(
            _with_noise(block, noise[source.name, block.name]) if block.t is not None else block
            for block in source.blocks
        )
    return np.array([one.x(values[one.name]) for one in coordinates]), list(sources)


def _with_noise(block: Block, deviation: float) -> Block:
    """The block with another standard deviation of its noise; 0, from exact data, is replaced by its present one."""
    return dataclasses.replace(block, σ=np.full(len(block.y), deviation)) if deviation > 0 else block


def _present(
    fitted: Fitted | None, coordinates: Sequence[Coordinate], sources: Sequence[Source], x: Array
) -> Information:
    """Information of the present data: the inverse covariance of a fit, or else Jacobians over the noise."""
    names = tuple(one.name for one in coordinates)
    numbers = [] if fitted is None else [k for k, one in enumerate(fitted.numbers) if one.name in names]
    if fitted is not None and fitted.check.passed:
        sizes = np.array([one.size(one.value(float(at))) for one, at in zip(coordinates, x, strict=True)])
        grid = np.array([fitted.numbers[k].u_num for k in numbers])  # further data do not reduce this error
        σ = np.sqrt(np.maximum(np.array([fitted.numbers[k].deviation for k in numbers]) ** 2 - grid**2, 0.0)) / sizes
        C = fitted.correlation[np.ix_(numbers, numbers)] * np.outer(σ, σ)
        if np.isfinite(C).all() and (σ > 0).all():
            s, V = np.linalg.eigh(C)
            return Information((V / np.sqrt(np.maximum(s, np.finfo(float).tiny))).T, names, fitted.check.error)
    return information_of(*in_two_steps(Signals(sources, coordinates), x, [source.blocks for source in sources]))


def _informed(
    bench: Bench, experiments: Experiments, coordinates: Sequence[Coordinate], x: Array
) -> Iterator[tuple[Candidate, Information]]:
    """All candidates with their information; those that cannot be simulated are skipped."""
    beside: dict[str, list[Candidate]] = {}
    for one in bench.candidates(experiments):
        if one.beside:
            beside.setdefault(one.beside, []).append(one)
        else:
            yield from _tried(bench, [one], coordinates, x)
    for several in beside.values():
        yield from _tried(bench, several, coordinates, x)


def _accurate(
    bench: Bench, known: Information, found: Iterable[tuple[Candidate, Information]]
) -> Iterator[tuple[Candidate, Information]]:
    """Candidates whose derivatives are accurate enough that adding them does not hide effects of the present data."""
    now = len(known.check.lost)
    for one, information in found:
        lost = known.with_([information]).check.lost
        own = {name for direction in lost for name in direction.names} - {*known.names}
        if own:
            bench.skip(one.title, f"{' and '.join(sorted(own))} would not be identifiable")
        elif len(lost) > now:
            bench.skip(one.title, "its derivatives are too inaccurate; the motion is too long or too sensitive")
        else:
            yield one, information


def _tried(
    bench: Bench, several: Sequence[Candidate], coordinates: Sequence[Coordinate], x: Array
) -> list[tuple[Candidate, Information]]:
    try:
        return _of_several(bench.problem, several, coordinates, x)
    except FlexlinkError as error:
        for one in several:
            bench.skip(one.title, error)
        return []


def _of_several(
    problem: FitProblem, several: Sequence[Candidate], coordinates: Sequence[Coordinate], x: Array
) -> list[tuple[Candidate, Information]]:
    """Information of candidates that one run, or one single measurement, provides.

    Raises
    ------
    FlexlinkError
        It cannot be simulated.
    """
    common = [one for one in coordinates if not one.run]
    at = [float(value) for one, value in zip(coordinates, x, strict=True) if not one.run]
    first = several[0].addition
    if isinstance(first, FitParameter):
        return [(several[0], _of_prior(first, common, at))]
    own: list[Coordinate] = []
    if isinstance(first, FitRun):
        merged = _merged([one.addition for one in several if isinstance(one.addition, FitRun)])
        whole = replace(problem, run=(*problem.run, merged))
        source, own = recorded(whole, merged), run_coordinates(whole, merged)
    else:
        source = tapped(problem, first, 0) if isinstance(first, FitModes) else sagged(problem, first, 0)
    x = np.array([*at, *guess_of(own)])
    both = in_two_steps(Signals([source], [*common, *own]), x, [source.blocks])
    return [(one, information_of(*(_part(whole, one.addition) for whole in both))) for one in several]


def _part(whole: Likelihood, addition: Addition) -> Likelihood:
    """The part of one candidate, named as its run; priors of common parameters are part of the present data."""
    name, rows = getattr(addition, "name", ""), whole.every
    if isinstance(addition, FitRun):
        by_name = {row.block.name: row for row in rows}
        rows = [by_name[column] for column in addition.noise]
    coordinates = [
        dataclasses.replace(one, run=name) if one.run else dataclasses.replace(one, prior=None)
        for one in whole.coordinates
    ]
    return Likelihood(coordinates, whole.x, [dataclasses.replace(whole.sources[0], name=name)], [rows])


def _of_prior(parameter: FitParameter, common: Sequence[Coordinate], at: Sequence[float]) -> Information:
    x, one = next((x, one) for x, one in zip(at, common, strict=True) if one.path == parameter.path)
    alone = Likelihood([dataclasses.replace(one, prior=parameter.prior)], np.array([x]), [], [])
    return Information(alone.priors, alone.names, 0.0)


def _merged(runs: Sequence[FitRun]) -> FitRun:
    """One run with the columns and the sensors of several repeats of a run."""
    sensors = {one.name: one for run in runs for one in run.set.get("sensor", ())}
    return replace(
        runs[0], columns={name: column for run in runs for name, column in run.columns.items()},
        set=runs[0].set | ({"sensor": tuple(sensors.values())} if sensors else {}),
        noise={name: size for run in runs for name, size in run.noise.items()},
        gain=tuple(name for run in runs for name in run.gain), bias=tuple(name for run in runs for name in run.bias),
    )  # fmt: skip


def _values(coordinates: Sequence[Coordinate], x: Array) -> tuple[tuple[str, float], ...]:
    """Names and values of the parameters; unknown times of runs are left out, as gains and biases are."""
    pairs = zip(coordinates, x, strict=True)
    return tuple((one.name, one.value(float(at))) for one, at in pairs if not one.timing)


def _proposal(
    before: Check, coordinates: Sequence[Coordinate], x: Array, known: Information,
    several: Sequence[tuple[Candidate, Information]],
) -> Proposal:  # fmt: skip
    """The intervals that some experiments together would give."""
    after = known.with_(information for _, information in several).check
    sizes = [(one.size(one.value(float(at))), one) for one, at in zip(coordinates, x, strict=True)]
    changes = tuple(
        Change(one.name, one.measured_in, one.log, size, float(before.expected[k]), float(after.expected[k]))
        for k, (size, one) in enumerate(sizes)
        if not one.timing
    )
    return Proposal(tuple(one for one, _ in several), changes, len(after.lost))


def _rank(one: Proposal) -> tuple[float, ...]:
    """Order: fewest combinations that are not identifiable, then the narrowest widest interval, then all others."""
    σ = sorted((change.after for change in one.changes), reverse=True)
    return (one.lost, float(np.isinf(σ).sum()), *σ)


def _sets(
    before: Check, coordinates: Sequence[Coordinate], x: Array, known: Information,
    found: Sequence[tuple[Candidate, Information]],
) -> list[Proposal]:  # fmt: skip
    """Sets of two and three experiments, each found from the previous one by adding the best further experiment."""
    most = 3  # largest number of experiments in a set
    chosen: list[tuple[Candidate, Information]] = []
    sets: list[Proposal] = []
    while found and len(chosen) < most and not (sets and not sets[-1].lost):
        left = [one for one in found if one not in chosen]
        several = [(_proposal(before, coordinates, x, known, [*chosen, one]), k) for k, one in enumerate(left)]
        best, k = min(several, key=lambda pair: _rank(pair[0]))
        chosen.append(left[k])
        sets.append(best)
    return sets[1:] if sets and sets[-1].lost < sets[0].lost else []


def _separating(
    direction: Direction, found: Sequence[tuple[Candidate, Information]]
) -> tuple[Direction, Candidate | None]:
    """The experiment with the largest effect of a change along a direction; None if none has a clear effect."""
    v = {
        name: part / np.linalg.norm(direction.parts)
        for name, part in zip(direction.names, direction.parts, strict=True)
    }

    def effect(information: Information) -> float:
        along = np.array([v.get(name, 0.0) for name in information.names])
        size = float(np.linalg.norm(information.R @ along))
        return size if size > max(1.0, 10 * information.error) else 0.0

    best = max(found, key=lambda one: effect(one[1]), default=None)
    return direction, best[0] if best is not None and effect(best[1]) > 0 else None
