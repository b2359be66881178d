"""Errors of a fit due to recorded motions: noise of the angles, and the cutoff of their filter.

Each run is predicted again with other versions of its recorded angles, and one Gauss-Newton step from the solution
gives the change d of every parameter:

    noise    u_n² = mean d_k²    over versions with added noise of the estimated size; scatter and bias
             (simulation extrapolation: doubling the noise doubles its bias; Cook and Stefanski 1994)
    cutoff   u_c² = min(d², d'²)    half and twice the cutoff: one of both changes little if the cutoff is well chosen
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.data.smoothing import best_cutoff, noise_of, smoothed
from flexlink.describe.actions import PrescribedMotion
from flexlink.describe.from_files import keys_of_motion, recorded_positions
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor
from flexlink.identification.data import Source, recorded
from flexlink.identification.estimate import Estimate
from flexlink.identification.problem import FitProblem, FitRun
from flexlink.identification.signals import Signals
from flexlink.identification.solve import Found, Search

VERSIONS = 6
"""Number of versions of the recorded angles with added noise."""


class InputError(NamedTuple):
    """Changes of all coordinates by other versions of the recorded motions.

    Attributes
    ----------
    changes
        One row per version: those with added noise, divided by √VERSIONS, then those of the cutoff; shape (rows, p).
    motions
        Texts of the recorded motions, with their cutoffs.
    doubts
        Cutoffs far above that by cross-validation; and why the changes are unknown, if they are.
    """

    changes: Array
    motions: tuple[str, ...] = ()
    doubts: tuple[Diagnostic, ...] = ()

    @property
    def errors(self) -> Array:
        """Error of every coordinate."""
        return np.asarray(np.sqrt((self.changes**2).sum(axis=0)))


def input_error(search: Search, best: Found, problem: FitProblem) -> InputError | None:
    """Errors due to recorded motions in the runs of a fit; None if there are no such motions."""
    runs = {run.name: run for run in problem.run if run.use == "fit" and _filtered(run)}
    if not runs:
        return None
    motions = [motion for run in runs.values() for motion in _filtered(run)]
    words = tuple(_in_words(problem.scene, motion) for motion in motions)
    doubts = tuple(doubt for motion in motions for doubt in _too_high(problem.scene, motion))
    try:
        before = gauss_newton(search, best, search.signals.sources)
        rng = np.random.default_rng(0)
        noisy = [
            gauss_newton(search, best, _sources(search, problem, runs, 1.0, rng)) - before for _ in range(VERSIONS)
        ]
        others = [gauss_newton(search, best, _sources(search, problem, runs, by, None)) - before for by in (0.5, 2.0)]
    except FlexlinkError as error:
        text = f"input error not estimated: with other versions of {words[0]}, {error}"
        return InputError(np.zeros((0, len(best.x))), words, (*doubts, Diagnostic(text, "input-error-unknown")))
    least = np.min(np.abs(others), axis=0)
    return InputError(np.vstack([np.array(noisy) / np.sqrt(VERSIONS), least]), words, doubts)


def warnings_of_inputs(numbers: Sequence[Estimate], found: InputError | None) -> list[Diagnostic]:
    """Warnings about recorded motions whose error exceeds half of an interval, or is unknown."""
    if found is None:
        return []
    shifts = [one.shifted(one.u_input) for one in numbers if one.u_input > one.statistical]
    if not shifts:
        return list(found.doubts)
    text = f"input error: noise or filter of {' and '.join(found.motions)} shift {' and '.join(shifts)}"
    remedy = "try cutoff = 'auto', or measure the angle more finely"
    return [*found.doubts, Diagnostic(f"{text}; {remedy}", "input-error")]


def _too_high(scene: Scene, motion: PrescribedMotion) -> list[Diagnostic]:
    """Warning about a cutoff far above that by cross-validation, which lets noise of the accelerations pass."""
    above = 2.5  # ratio of the cutoffs from which to warn; accelerations are then about ten times less accurate
    if isinstance(motion.cutoff, str) or motion.cutoff is None:
        return []
    best = best_cutoff(*recorded_positions(motion, link_of(scene, motion)))
    if motion.cutoff <= above * best:
        return []
    text = f"{_in_words(scene, motion)}: the filter lets noise pass; set cutoff = 'auto'"
    return [Diagnostic(text, "input-cutoff")]


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
            started = {path: value for one in versions for path, value in _start_of(problem.scene, one).items()}
            source = recorded(problem, replace(run, set=run.set | {"motion": tuple(versions)} | started))  # noqa: PLW2901
        found.append(source)
    return found


def _motions(run: FitRun) -> list[PrescribedMotion]:
    given = run.set.get("motion", ())
    return [PrescribedMotion(**one) if isinstance(one, Mapping) else one for one in given]


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
    rows = {key: tuple(part.tolist()) for key, part in zip(keys_of_motion(link), smoothed(t, y, cutoff), strict=True)}
    return replace(motion, file=None, cutoff=None, times=tuple(t.tolist()), **rows)


def _start_of(scene: Scene, motion: PrescribedMotion) -> dict[str, float]:
    """Initial position and rate of the joint of a motion, by path."""
    if motion.file is not None:
        return {}
    name, unit = link_of(scene, motion).name, motion.keys[0].rpartition("_")[2]
    position, rate, _ = motion.columns
    return {f"initial.joint_{unit}.{name}": position[0], f"initial.rate_{unit}.{name}": rate[0]}


def link_of(scene: Scene, motion: PrescribedMotion | Sensor) -> Link:
    """Link of a motion or of a sensor."""
    return scene.arm.links[scene.arm.number(motion.link) - 1]


def _in_words(scene: Scene, motion: PrescribedMotion) -> str:
    """The motion and its cutoff, with the one that cross-validation would choose."""
    link = link_of(scene, motion)
    best = best_cutoff(*recorded_positions(motion, link))
    given = f"cutoff = {motion.cutoff!r}" if isinstance(motion.cutoff, str) else f"cutoff {motion.cutoff:g} Hz"
    return f"the recorded motion of {link.name} ({given}; by cross-validation {best:g} Hz)"


def gauss_newton(search: Search, best: Found, sources: Sequence[Source]) -> Array:
    """Gauss-Newton step from the solution with these sources, shape (coordinates,)."""
    at = Search(Signals(sources, search.coordinates), search.loss).at(best.x, best.blocks)
    return np.asarray(-np.linalg.lstsq(at.slopes, at.residual, rcond=None)[0])
