"""propose(problem): rank experiments by how much each would narrow the widest 95 % interval.

    s(B + J_cᵀ J_c),  B = Jᵀ J of the present data and priors,  J_c = ∂(data of the experiment / noise)/∂x

Both Jacobians are taken at the same values of the parameters: the initial guess, or the solution of a fit, where B is
the inverse of the fit's covariance. Gains, biases and parameters of single runs are unknowns throughout. The estimate
is linear, as in the identifiability check.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from flexlink.chain.arguments import require_type
from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.identification.block import with_noise_of_data
from flexlink.identification.candidates import Addition, Bench, Candidate
from flexlink.identification.coordinates import Coordinate, coordinates_of, guess_of, run_coordinates
from flexlink.identification.data import Source, recorded, sagged, sources_of, tapped
from flexlink.identification.experiments import Experiments
from flexlink.identification.fitted import Fitted
from flexlink.identification.identifiability import Direction
from flexlink.identification.likelihood import Information, Likelihood, in_two_steps, information_of
from flexlink.identification.problem import FitModes, FitParameter, FitProblem, FitRun
from flexlink.identification.proposals import Change, Proposal, Proposals
from flexlink.identification.remarks import notes
from flexlink.identification.signals import Signals


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
    coordinates, sources, assumed = coordinates_of(of), sources_of(of, "fit"), list[Diagnostic]()
    if fitted is not None:  # runs get the noise that the fit estimated, unless this is 0, of exact data
        solution = {one.name: one.value for one in fitted.numbers}
        noise = {(one.source, one.name): one.noise for one in fitted.columns if one.t is not None and one.noise > 0}
        for source in sources:
            source.blocks = tuple(block.with_deviation(noise.get((source.name, block.name))) for block in source.blocks)
        x = np.array([one.x(solution[one.name]) for one in coordinates])
    else:
        x, of_noise = guess_of(coordinates), {"assumed-noise", "estimated-noise"}
        assumed = [one for one in notes(sources) if one.id in of_noise]
        for source in sources:
            source.blocks = tuple(with_noise_of_data(source.blocks))
    bench = Bench(of, sources, coordinates, x)
    ranking = Ranking(bench, _present(fitted, coordinates, sources, x))
    found = [*ranking.informed(_given(experiments))]
    ranked = sorted((ranking.proposal([one]) for one in found), key=_rank)
    sets = [] if any(not one.lost for one in ranked) else ranking.sets(found)
    separating = tuple(_separating(direction, found) for direction in ranking.before.lost)
    values = ((one.name, one.value(float(at))) for one, at in zip(coordinates, x, strict=True) if not one.timing)
    return Proposals(
        ranking.before, tuple(values), fitted is not None, tuple(ranked), tuple(sets), separating,
        tuple(bench.skipped), len(found), tuple(assumed),
    )  # fmt: skip


def _given(experiments: str | Path | Experiments | None) -> Experiments:
    base = Experiments.load(Path(__file__).parent / "experiments.toml")
    if experiments is None:
        return base
    more = experiments if isinstance(experiments, Experiments) else Experiments.load(experiments)
    return Experiments(**{key: getattr(base, key) + getattr(more, key) for key in Experiments.__struct_fields__})


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


Informed = tuple[Candidate, Information]  # an experiment, and its information about the parameters


class Ranking:
    """Experiments on a bench, compared by the intervals that they would give together with what is `known`."""

    def __init__(self, bench: Bench, known: Information) -> None:
        self.bench, self.known, self.before = bench, known, known.check

    def informed(self, experiments: Experiments) -> Iterator[Informed]:
        """All candidates with their information; those that cannot be simulated, or hide present data, are skipped."""
        beside: dict[str, list[Candidate]] = {}
        for one in self.bench.candidates(experiments):
            if one.beside:
                beside.setdefault(one.beside, []).append(one)
            else:
                yield from self._accurate([one])
        for several in beside.values():
            yield from self._accurate(several)

    def _accurate(self, several: Sequence[Candidate]) -> Iterator[Informed]:
        """Candidates of one run whose derivatives are accurate enough that adding them hides no effect of the data."""
        try:
            found = self._of_run(several)
        except FlexlinkError as error:
            for one in several:
                self.bench.skip(one.title, error)
            return
        for one, information in found:
            lost = self.known.with_([information]).check.lost
            own = {name for direction in lost for name in direction.names} - {*self.known.names}
            if own:
                self.bench.skip(one.title, f"{' and '.join(sorted(own))} would not be identifiable")
            elif len(lost) > len(self.before.lost):
                why = "its derivatives are too inaccurate; the motion is too long or too sensitive"
                self.bench.skip(one.title, why)
            else:
                yield one, information

    def _of_run(self, several: Sequence[Candidate]) -> list[Informed]:
        """Information of candidates that one run, or one single measurement, provides."""
        problem, pairs = self.bench.problem, zip(self.bench.coordinates, self.bench.x, strict=True)
        common = [(one, float(x)) for one, x in pairs if not one.run]
        first = several[0].addition
        if isinstance(first, FitParameter):
            known, x = next((one, x) for one, x in common if one.path == first.path)
            alone = Likelihood([dataclasses.replace(known, prior=first.prior)], np.array([x]), [], [])
            return [(several[0], Information(alone.priors, alone.names, 0.0))]
        own: list[Coordinate] = []
        if isinstance(first, FitRun):
            merged = _merged([one.addition for one in several if isinstance(one.addition, FitRun)])
            whole = replace(problem, run=(*problem.run, merged))
            source, own = recorded(whole, merged), run_coordinates(whole, merged)
        else:
            source = tapped(problem, first, 0) if isinstance(first, FitModes) else sagged(problem, first, 0)
        point = np.array([*(x for _, x in common), *guess_of(own)])
        both = in_two_steps(Signals([source], [*(one for one, _ in common), *own]), point, [source.blocks])
        return [(one, information_of(*(_part(at, one.addition) for at in both))) for one in several]

    def proposal(self, several: Sequence[Informed]) -> Proposal:
        """The intervals that some experiments together would give."""
        after = self.known.with_(information for _, information in several).check
        each = zip(self.bench.coordinates, self.bench.x, self.before.expected, after.expected, strict=False)
        changes = tuple(
            Change(one.name, one.measured_in, one.log, one.size(one.value(float(x))), float(was), float(now))
            for one, x, was, now in each
            if not one.timing
        )
        return Proposal(tuple(one for one, _ in several), changes, len(after.lost))

    def sets(self, found: Sequence[Informed]) -> list[Proposal]:
        """Sets of two and three experiments, each found from the one before by adding the best further experiment."""
        most = 3  # largest number of experiments in a set
        chosen: list[Informed] = []
        sets: list[Proposal] = []
        while found and len(chosen) < most and not (sets and not sets[-1].lost):
            left = [one for one in found if one not in chosen]
            several = [(self.proposal([*chosen, one]), k) for k, one in enumerate(left)]
            best, k = min(several, key=lambda pair: _rank(pair[0]))
            chosen.append(left[k])
            sets.append(best)
        return sets[1:] if sets and sets[-1].lost < sets[0].lost else []


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


def _merged(runs: Sequence[FitRun]) -> FitRun:
    """One run with the columns and the sensors of several repeats of a run."""
    sensors = {one.name: one for run in runs for one in run.set.get("sensor", ())}
    return replace(
        runs[0], columns={name: column for run in runs for name, column in run.columns.items()},
        set=runs[0].set | ({"sensor": tuple(sensors.values())} if sensors else {}),
        noise={name: size for run in runs for name, size in run.noise.items()},
        gain=tuple(name for run in runs for name in run.gain), bias=tuple(name for run in runs for name in run.bias),
    )  # fmt: skip


def _rank(one: Proposal) -> tuple[float, ...]:
    """Order: fewest combinations that are not identifiable, then the narrowest widest interval, then all others."""
    σ = sorted((change.after for change in one.changes), reverse=True)
    return (one.lost, float(np.isinf(σ).sum()), *σ)


def _separating(direction: Direction, found: Sequence[Informed]) -> tuple[Direction, Candidate | None]:
    """The experiment with the largest effect of a change along a direction; None if none has a clear effect."""
    v = dict(zip(direction.names, np.array(direction.parts) / np.linalg.norm(direction.parts), strict=True))

    def effect(one: Informed) -> float:
        information = one[1]
        size = float(np.linalg.norm(information.R @ np.array([v.get(name, 0.0) for name in information.names])))
        return size if size > max(1.0, 10 * information.error) else 0.0

    best = max(found, key=effect, default=None)
    return direction, best[0] if best is not None and effect(best) > 0 else None
