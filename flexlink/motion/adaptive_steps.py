"""Adaptive and implicit steps, taken in chunks; between chunks Python checks the samples."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from flexlink.describe.run_settings import AUTO
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.kernels.stepping.step_state import COUNT, REFUSAL, STEPPER
from flexlink.motion.budget import FEWEST, Budget, Spent, warn
from flexlink.motion.chunk_size import ChunkSize, Reached
from flexlink.motion.hindrance import loop_is_unstable, slow_progress, stuck
from flexlink.motion.method_steps import MethodSteps
from flexlink.motion.method_trial import begin, consider
from flexlink.results.record import Record
from flexlink.results.stop_reasons import EvaluationLimitError, Failure, LawFailure

if TYPE_CHECKING:
    from flexlink.motion.sampled_control import Control

NEAR = 1e-9
"""Fraction of the sampling interval within which two times count as equal."""


class AdaptiveSteps(MethodSteps):
    """Adaptive or implicit stepper of a run; if the run ends early, `failure` gives the reason.

    `halved` halves the longest steps; `passes` allows a step to extend beyond a sample.
    """

    def __init__(
        self, record: Record, control: Control | None = None, *, halved: bool = False, passes: bool = True
    ) -> None:
        run = record.run
        self.control, self.ends = control, ends(record, control)
        self.failure: Failure | None = None
        self.budget = Budget(run.max_evaluations, run.duration)
        self.slow = 0, ""  # index of the next sample when slow progress was found, and the warning about it
        super().__init__(record, control is None, halved, passes)
        begin(self)

    def __iter__(self) -> Iterator[Reached]:
        yield 1, 0.0 if self.ends else 1.0
        self.budget.begin(self._spent(), float(self.record.t[-1]), self.dearest)
        pace, start = ChunkSize(self.record.chain.n), self.time
        for k, end in enumerate(self.ends, 1):
            self.aim(start, end)
            start, how = end, OUTCOME.goes_on
            while how == OUTCOME.goes_on:
                pace.size = self._affordable(pace.size)
                how = self._advance(pace.size) if pace.size else OUTCOME.stuck
                if how == OUTCOME.goes_on:
                    if pace.end():
                        yield self.row, self._part
                    pace.start()
            if how == OUTCOME.stuck:
                yield self.row, self._part
                return
            yield from self._call_law(k)
            if pace.over or k == len(self.ends):
                yield self.row, self._part
                pace.start()

    def go(self, inputs: Inputs, start: float, end: float) -> Failure | None:
        """Integrate from `start` to `end` [s] under these inputs, and return the failure, if any.

        If both times are equal, the steps are only compiled.
        """
        self.act(inputs)
        self.aim(start, end)
        self.budget.begin(self._spent(), end, self.dearest)
        self.slow = 0, ""
        if end == start:
            self._advance(0)
            return None
        warned = False
        while (most := self._affordable(FEWEST)) and self._advance(most) == OUTCOME.goes_on:
            if self.slow[1] and not warned:
                warn(f"{self.record.chain.name}: {self.slow[1]}")
                warned = True
        return self.failure

    def _call_law(self, k: int) -> Iterator[Reached]:
        """Call the control law, if any, at instant `k`; if it fails, first yield the samples before that instant."""
        if self.control is None or k == len(self.control.times):
            return
        try:
            self.control.note(k, *self.state[:2])
            self.reads(self.control.impulse)
        except (LawFailure, KeyboardInterrupt):
            before = self.control.times[k] - NEAR * self.run.spacing
            yield int(np.searchsorted(self.record.t, before)), self._part
            raise

    @property
    def _part(self) -> float:
        """Fraction of the run's duration that is completed."""
        return (self.time - float(self.record.t[0])) / self.run.duration

    def _take(self, choice: tuple[str, str], now: float) -> None:
        super()._take(choice, now)
        self.budget.safe = 0.0  # a step may need more evaluations now

    def _advance(self, most: int) -> int:
        """Take up to `most` steps, at most to the end of the piece; switch to another method if that one is cheaper."""
        if most > 0 and self.tries >= self.consider_at:
            consider(self)
        most = min(most, self.consider_at - self.tries)
        last = 0 if self.run.controlled else int(self.count[COUNT.steps]) + most
        how = self.take(most)
        while how == OUTCOME.turned or (how == OUTCOME.stuck and not self.run.controlled):
            least = int(how == OUTCOME.turned)
            if how == OUTCOME.turned:
                self.turn()
            elif not self.step_in_parts():
                break
            if self.count[COUNT.knot] == len(self.knots[0]):
                how = OUTCOME.ended
            elif self.record.is_far(self.state[0]):  # change coordinates, as after an undivided step
                how = OUTCOME.turned
            else:
                how = self.take(max(least, last - int(self.count[COUNT.steps])))
        if how == OUTCOME.ended and self.record.is_far(self.state[0]):
            self.turn()
        if how == OUTCOME.stuck and self.run.method == AUTO and np.isfinite(self.fastest):
            self.rates = {**self.rates, self.name: np.inf}
            others = [name for name in ("Radau5", "DOP853") if self.rates.get(name, 0.0) < np.inf]
            if others:
                self.go_on_with(others[0])
                how, self.rated_since, self.tried_for = int(OUTCOME.goes_on), None, None
        if how == OUTCOME.stuck:
            # shortest step tried; a fixed step is divided into at most 64 parts
            h = self.work.stepper[STEPPER.step] if self.run.controlled else self.run.fixed_step / 64
            unsolved = self.work.stepper[STEPPER.refusal] == REFUSAL.iteration
            worst = int(self.work.stepper[STEPPER.worst_joint]) if unsolved else None
            explicit = self.method.explicit
            self.failure = stuck(self.record, self.state[0], self.time, h, unsolved=worst, explicit=explicit)
        return how

    def _affordable(self, most: int) -> int:
        """Number of steps, up to `most`, that the budget allows; 0 means that the run has failed."""
        if self.dearest and self.evaluations + most * self.dearest > self.budget.safe:
            most = min(most, self.budget.affordable(self._spent(), self.dearest))
            if self.budget.slow and not self.slow[1]:
                self.slow = self.row, "; ".join(slow_progress(self.record, self.state, self.time, self.budget.slow))
            if most and self.budget.slow and loop_is_unstable(self.record):  # motion would only grow, so stop at once
                most, self.budget.over = 0, self.budget.slow
            if not most:
                where = slow_progress(self.record, self.state, self.time, self.budget.over)
                self.failure = Failure(*where, EvaluationLimitError)
        return most

    def _spent(self) -> Spent:
        return Spent(self.time, int(self.count[COUNT.steps]), self.evaluations)


def ends(record: Record, control: Control | None) -> list[float]:
    """End times of the pieces of a run [s]: sampling instants of the control law, and the end of the run."""
    run = record.run
    start, end = float(record.t[0]), float(record.t[-1])
    if not run.controlled:  # computed as in the steps, so that times agree bit for bit
        start, end = (run.fixed_step * (record.origin + k * run.steps_per_sample) for k in (0, len(record.t) - 1))
    between = [] if control is None else control.times[1:].tolist()
    return [*(t for t in between if t < end - NEAR * run.spacing), *([end] if end > start else [])]
