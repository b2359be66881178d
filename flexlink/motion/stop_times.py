"""Times at which adaptive steps stop (tstops): knots of inputs, and samples of explicit ones, where that is cheaper."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from flexlink.common.memo import Kept
from flexlink.common.types import Array, Indices
from flexlink.describe.schemes.methods import Method
from flexlink.describe.whole_steps import parts
from flexlink.motion.inputs.tstops import breakpoints, corners, instants
from flexlink.motion.method_choice import tumbles
from flexlink.results.record import Record

SHORTEST = 1e-14
"""Part of the duration below which a step is none."""

Stops = tuple[Array, Array]
"""Times [s], and how long a step must be to pass each [s]; inf: it ends there."""


def only(end: float) -> Stops:
    """No time but the end [s]."""
    return np.array([end]), np.array([np.inf])


class StopTimes:
    """Times at which the steps of a run stop, beside the ends of its pieces.

    Steps of an explicit method end at samples, which cost nothing there. With dense output they pass them if they are
    so much longer than the time between two samples that the stages which it takes are fewer than those of more steps.
    Fixed steps end at samples, too, so that nothing but the state goes past one; and at the knots of a table that is
    not smooth, and then on their own grid again. The instants of a law in Python are ends of pieces, those of a sampled
    drive are ends of steps. Those of a run that judges another one are `halved`: between two times it stops once more,
    so that its steps are shorter wherever these, and not the tolerance, made those of the other so long.

    No sample is passed where errors of long steps would count more than a tolerance says: by bodies that fly freely and
    tumble, whose motion multiplies them, and where it is so told, as of a run that judges fixed steps.

    Attributes
    ----------
    passed_by
        How long a step with a tolerance must be to pass a sample [s]; inf: it ends there.
    """

    def __init__(
        self, method: Method, record: Record, by_drive: bool, *, halved: bool = False, passes: bool = True
    ) -> None:
        part = 0.1  # of tolerance / size: torque, over the largest, that a step may miss between its stages
        on_the_grid = 1e-6  # part of a fixed step within which a time counts as one of its ends
        run, (drive, motion, _, wrench) = record.run, record.inputs
        tables = [table for table in (drive if by_drive else None, wrench) if table is not None]
        self.drive = drive if by_drive and drive.rate else None
        self.run, self.start, self.origin, self.halved = run, float(record.t[0]), record.origin, halved
        self.at_samples = method.explicit or not run.controlled
        self.passed_by = np.inf
        if run.controlled and method.dense is not None and passes and not tumbles(record):
            self.passed_by = run.spacing * (method.stages + method.more_stages) / method.stages
        if run.controlled:
            size = record.chain.size
            smooth = [breakpoints(table, part * run.tolerance_within(size) / size) for table in tables]
            fixed = np.concatenate([*smooth, motion.knots])
        else:
            number = np.concatenate([*map(corners, tables), motion.knots]) / run.fixed_step
            number = number[np.abs(number - np.round(number)) > on_the_grid]
            fixed = np.concatenate([number, np.ceil(number)]) * run.fixed_step
        self.fixed: list[float] = sorted(set(fixed.tolist()))
        self._kept = Kept()

    @property
    def span(self) -> float:
        """The longest time between two stops that every step must end at [s], but for rounding."""
        return self.run.spacing if self.passed_by == np.inf else self.run.duration

    def between(self, start: float, end: float) -> Stops:
        """Those after `start` and before `end`, and `end`; not to be written to."""
        if start == end:
            return only(end)
        if self.halved:
            times, passed_by = self._between(start, end)
            middles = (np.append(start, times[:-1]) + times) / 2
            beside = np.minimum(np.append(np.inf, passed_by[:-1]), passed_by)
            return np.column_stack([middles, times]).ravel(), np.column_stack([beside, passed_by]).ravel()
        if self.drive is not None or not self.at_samples:
            return self._between(start, end)
        found: Stops = self._kept("between", (start, end), lambda: self._between(start, end))
        return found

    def _between(self, start: float, end: float) -> Stops:
        fixed = self.fixed[bisect_right(self.fixed, start) : bisect_left(self.fixed, end)]
        if not (fixed or self.at_samples or self.drive):
            return only(end)
        samples = self._samples(start, end) if self.at_samples else range(0)
        asked = instants(self.drive, start, end)
        if not self.run.controlled:  # as they are on the grid, or a step of one rounding would lie between
            asked = np.round(asked / self.run.fixed_step) * self.run.fixed_step
        if not fixed and not samples and not len(asked):
            return only(end)
        times, must = self._times(np.arange(samples.start, samples.stop)), np.concatenate([fixed, asked])
        if len(times) and len(must):
            times = np.unique(np.concatenate([must, times]))
        elif len(must):  # of one kind they are in order
            times = np.unique(must) if fixed and len(asked) else must
        shortest = SHORTEST * self.run.duration + 2 * np.spacing(end)
        times = times[(times > start + shortest) & (times < end - shortest)]
        passed_by = np.full(len(times) + 1, self.passed_by)
        passed_by[np.searchsorted(times, must[(must > start + shortest) & (must < end - shortest)])] = np.inf
        passed_by[-1] = np.inf
        return np.append(times, end), passed_by

    def _samples(self, start: float, end: float) -> range:
        """Numbers of the samples between two times."""
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
