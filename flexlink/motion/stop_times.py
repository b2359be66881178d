"""Times at which adaptive steps stop (tstops): knots of inputs and, for explicit methods where cheaper, samples."""

import math
from bisect import bisect_left, bisect_right

import numpy as np

from flexlink.common.memo import Kept
from flexlink.common.types import Array, Indices
from flexlink.describe.numbers import parts
from flexlink.describe.schemes.methods import Method
from flexlink.motion.inputs.actuation import corners
from flexlink.motion.inputs.tstops import breakpoints, instants
from flexlink.motion.method_choice import tumbles
from flexlink.results.record import Record

SHORTEST = 1e-14  # smallest distance between two stops, as a fraction of the duration; closer stops are skipped

Stops = tuple[Array, Array]
"""Stop times [s], and for each the minimum length of a step that may extend beyond it [s]; inf: steps end there."""


def only(end: float) -> Stops:
    """The end [s] as the only stop."""
    return np.array([end]), np.array([np.inf])


class StopTimes:
    """Times at which the steps of a run stop, in addition to the ends of its pieces.

    Explicit steps end at samples, which then cost nothing. With dense output a step may extend beyond a sample if it is
    so long that the stages for dense output cost less than additional steps. Fixed steps also end at samples, so that
    only the state is carried over. In addition they end at the knots of a nonsmooth table, and then return to their
    grid. Instants of a control law in Python are ends of pieces; instants of a sampled drive are ends of steps. In a
    verification run (`halved`) an additional stop halfway between two stops shortens steps that are limited by stops
    and not by the tolerance.

    All steps end at samples if errors of longer steps would exceed the tolerance: for freely tumbling bodies, whose
    motion amplifies errors, and if `passes` is False, as in a run that verifies fixed steps.

    `passed_by`: minimum length of an adaptive step that may extend beyond a sample [s]; inf: steps end there.
    """

    def __init__(
        self, method: Method, record: Record, by_drive: bool, *, halved: bool = False, passes: bool = True
    ) -> None:
        part = 0.1  # ignored torque error between stages, relative to the largest torque times tolerance / size
        on_the_grid = 1e-6  # fraction of a fixed step within which a time counts as on the grid
        run, (drive, motion, _, wrench), ties = record.run, record.inputs, record.problem.ties
        lengths = np.empty(0) if ties is None else ties[1].knots
        tables = [table for table in (drive if by_drive else None, wrench) if table is not None]
        delayed = np.empty(0) if by_drive or not drive.delay else drive.feedforward.knots  # torques of a law in Python
        self.drive = drive if by_drive and drive.rate else None
        self.run, self.start, self.origin, self.halved = run, float(record.t[0]), record.origin, halved
        self.at_samples = method.explicit or not run.controlled
        self.passed_by = np.inf
        if run.controlled and method.dense is not None and passes and not tumbles(record):
            self.passed_by = run.spacing * (method.stages + method.more_stages) / method.stages
        if run.controlled:
            size = record.chain.size
            smooth = [breakpoints(table, part * run.tolerance_within(size) / size) for table in tables]
            fixed = np.concatenate([*smooth, motion.knots, lengths, delayed])
        else:
            number = np.concatenate([*map(corners, tables), motion.knots, lengths]) / run.fixed_step
            number = number[np.abs(number - np.round(number)) > on_the_grid]
            fixed = np.concatenate([number, np.ceil(number)]) * run.fixed_step
        self.fixed: list[float] = sorted(set(fixed.tolist()))
        self._kept = Kept()

    @property
    def span(self) -> float:
        """Longest time between two stops at which every step must end [s], up to rounding."""
        return self.run.spacing if self.passed_by == np.inf else self.run.duration

    def between(self, start: float, end: float) -> Stops:
        """Stops after `start`, the last of them at `end`; read-only."""
        if start == end:
            return only(end)
        find = self._halved if self.halved else self._between
        if self.drive is not None:
            return find(start, end)
        return self._kept("between", (start, end), lambda: find(start, end))

    def _halved(self, start: float, end: float) -> Stops:
        times, passed_by = self._between(start, end)
        before = np.append(start, times[:-1])
        middles, beside = (before + times) / 2, np.minimum(np.append(np.inf, passed_by[:-1]), passed_by)
        apart = (middles > before) & (middles < times)  # a knot and a sample may be one rounding error apart
        new = np.flatnonzero(apart)
        return np.insert(times, new, middles[apart]), np.insert(passed_by, new, beside[apart])

    def _between(self, start: float, end: float) -> Stops:
        fixed = self.fixed[bisect_right(self.fixed, start) : bisect_left(self.fixed, end)]
        if not (fixed or self.at_samples or self.drive):
            return only(end)
        samples = self._samples(start, end) if self.at_samples else range(0)
        sampled = instants(self.drive, start, end)
        if not self.run.controlled:  # snap to the grid, to avoid steps as short as a rounding error
            sampled = np.round(sampled / self.run.fixed_step) * self.run.fixed_step
        if not fixed and not samples and not len(sampled):
            return only(end)
        times, must = self._times(np.arange(samples.start, samples.stop)), np.concatenate([fixed, sampled])
        if len(times) and len(must):
            times = np.unique(np.concatenate([must, times]))
        elif len(must):  # already sorted if all stops are of one kind
            times = np.unique(must) if fixed and len(sampled) else must
        shortest = SHORTEST * self.run.duration + 2 * np.spacing(end)
        times = times[(times > start + shortest) & (times < end - shortest)]
        passed_by = np.full(len(times) + 1, self.passed_by)
        passed_by[np.searchsorted(times, must[(must > start + shortest) & (must < end - shortest)])] = np.inf
        passed_by[-1] = np.inf
        return np.append(times, end), passed_by

    def _samples(self, start: float, end: float) -> range:
        """Indices of the samples between two times."""
        run = self.run
        if run.controlled:
            first, last = (parts(t - self.start, run.spacing) for t in (start, end))
            return range(math.floor(first) + 1, math.ceil(last))
        first, last = (round(t / run.fixed_step) - self.origin for t in (start, end))
        return range(first // run.steps_per_sample + 1, -(-last // run.steps_per_sample))

    def _times(self, numbers: Indices) -> Array:
        run = self.run
        if run.controlled:
            return np.asarray((parts(self.start, run.spacing) + numbers) * run.spacing)
        return np.asarray((self.origin + numbers * run.steps_per_sample) * run.fixed_step)
