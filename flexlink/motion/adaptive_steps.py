"""Adaptive and implicit steps (`kernels/stepping/adaptive.py`) in chunks, after which Python checks the samples."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from flexlink.describe.run_settings import AUTO
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.kernels.stepping.step_state import COUNT, REFUSAL, STEPPER
from flexlink.motion.budget import FEWEST, Budget, ChunkSize, Reached, Spent, warn
from flexlink.motion.hindrance import loop_is_unstable, slow_progress, stuck
from flexlink.motion.method_choice import fastest_motion, guessed_costs, price_of_a_step, tumbles
from flexlink.motion.method_steps import NEVER, MethodSteps
from flexlink.motion.tolerable import Thresholds
from flexlink.results.record import Record
from flexlink.results.stop_reasons import EvaluationLimitError, Failure, LawFailure

if TYPE_CHECKING:
    from flexlink.motion.sampled_control import Control


NEAR = 1e-9  # fraction of the sampling interval within which two times count as equal


class AdaptiveSteps(MethodSteps):
    """Adaptive or implicit stepper; `failure`: why a run ended early, `passes` lets steps go beyond samples."""

    def __init__(
        self, record: Record, control: Control | None = None, *, halved: bool = False, passes: bool = True
    ) -> None:
        self.control = control
        super().__init__(record, control is None, halved, passes)

    def _prepare(self) -> None:
        self.ends, self.budget = ends(self.record, self.control), Budget(self.run.max_evaluations, self.run.duration)
        self.failure: Failure | None = None
        self.slow = 0, ""  # index of the next sample when slow progress was found, and the warning about it
        super()._prepare()
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
        """Integrate from `start` to `end` [s]; if they are equal, only compile. Returns the failure, if any."""
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
            yield int(np.searchsorted(self.record.t, self.control.times[k] - NEAR * self.run.spacing)), self._part
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
        q, last = self.state[0], 0 if self.run.controlled else int(self.count[COUNT.steps]) + most
        how = self.take(most)
        while how == OUTCOME.turned or (how == OUTCOME.stuck and not self.run.controlled):
            least = int(how == OUTCOME.turned)
            if how == OUTCOME.turned:
                self.turn()
            elif not self.step_in_parts():
                break
            if self.count[COUNT.knot] == len(self.knots[0]):
                how = OUTCOME.ended
            elif self.record.is_far(q):  # change coordinates, as after an undivided step
                how = OUTCOME.turned
            else:
                how = self.take(max(least, last - int(self.count[COUNT.steps])))
        if how == OUTCOME.ended and self.record.is_far(q):
            self.turn()
        if how == OUTCOME.stuck and self.run.method == AUTO and np.isfinite(max(fastest_motion(self.record, q))):
            self.rates = {**self.rates, self.name: np.inf}
            able = ("Radau5", "DOP853") if not self.record.tied else ("Radau5",)
            if others := [name for name in able if self.rates.get(name, 0.0) < np.inf]:
                self.go_on_with(others[0])
                how, self.rated_since, self.tried_for = int(OUTCOME.goes_on), None, None
        if how == OUTCOME.stuck:
            # shortest step tried; a fixed step is divided into at most 64 parts
            h = self.work.stepper[STEPPER.step] if self.run.controlled else self.run.fixed_step / 64
            unsolved = self.work.stepper[STEPPER.refusal] == REFUSAL.iteration
            worst = int(self.work.stepper[STEPPER.worst_joint]) if unsolved else None
            self.failure = stuck(self.record, q, self.time, h, unsolved=worst, explicit=self.method.explicit)
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


# Choice of the method that continues a run: the one expected to complete it at the lowest cost.
#
# At the start of a run it is unknown how violently the arm will move, and so what a method will cost. The present
# method's cost per second of motion follows from the listed costs of its operations. For a method used earlier, the
# cost of its last steps counts; it is reduced in proportion if the motion has since become easier for the present
# method. The cost of an untried method is estimated (`method_choice`). A method that is expected to complete the run
# for clearly less is tried for some steps. These are part of the run, so nothing is computed twice. Trials do not begin
# at once, since steps after a start or a jump are short. A run switches only after it has cost a fraction of the
# expected remaining cost, so a failed trial wastes no more than that fraction. Measured costs may be outdated and
# estimates wrong. A long run therefore tries other methods again, for a fraction of the cost of the run. The listed
# costs are the same on every machine, so runs repeat bit for bit.


def begin(steps: MethodSteps) -> None:
    """Set up the costs of methods before the first step."""
    steps.rated_since, steps.rates, steps.tried, steps.tried_for, steps.guesses = (steps.time, 0.0), {}, {}, None, {}
    record, run = steps.record, steps.run
    if run.method != AUTO or run.duration == 0.0 or tumbles(record):
        steps.consider_at = NEVER
        return
    costs = guessed_costs(record, run.tolerance_within(record.chain.size))
    steps.guesses = {name: cost / run.duration for name, cost in costs.items()}
    steps.consider_at = few(steps)


def consider(steps: MethodSteps) -> None:
    """Compute the cost since the last call, and switch to another method if it likely completes the run for less."""
    time, cost, since = steps.time, steps.cost, steps.rated_since
    if since is None or time <= since[0]:  # the method has just begun, or made no progress
        steps.rated_since, steps.consider_at = (time, cost), steps.tries + few(steps)
        return
    rate, overall = (cost - since[1]) / (time - since[0]), cost / (time - steps.taken)
    steps.rated_since, steps.consider_at = (time, cost), 2 * steps.tries
    steps.rates = updated(steps, rate)
    if steps.tried_for and not stays(steps, rate, steps.rates[steps.tried_for[0]]):
        go_on_with(steps, *steps.tried_for)
    else:
        steps.tried_for = None
        consider_others(steps, min(rate, overall))


def consider_others(steps: MethodSteps, rate: float) -> None:
    """Switch to the most promising method, or try one, if the present one costs `rate` per second of motion [s/s]."""
    if rate * rest_of(steps) < Thresholds.switch:
        return
    promises = {name: promised(steps, name) for name in steps.guesses if name != steps.name}
    name = min(promises, key=lambda other: promises[other])
    if is_cheaper(steps, name, promises[name], rate):
        trial = name not in steps.rates
    else:
        name, trial = next((other for other in promises if is_worth_a_trial(steps, other, rate)), ""), True
    if name:
        tried_for = (steps.name, steps.why) if trial else None
        go_on_with(steps, name)
        steps.tried_for = tried_for


def go_on_with(steps: MethodSteps, name: str, why: str = "") -> None:
    """Switch to another method, and note the cost of the run so far."""
    spent = steps.spent + steps.cost
    steps.tried = {**steps.tried, steps.name: spent, name: spent}
    steps.go_on_with(name, why)
    steps.rated_since, steps.tried_for, steps.consider_at = None, None, steps.tries + few(steps)


def rest_of(steps: MethodSteps) -> float:
    """Remaining time of a run [s]; for a simulator stepped beyond `run.duration`, the time so far."""
    start = float(steps.record.t[0])
    left = start + steps.run.duration - steps.time
    return left if left > 0.0 else steps.time - start


def stays(steps: MethodSteps, rate: float, before: float) -> bool:
    """Whether the run stays with a method on trial that costs `rate`, while the previous one cost `before` [s/s]."""
    if steps.name == "Radau9":
        return is_cheaper(steps, steps.name, rate, before)
    return rate < 0.5 * before or is_cheaper(steps, steps.name, rate, before, patience=1 / 3)


def few(steps: MethodSteps) -> int:
    """Number of attempted steps until a switch is considered next.

    At the start of a run these steps cost twice as much as a switch. Later they cost a fraction of the run so far: with
    more steps, the vibration left by the previous method matters less.
    """
    time = Thresholds.trial / 2 * steps.spent if steps.tried else 2 * Thresholds.switch
    return max(Thresholds.few, math.ceil(time / price_of_a_step(steps.record, steps.name)))


def is_cheaper(steps: MethodSteps, name: str, promise: float, rate: float, patience: float = 1.0) -> bool:
    """Whether a method with the cost `promise` [s/s] completes the run for clearly less than `rate` [s/s]."""
    known, rest = name in steps.rates, rest_of(steps)
    clearly, price = (0.9, Thresholds.switch) if known else (0.75, 4.0 * trial(steps, name))
    gains = promise < clearly * rate and (rate - promise) * rest > price
    return gains and steps.spent + steps.cost > patience * Thresholds.patience[name] * promise * rest


def is_worth_a_trial(steps: MethodSteps, name: str, rate: float) -> bool:
    """Whether a method may cost less, and the run has cost enough since its last trial to try it again."""
    if steps.rates.get(name, 0.0) == math.inf:
        return False
    last, price, since = steps.tried.get(name, 0.0), trial(steps, name), steps.spent + steps.cost
    # a lower bound of the cost; for DOP853 it follows from stability; other estimates are rarely 3 times too high
    least = steps.guesses[name] / (1.0 if name == "DOP853" else 3.0)
    often, gain = max(last, 10.0 * price), (rate - least) * rest_of(steps)  # trials cost up to a tenth of the run
    return since - last > often and gain > 4.0 * price


def trial(steps: MethodSteps, name: str) -> float:
    """Minimum cost of trying a method [s]."""
    return Thresholds.switch + 2 * Thresholds.few * price_of_a_step(steps.record, name)


def updated(steps: MethodSteps, rate: float) -> dict[str, float]:
    """Updated cost of each method per second of motion [s/s]; all fall in proportion if the present one falls."""
    before = steps.rates.get(steps.name, math.inf)
    easier = min(1.0, rate / before) if before < math.inf else 1.0
    return {**{name: easier * cost for name, cost in steps.rates.items()}, steps.name: rate}


def promised(steps: MethodSteps, name: str) -> float:
    """Expected cost of a method per second of motion [s/s]."""
    guess = steps.guesses[name]
    if name in steps.rates:
        return max(steps.rates[name], guess) if name == "DOP853" else steps.rates[name]
    if name == "Radau9" and "Radau5" in steps.rates:
        return steps.rates["Radau5"] * guess / steps.guesses["Radau5"]
    return guess
