"""Times at which adaptive steps must stop (tstops): knots of the inputs, and samples of explicit methods."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from flexlink.common.memo import Kept
from flexlink.common.types import Array, Indices
from flexlink.describe.schemes.methods import Method
from flexlink.describe.whole_steps import parts
from flexlink.motion.inputs.tstops import breakpoints, corners, instants
from flexlink.results.record import Record

SHORTEST = 1e-14
"""Part of the duration below which a step is none."""


class StopTimes:
    """Times at which the steps of a run stop, beside the ends of its pieces.

    A long step of an explicit method ends at its samples: between its ends it is known less well than there. Fixed
    steps end there, too, so that nothing but the state goes past a sample; and at the knots of a table that is not
    smooth, and then on their own grid again. The instants of a law in Python are ends of pieces, those of a
    sampled drive are ends of steps. Those of a run that judges another one are `halved`: between two times it stops
    once more, so that its steps are shorter wherever they, and not the tolerance, made those of the other so long.
    """

    def __init__(self, method: Method, record: Record, by_drive: bool, halved: bool = False) -> None:
        part = 0.1  # of tolerance / size: torque, over the largest, that a step may miss between its stages
        on_the_grid = 1e-6  # part of a fixed step within which a time counts as one of its ends
        run, (drive, motion, _, wrench) = record.run, record.inputs
        tables = [table for table in (drive if by_drive else None, wrench) if table is not None]
        self.drive = drive if by_drive and drive.rate else None
        self.run, self.start, self.origin, self.halved = run, float(record.t[0]), record.origin, halved
        self.at_samples = method.explicit or not run.controlled
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

    def between(self, start: float, end: float) -> Array:
        """Those after `start` and before `end`, and `end` [s]; not to be written to."""
        if start == end:
            return np.array([end])
        if self.halved:
            times = self._between(start, end)
            return np.column_stack([(np.append(start, times[:-1]) + times) / 2, times]).ravel()
        if self.drive is not None or not self.at_samples:
            return self._between(start, end)
        return np.asarray(self._kept("between", (start, end), lambda: self._between(start, end)))

    def _between(self, start: float, end: float) -> Array:
        fixed = self.fixed[bisect_right(self.fixed, start) : bisect_left(self.fixed, end)]
        if not (fixed or self.at_samples or self.drive):
            return np.array([end])
        samples = self._samples(start, end) if self.at_samples else range(0)
        asked = instants(self.drive, start, end)
        if not self.run.controlled:  # as they are on the grid, or a step of one rounding would lie between
            asked = np.round(asked / self.run.fixed_step) * self.run.fixed_step
        if not fixed and not samples and not len(asked):
            return np.array([end])
        times = self._times(np.arange(samples.start, samples.stop))
        if self.run.controlled and not samples and not (fixed and len(asked)):  # of one kind, and in order
            times = np.array(fixed) if fixed else asked
        elif fixed or len(asked):
            times = np.unique(np.concatenate([fixed, times, asked]))
        shortest = SHORTEST * self.run.duration + 2 * np.spacing(end)
        times = times[(times > start + shortest) & (times < end - shortest)]
        return np.concatenate([times, [end]])

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
