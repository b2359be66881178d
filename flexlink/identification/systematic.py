"""Errors of a fit that more data do not reduce: of the grid, of inner gyroscopes, and of recorded motions.

    half-width = k √(σ² + u_num² + u_input²)        as in ASME V&V 20-2009, section 1

Grid error: the change of every parameter when the model gets twice the hinges.

    x' = argmin cost of the refined model, from x     u = 4/3 |x' − x|

The factor is that of an error of order 2 (Richardson): the limit of infinitely many hinges differs from x by
(x' − x) / (1 − 2⁻²). Steps of the refined model are controlled by a tolerance, so u contains the error of fixed steps.

Recorded motions: noise of the angles, and the cutoff of their filter. Each run is predicted again with other versions
of its recorded angles, and one Gauss-Newton step from the solution gives the change d of every parameter:

    noise    u_n² = mean d_k²    over versions with added noise of the estimated size; scatter and bias
             (simulation extrapolation: doubling the noise doubles its bias; Cook and Stefanski 1994)
    cutoff   u_c² = min(d², d'²)    half and twice the cutoff: one of both changes little if the cutoff is well chosen
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.data.smoothing import best_cutoff, noise_of, smoothed
from flexlink.describe.actions import PrescribedMotion
from flexlink.describe.from_files import recorded_positions
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.sensor import Sensor, column_names
from flexlink.describe.variants import refined, segments_in_words
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source, recorded
from flexlink.identification.fitted import Estimate
from flexlink.identification.identifiability import WIDE, Check
from flexlink.identification.likelihood import Likelihood, likelihood
from flexlink.identification.problem import FitProblem, FitRun
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found, Search

Grid = Literal["check", "auto", "ignore"]
"""Treatment of the grid error: estimate it; take enough segments; or ignore it, for data from the same chain."""
REFINED = 2.0  # factor between the numbers of hinges of the two models
RICHARDSON = 1 / (1 - REFINED**-2)  # ratio of the error of order 2 to the change by refinement
ENOUGH = 0.25  # grid error at which the number of segments is sufficient, relative to half the 95 % interval


class Shifts(NamedTuple):
    """Changes of the parameters by the parts of an error, which are independent of each other."""

    changes: Array = np.zeros((0, 0))  # of the search coordinates, then of gains, biases and drifts, shape (parts, p)
    doubts: tuple[Diagnostic, ...] = ()  # why they are unknown, or likely large
    motions: tuple[str, ...] = ()  # texts of the recorded motions that cause them, with their cutoffs

    @property
    def errors(self) -> Array:
        """Error of every parameter, shape (p,); empty if it is unknown."""
        return np.asarray(np.sqrt((self.changes**2).sum(axis=0)))


def refined_sources(sources: Sequence[Source], tolerance: float) -> list[Source]:
    """The same data, predicted by models with twice the hinges and with steps by a tolerance."""
    found, own = [], {"run.relative_tolerance": tolerance}
    for one in sources:
        finer = refined(one.scene, REFINED)
        found.append(dataclasses.replace(one, scene=finer if finer.run.controlled else finer.varied(own)))
    return found


def grid_error(
    search: Search, best: Found, at: Likelihood, tolerance: float
) -> tuple[Shifts, tuple[Search, Found] | None]:
    """Fit the refined model, from the solution of the model, with its likelihood and noise; with that fit.

    Inner gyroscopes are further parts of this error, before the last one.
    """
    try:
        signals = Signals(refined_sources(search.signals.sources, tolerance), search.coordinates)
        finer = Search(signals, search.loss, coloured=search.coloured, watch=search.watch)
        signals.model(best.x)
        x = finer.least(best.x, best.blocks, rough=True)
        change = RICHARDSON * np.append(x - best.x, likelihood(signals, x, best.blocks).linear - at.linear)
    except FlexlinkError as error:
        return Shifts(doubts=(_unknown(error),)), None
    fitted = finer, Found(x, best.cost, best.blocks)
    try:
        inner = errors_of_inner_gyroscopes(search, best)
    except FlexlinkError as error:
        unknown = Diagnostic(f"grid error of gyroscopes not estimated: {error}", "grid-error-unknown")
        return Shifts(change[None], (unknown,)), fitted
    return Shifts(np.array([*(np.pad(one, (0, len(change) - len(one))) for one in inner), change])), fitted


def bends(scene: Scene) -> bool:
    """Whether a link of the scene bends, so that there is a grid error."""
    return any(link.flex != "rigid" for link in scene.arm.links)


def factor_needed(errors: Array, halves: Array) -> float:
    """Factor of the hinges that likely makes every grid error small against half its interval; 1 if all are.

    The factor is that of an error of order 4, as of most rules in small bending; the next fit checks it.
    """
    known = np.isfinite(halves) & (halves > 0)
    worst = (errors[known] / (ENOUGH * halves[known])).max(initial=0.0)
    return float(np.clip(worst**0.25, 1.5, 8.0)) if worst > 1 else 1.0


def grid_ahead(at: Likelihood, check: Check, tolerance: float) -> tuple[Array, tuple[Diagnostic, ...]]:
    """Expected grid error of every parameter at a point, and notes: one Gauss-Newton step on the refined model.

    x' − x = −J⁺ (y' − y) / σ, with the predictions y of the model and y' of the refined model.
    """
    try:
        finer = Signals(refined_sources(at.sources, tolerance), at.coordinates).model(at.x)
    except FlexlinkError as error:
        return np.empty(0), (_unknown(error),)
    predicted = [y for part in finer for y in part]
    apart = [(new - row.y) / row.block.σ for row, new in zip(at.every, predicted, strict=True)]
    changes = np.linalg.lstsq(at.scaled, np.concatenate([0 * at.of_priors, *apart]), rcond=None)[0]
    u = RICHARDSON * np.abs(changes[: len(at.x)])
    halves = WIDE * check.expected[: len(u)]
    large = np.flatnonzero(u > ENOUGH * halves)
    if not len(large):
        return u, ()
    shifts = [f"{check.names[k]} by {100 * u[k]:.2g} %" for k in large.tolist()]
    return u, (_warning(at.sources[0].scene, shifts, factor_needed(u, halves)),)


def _warning(scene: Scene, shifts: Sequence[str], factor: float) -> Diagnostic:
    enough = segments_in_words(refined(scene, factor))
    text = f"grid error: {segments_in_words(scene)} shift {' and '.join(shifts)}; take {enough} (--grid auto)"
    return Diagnostic(text, "grid-error")


def _unknown(error: FlexlinkError) -> Diagnostic:
    return Diagnostic(f"grid error not estimated: with twice the hinges, {error}", "grid-error-unknown")


VERSIONS = 6  # number of versions of the recorded angles with added noise


def input_error(search: Search, best: Found, problem: FitProblem) -> Shifts:
    """Errors due to recorded motions: by versions with added noise, divided by √VERSIONS, then by the cutoff."""
    if not (runs := {run.name: run for run in problem.run if run.use == "fit" and _filtered(run)}):
        return Shifts()
    described = [_described(problem.scene, motion) for run in runs.values() for motion in _filtered(run)]
    words = tuple(text for text, _ in described)
    doubts = tuple(doubt for _, doubt in described if doubt is not None)
    rng = np.random.default_rng(0)

    def change(by: float, rng: np.random.Generator | None) -> Array:
        return gauss_newton(search, best, _sources(search, problem, runs, by, rng)) - before

    try:
        before = gauss_newton(search, best, search.signals.sources)
        noisy = np.array([change(1.0, rng) for _ in range(VERSIONS)]) / np.sqrt(VERSIONS)
        least = np.min(np.abs([change(by, None) for by in (0.5, 2.0)]), axis=0)
    except FlexlinkError as error:
        text = f"input error not estimated: with other versions of {words[0]}, {error}"
        return Shifts(doubts=(*doubts, Diagnostic(text, "input-error-unknown")), motions=words)
    return Shifts(np.vstack([noisy, least]), doubts, words)


def warnings_of_inputs(numbers: Sequence[Estimate], found: Shifts) -> list[Diagnostic]:
    """Warnings about recorded motions whose error exceeds half of an interval, or is unknown."""
    shifts = [one.shifted(one.u_input) for one in numbers if one.u_input > one.statistical]
    if not shifts:
        return list(found.doubts)
    text = f"input error: noise or filter of {' and '.join(found.motions)} shift {' and '.join(shifts)}"
    return [*found.doubts, Diagnostic(f"{text}; try cutoff = 'auto', or measure the angle more finely", "input-error")]


def _described(scene: Scene, motion: PrescribedMotion) -> tuple[str, Diagnostic | None]:
    """The motion and its cutoff, with the one that cross-validation would choose; and a doubt about one far above it.

    It lets noise of the accelerations pass.
    """
    above = 2.5  # ratio of the cutoffs from which to warn; accelerations are then about ten times less accurate
    link, cutoff = link_of(scene, motion), motion.cutoff
    best = best_cutoff(*recorded_positions(motion, link))
    given = f"cutoff = {cutoff!r}" if isinstance(cutoff, str) else f"cutoff {cutoff:g} Hz"
    text = f"the recorded motion of {link.name} ({given}; by cross-validation {best:g} Hz)"
    if isinstance(cutoff, str) or cutoff is None or cutoff <= above * best:
        return text, None
    return text, Diagnostic(f"{text}: the filter lets noise pass; set cutoff = 'auto'", "input-cutoff")


def _filtered(run: FitRun) -> list[PrescribedMotion]:
    """Recorded motions of a run that are filtered."""
    return [one for one in _motions(run) if one.file is not None and one.cutoff is not None]


def _sources(
    search: Search, problem: FitProblem, runs: Mapping[str, FitRun], by: float, rng: np.random.Generator | None
) -> list[Source]:
    """The sources with another version of their recorded motions."""
    found = []
    for source in search.signals.sources:
        run = runs.get(source.name) if source.is_run else None
        if run is not None:
            versions = [_version(problem.scene, one, by, rng) for one in _motions(run)]
            started = dict[str, float]()  # initial positions and rates of the joints of these motions, by path
            for one in (each for each in versions if each.file is None):
                name, unit = link_of(problem.scene, one).name, one.keys[0].rpartition("_")[2]
                position, rate, _ = one.columns
                started |= {f"initial.joint_{unit}.{name}": position[0], f"initial.rate_{unit}.{name}": rate[0]}
            source = recorded(problem, replace(run, set=run.set | {"motion": tuple(versions)} | started))  # noqa: PLW2901
        found.append(source)
    return found


def _motions(run: FitRun) -> list[PrescribedMotion]:
    return [PrescribedMotion(**one) if isinstance(one, Mapping) else one for one in run.set.get("motion", ())]


def _version(scene: Scene, motion: PrescribedMotion, by: float, rng: np.random.Generator | None) -> PrescribedMotion:
    """A recorded motion with a multiple of its cutoff, and with added noise."""
    if motion.file is None or motion.cutoff is None:
        return motion
    link = link_of(scene, motion)
    t, y = recorded_positions(motion, link)
    cutoff = by * (best_cutoff(t, y) if isinstance(motion.cutoff, str) else motion.cutoff)
    cutoff = min(cutoff, 0.45 / float(np.diff(t).max()))
    if rng is not None:
        y = y + noise_of(y) * rng.standard_normal(len(y))
    keys = link.joint.terms.motion
    rows = {key: tuple(part.tolist()) for key, part in zip(keys, smoothed(t, y, cutoff), strict=True)}
    return replace(motion, file=None, cutoff=None, times=tuple(t.tolist()), **rows)


def link_of(scene: Scene, motion: PrescribedMotion | Sensor) -> Link:
    """Link of a motion or of a sensor."""
    return scene.arm.links[scene.arm.number(motion.link) - 1]


def gauss_newton(search: Search, best: Found, sources: Sequence[Source]) -> Array:
    """Gauss-Newton step from the solution with these sources, shape (coordinates,)."""
    at = Search(Signals(sources, search.coordinates), search.loss).at(best.x, best.blocks)
    return np.asarray(-np.linalg.lstsq(at.slopes, at.residual, rcond=None)[0])


class Systematic(NamedTuple):
    """Grid error, and error of recorded motions."""

    grid: Shifts = Shifts()
    inputs: Shifts = Shifts()
    refined: tuple[Search, Found] | None = None  # search on the refined model, and its solution; None if there is none

    def added(
        self, numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], x: Array, wide: float
    ) -> tuple[Estimate, ...]:
        """The estimates, with these errors in their intervals; `wide` is the half-width of one over its deviation."""
        found = with_error(numbers, coordinates, x, self.grid.errors, wide, "u_num")
        return with_error(found, coordinates, x, self.inputs.errors, wide, "u_input")

    @property
    def shifts(self) -> list[Array]:
        """Changes of the search coordinates, whose outer products add to their covariance."""
        return [*self.grid.changes[-1:], *self.grid.changes[:-1], *self.inputs.changes]

    def warnings(self, scene: Scene, numbers: Sequence[Estimate]) -> tuple[Diagnostic, ...]:
        """Warnings about errors that exceed half of an interval, or that are unknown."""
        large = [one.shifted(one.u_num) for one in numbers if one.u_num > one.statistical]
        found = list(self.grid.doubts)
        if large and not found:
            factor = factor_needed(*np.array([(one.u_num, one.statistical) for one in numbers]).T)
            found.append(_warning(scene, large, factor))
        return (*found, *warnings_of_inputs(numbers, self.inputs))


def systematic_errors(
    search: Search, best: Found, at: Likelihood, problem: FitProblem, grid: Grid, report: Callable[[str], None]
) -> Systematic:
    """Errors at a solution with this likelihood."""
    of_grid, fitted = Shifts(), None
    if grid != "ignore" and bends(problem.scene):
        report("grid error: fitting a model with twice the hinges")
        of_grid, fitted = grid_error(search, best, at, problem.tolerance)
    return Systematic(of_grid, input_error(search, best, problem), fitted)


def with_error(
    numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], x: Array, errors: Array, wide: float, name: str
) -> tuple[Estimate, ...]:
    """The estimates with a further error in their intervals, "u_num" or "u_input", in search coordinates.

    `errors` may be shorter than `numbers`; `wide` is the half-width of an interval over its deviation.
    """
    found = list(numbers)
    itself = Coordinate("", "", 0.0, False, 1.0, (-math.inf, math.inf), None)  # of gains, biases and drifts
    for k, (one, u) in enumerate(zip(numbers, errors.tolist(), strict=False)):
        by, at = (coordinates[k], float(x[k])) if k < len(coordinates) else (itself, one.value)
        low, high = at - math.hypot(at - by.x(one.low), wide * u), at + math.hypot(by.x(one.high) - at, wide * u)
        size = by.size(one.value)
        found[k] = dataclasses.replace(
            one, low=by.value(low), high=by.value(high), deviation=math.hypot(one.deviation, size * u),
            statistical=min(one.half, one.statistical), **{name: size * u},
        )  # fmt: skip
    return tuple(found)


def within_bounds(one: Estimate) -> Estimate:
    """The estimate, with a finite interval clipped to the bounds of the search."""
    low, high = one.between
    return dataclasses.replace(one, low=max(one.low, low), high=min(one.high, high)) if np.isfinite(one.half) else one


def covariance_of(coordinates: Sequence[Coordinate], x: Array, covariance: Array, shifts: Sequence[Array]) -> Array:
    """Covariance of the estimates in their units, with common shifts u of the coordinates: C + Σ u uᵀ."""
    sizes = [one.size(one.value(float(at))) for one, at in zip(coordinates, x, strict=True)]
    scale = np.append(sizes, np.ones(len(covariance) - len(sizes)))
    several = [np.pad(u, (0, len(scale) - len(u))) for u in shifts]
    return np.asarray(scale[:, None] * (covariance + sum(np.outer(u, u) for u in several)) * scale)


def errors_of_inner_gyroscopes(search: Search, best: Found) -> list[Array]:
    """Changes of the coordinates by the error of each inner gyroscope whose column is fitted, shape (p,) each.

    Gyroscopes between the ends of a flexible link read the rotation of their rigid segment, with an error of order h.
    The rotation of segment i is that of the beam at b_i = Σ w_j over the hinges before it, w_j the weights of the
    lumping rule; at x = s L it differs by the share (s − b_i) / (b_{i+1} − b_i) of the change to the next segment.
    Twice the hinges may leave this share of a segment's length as it is, so that refinement alone does not show it.
    """
    sources, found = search.signals.sources, []
    names = {sensor.name for source in sources for sensor in _inner(source)}
    before = gauss_newton(search, best, sources) if names else np.zeros(len(best.x))
    for name in sorted(names):
        moved, share = list(sources), 0.0
        for k, source in enumerate(sources):
            for sensor in _inner(source):
                if sensor.name == name:
                    x, share = _neighbour(source.scene, sensor)
                    others = tuple(replace(one, x=x) if one.name == name else one for one in source.scene.sensor)
                    moved[k] = dataclasses.replace(source, scene=replace(source.scene, sensor=others))
        found.append(share * (gauss_newton(search, best, moved) - before))
    return found


def _inner(source: Source) -> list[Sensor]:
    """Gyroscopes between the ends of flexible links, whose columns are compared."""
    if not source.is_run:
        return []
    arm, compared = source.scene.arm, {block.name for block in source.blocks}
    inner = (
        (one, link_of(source.scene, one)) for one in source.scene.sensor
        if one.kind == "gyroscope" and one.x and compared & {*column_names((one,), arm)}
    )  # fmt: skip
    return [one for one, on in inner if on.flex != "rigid" and 0 < (one.x or 0.0) < on.beam.length * (1 - 1e-9)]


def _neighbour(scene: Scene, sensor: Sensor) -> tuple[float, float]:
    """Position in the segment next to a gyroscope, and the share of the change to it that is the gyroscope's error."""
    link = link_of(scene, sensor)
    assert sensor.x is not None
    nodes, weights = lumping_rule(link.lumping).hinges(link.segments - 1)
    s, ends = sensor.x / link.beam.length, np.concatenate([[0.0], nodes, [1.0]])
    b = np.concatenate([[0.0], np.cumsum(weights)])
    i = int(np.searchsorted(ends, s, side="right")) - 1
    other = i + 1 if (s > b[i] and i + 1 < len(b)) or i == 0 else i - 1
    return float((ends[other] + ends[other + 1]) / 2 * link.beam.length), float(abs(s - b[i]) / abs(b[other] - b[i]))
