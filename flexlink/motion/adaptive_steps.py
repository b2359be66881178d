"""Adaptive steps, and implicit ones, in chunks between which Python checks the samples."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.common.memo import Kept
from flexlink.common.types import Array
from flexlink.data.documents import is_user_file
from flexlink.describe.own_units import in_words
from flexlink.describe.run_settings import AUTO, DEFAULT_TOLERANCE, RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.dynamics.vibration.extremes import slowest_frequency
from flexlink.dynamics.vibration.stability import bounding_eigenvalues, stable_step, stable_step_of
from flexlink.kernels.inputs.record import Inputs
from flexlink.kernels.stepping import adaptive
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.kernels.stepping.embedded import EmbeddedWork
from flexlink.kernels.stepping.implicit_layout import ImplicitWork
from flexlink.kernels.stepping.saturation import choose_branches
from flexlink.kernels.stepping.step_state import COUNT, REFUSAL, SO_FAR, STEPPER
from flexlink.kernels.tools.machine_code import direct
from flexlink.motion.budget import FEWEST, Budget, Spent, warn
from flexlink.motion.chunk_size import ChunkSize, Reached
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.floating_steps import is_far
from flexlink.motion.hindrance import hindrance, loop_is_unstable
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.inputs.drives import remembered
from flexlink.motion.method_choice import cheapest, fastest_motion, tumbles
from flexlink.motion.method_trial import go_on_with_the_cheapest
from flexlink.motion.sampled_control import Control
from flexlink.motion.step_workspace import FEW_PASSES, carried, drive_gains, stages_of, workspace
from flexlink.motion.stop_times import SHORTEST, StopTimes
from flexlink.motion.tolerable import Thresholds
from flexlink.results.record import Record
from flexlink.results.samples import Steps
from flexlink.results.stop_reasons import EvaluationLimitError, Failure, LawFailure

NEVER = 2**62
"""Steps that do not end anything."""

NEAR = 1e-9
"""Part of the time between samples within which two times are one."""


class AdaptiveSteps:
    """Stepper of a run, which may have its longest steps `halved`; `failure` says why it ended early."""

    def __init__(self, record: Record, control: Control | None = None, halved: bool = False) -> None:
        self.halved = halved
        self.taken_over = False  # whether a method goes on for one that failed
        run = record.run
        self.failure: Failure | None = None
        self.record, self.run, self.control = record, run, control
        self.given, self.inputs = record.inputs, with_own_limits(record.inputs)
        self.budget = Budget(run.max_evaluations, run.duration)
        start, self.ends = pieces(record, control)
        about = record.q[0].tobytes(), record.qd[0].tobytes()
        posture = record.q[0] if run.controlled else np.zeros(record.chain.n)
        self.slowest = record.kept("slowest", about, lambda: slowest_frequency(record.chain, posture))
        n, self.memory = record.chain.n, np.zeros(3 * record.chain.n + 2)
        self.state = self.memory[:n], self.memory[n : 2 * n], self.memory[2 * n : -2], self.memory[-2:]
        self.slow = 0, ""  # row of the next sample when it was found, and what is to be told while the run goes on
        # tries of steps before methods are first compared; the next time is after twice as many, and so on
        self.compare_at = NEVER if run.method == AUTO and tumbles(record) else 100
        record.begin()
        self.state[0][:], self.state[1][:] = record.q[0], record.qd[0]
        self.tau = np.zeros(record.chain.n)
        self.count = np.zeros(COUNT.size, np.int64)
        self.methods: tuple[tuple[int, str, str], ...] = ()  # with the row of its first sample and why it was picked
        self.count[COUNT.row] = 1
        self.samples, self.forward = (record.t, record.q, record.qd, record.works, record.so_far), record.scratch
        self._take(record.kept("choice", about, lambda: choose(run, record, self.slowest)), start)
        self.aim(start, start)
        if run.controlled:
            arguments = self.work, self.state, self.settings, run.duration, self.tau
            types = self._types(record.kept)
            find = functools.partial(direct, adaptive.first_step, *arguments, types=types)
            record.kept("first step", (types, self.method), find)(*arguments)
            self.work.stepper[STEPPER.deflection] = min(self.work.stepper[STEPPER.deflection], record.chain.size)
        else:
            self.work.stepper[STEPPER.step] = run.fixed_step

    def __iter__(self) -> Iterator[Reached]:
        yield 1, 0.0 if self.ends else 1.0
        self.budget.begin(self._spent(), float(self.record.t[-1]))
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
            yield from self._ask(k)
            if pace.over or k == len(self.ends):
                yield self.row, self._part
                pace.start()

    def go(self, inputs: Inputs, start: float, end: float) -> Failure | None:
        """Go on from `start` to `end` [s] under these inputs; returns why not, if not. If they are one, it compiles."""
        if inputs is not self.given:
            self.given, self.inputs = inputs, with_own_limits(inputs)
            self._put_gains()
            self._compile()
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

    def saved(self, row: int | None = None) -> Any:
        """All that steps change, for `restore`; from a row on, samples and what the drive holds, too."""
        rows = None if row is None else slice(row, self.row)
        base = self.record.base.saved() if self.record.base is not None else None
        return vars(self).copy(), rows, [array.copy() for array in self._changing(rows)], base

    def restore(self, saved: Any) -> None:
        """Go back to where `saved` was."""
        attributes, rows, arrays, base = saved
        vars(self).update(attributes)
        if self.record.base is not None:
            self.record.base.restore(base, self.forward, self.work)
        for array, before in zip(self._changing(rows), arrays, strict=True):
            array[...] = before
        self._put_gains()

    def _changing(self, rows: slice | None) -> tuple[NDArray[Any], ...]:
        changing = self.memory, self.count, self.work.stepper, *stages_of(self.work)
        if rows is None:
            return changing
        return *changing, *remembered(self.inputs.drive), *(array[rows] for array in self.samples)

    def _put_gains(self) -> None:
        kp, kd, kick = drive_gains(self.record.chain, self.inputs)
        self.work.springs.impulse[:] = kick
        for gains in (self.work.springs, self.work.saturation):
            gains.kp[:], gains.kd[:] = kp, kd
        self._choose_branches()

    def _choose_branches(self) -> None:
        """Where motors saturate, steps with a tolerance follow one branch of their torques each."""
        if self.run.controlled and may_saturate(self.inputs):
            choose_branches(self.time, self.inputs, self.state, self.work)

    def aim(self, start: float, end: float) -> None:
        """Begin a piece between two times [s], at which torques may jump."""
        self.end, self.knots = end, self.stop_times.between(start, end)
        self.count[COUNT.knot], self.work.stepper[STEPPER.time] = 0, start
        self._choose_branches()
        self._begin(start, self.inputs, self.state, self.tau, self.forward)

    def _ask(self, k: int) -> Iterator[Reached]:
        """Let a law say what it holds from instant `k` on, if that is one; where it fails, say what came before."""
        if self.control is None or k == len(self.control.times):
            return
        try:
            self.control.note(k, *self.state[:2])
        except (LawFailure, KeyboardInterrupt):
            before = self.control.times[k] - NEAR * self.run.spacing
            yield int(np.searchsorted(self.record.t, before)), self._part
            raise

    @property
    def _part(self) -> float:
        """Of the run's time."""
        return (self.time - float(self.record.t[0])) / self.run.duration

    @property
    def steps(self) -> Steps:
        """Counts of the steps so far."""
        count = self.count.tolist()
        taken, rejected, failed = count[COUNT.steps], count[COUNT.rejected], count[COUNT.failed]
        return Steps(self.name, taken, self.evaluations, rejected, failed, self.why)

    def steps_before(self, row: int) -> Steps:
        """Counts of the steps up to the one that passed a sample."""
        *_, (_, name, why) = (found for found in self.methods if found[0] <= row)
        note = self.record.so_far[row].astype(int).tolist()
        evaluations = note[SO_FAR.before] + note[SO_FAR.iterations] * method(name).stages
        return Steps(name, note[SO_FAR.steps], evaluations, note[SO_FAR.rejected], note[SO_FAR.failed], why)

    @property
    def evaluations(self) -> int:
        """Evaluations so far."""
        return self.evaluations_before + int(self.count[COUNT.iterations]) * self.method.stages

    @property
    def evaluations_before(self) -> int:
        """Those by other methods, and in trials."""
        return int(self.count[COUNT.before])

    @evaluations_before.setter
    def evaluations_before(self, number: int) -> None:
        self.count[COUNT.before] = number

    @property
    def time(self) -> float:
        """Where the run is [s]."""
        return float(self.work.stepper[STEPPER.time])

    @property
    def row(self) -> int:
        """Row of the next sample."""
        return int(self.count[COUNT.row])

    @property
    def tries(self) -> int:
        """Steps that were tried so far."""
        count = self.count.tolist()
        return int(count[COUNT.steps] + count[COUNT.rejected] + count[COUNT.failed])

    def _take(self, choice: tuple[str, str], now: float) -> None:
        """Prepare steps by a method, chosen for a reason, from a time on; compiles, while no signal is deferred."""
        record, (self.name, self.why) = self.record, choice
        first = self.row if self.methods else 0
        self.methods = *(other for other in self.methods if other[0] < first), (first, *choice)
        self.method = method(self.name)
        self.dearest = self.method.stages * (1 if self.method.explicit else FEW_PASSES) if self.run.controlled else 0
        self.budget.safe = 0.0
        self.work = self._scratch()
        key = choice, now, *(part.tobytes() for part in self.state[:2]), float(record.t[0])
        self.stop_times, self.settings = record.kept(("stops", self.name), key, lambda: self._stops(now))
        self.end, self.knots = now, np.array([now])
        self._compile()

    def _stops(self, now: float) -> tuple[StopTimes, tuple[float, ...]]:
        """Where and how the steps of the method stop, taken from a time on."""
        record = self.record
        longest = np.inf
        if self.method.explicit and now > record.t[0]:
            longest = stable_step_of(bounding_eigenvalues(*fastest_motion(record, self.state[0])), self.name)
        elif self.method.explicit:
            longest = longest_step(self.name, record, now, self.state)
        stops = StopTimes(self.method, record, self.control is None, self.halved)
        return stops, settings(self.run, self.method, record, longest / 2 if self.halved else longest)

    def _scratch(self) -> EmbeddedWork | ImplicitWork:
        """The scratch of the method, new or as new."""
        kept, key, name = self.record.kept, (self.method, self.run.controlled), self.name
        work: EmbeddedWork | ImplicitWork
        work = kept(("scratch", name), key, lambda: workspace(self.method, self.record, self.slowest))
        new = kept(("new scratch", name), key, lambda: [array.copy() for array in carried(work)])
        for array, value in zip(carried(work), new, strict=True):
            array[:] = value
        work.stepper[STEPPER.inverse_ω1] = 1.0 / self.slowest
        if self.record.base is not None:
            self.record.base.take(self.record.base.attitude, self.forward, work)
        return work

    def _advance(self, most: int) -> int:
        """Take up to so many steps, to the end of the piece; goes on with another method where that is cheaper."""
        due = most > 0 and self.run.method == AUTO and self.tries >= self.compare_at
        if self.run.method == AUTO and not due:
            most = min(most, self.compare_at - self.tries)
        last = 0 if self.run.controlled else int(self.count[COUNT.steps]) + most
        how = self._compare() if due else self.take(most)
        while how == OUTCOME.turned or (how == OUTCOME.stuck and not self.run.controlled):
            least = int(how == OUTCOME.turned)
            if how == OUTCOME.turned:
                self._turn()
            elif not self._step_in_parts():
                break
            if self.count[COUNT.knot] == len(self.knots):
                how = OUTCOME.ended
            elif is_far(self.record, self.state[0]):  # as after a step that was taken whole
                how = OUTCOME.turned
            else:
                how = self.take(max(least, last - int(self.count[COUNT.steps])))
        if how == OUTCOME.ended and is_far(self.record, self.state[0]):
            self._turn()
        if how == OUTCOME.stuck and self.run.method == AUTO and not self.taken_over and np.isfinite(self.fastest):
            self.go_on_with("Radau5" if self.method.explicit else "DOP853", self.end)
            how, self.taken_over = int(OUTCOME.goes_on), True
        if how == OUTCOME.stuck:
            self.failure = self._stuck()
        return how

    def _compare(self) -> int:
        """Take some steps by each method that may be cheaper; an OUTCOME."""
        self.compare_at = 2 * self.tries
        return go_on_with_the_cheapest(self)

    def take(self, most: int) -> int:
        """Try up to so many steps; an OUTCOME."""
        return int(self._take_steps(*self._arguments(most)))

    def _turn(self) -> None:
        """Go on in coordinates in which the angles of a free base are zero."""
        if self.record.base is not None:
            self.record.base.turn(self.row, *self.state[:2], self.forward, self.work)
        adaptive.forget(self.work.stepper)
        self._begin(self.time, self.inputs, self.state, self.tau, self.forward)

    def _step_in_parts(self) -> bool:
        """Go to the end of a fixed step in 2, 4, … 64 parts, each try from where the last one got to; whether one does.

        The end is that of the whole step to the bit, and what follows starts as after a knot.
        """
        (*fixed, _, _), knots, now, count = self.settings, self.knots, self.work.stepper, self.count
        step, k, start = self.run.fixed_step, int(count[COUNT.knot]), float(now[STEPPER.time])
        at_knot = start + adaptive.NEARLY * step >= knots[k]
        end = float(knots[k]) if at_knot else start + step
        try:
            # in half a step Newton's iteration converges 4 times as fast
            solved = any(self._solved_in((end - start) / parts, end, fixed) for parts in (2, 4, 8, 16, 32, 64))
        finally:
            self.settings, self.knots, count[COUNT.knot] = (*fixed, step, step), knots, k
        if not solved:
            return False
        self._restart(step)
        if at_knot:
            count[COUNT.knot] += 1
        if count[COUNT.knot] < len(knots):
            self._begin(end, self.inputs, self.state, self.tau, self.forward)
        return True

    def _solved_in(self, part: float, end: float, fixed: list[float]) -> bool:
        """Whether steps of a length [s] get to a time."""
        self.settings, self.knots, self.count[COUNT.knot] = (*fixed, part, part), np.array([end]), 0
        self._restart(part)
        while (how := self.take(NEVER)) == OUTCOME.turned:
            self._turn()
        return how == OUTCOME.ended

    def _restart(self, step: float) -> None:
        """Go on with steps of a length [s], as if none had been taken."""
        adaptive.forget(self.work.stepper)
        self.work.stepper[STEPPER.step] = step

    def _affordable(self, most: int) -> int:
        """As many of so many steps as the budget allows; 0, and the run has failed: none."""
        if self.dearest and self.evaluations + most * self.dearest > self.budget.safe:
            most = min(most, self.budget.affordable(self._spent(), self.dearest))
            if self.budget.slow and not self.slow[1]:
                self.slow = self.row, "; ".join(self._hanging(self.budget.slow))
            if most and self.budget.slow and loop_is_unstable(self.record):  # it only grows: no need to spend the rest
                most, self.budget.over = 0, self.budget.slow
            if not most:
                self.failure = Failure(*self._hanging(self.budget.over), EvaluationLimitError)
        return most

    def _spent(self) -> Spent:
        return Spent(self.time, int(self.count[COUNT.steps]), self.evaluations)

    def _hanging(self, how: str) -> tuple[str, str]:
        """Where and how the run hangs, and what may help."""
        text = f"t = {self.time:.6g} s: {how}"
        if known := hindrance(self.record, self.state[0]):
            cause, advice = known
            return f"{text}; {cause}", advice
        q, _, qdd, _ = self.state
        k, own = int(np.argmax(np.abs(qdd))), "" if self.run.method == AUTO else "method = 'auto', "
        chain = self.record.chain
        at = in_words(bool(chain.slides[k]), float(q[k]), ".3g" if chain.slides[k] else ".1f")
        worst = f"joint {chain.joint_name(k)!r} at {at} is accelerated most"
        return f"{text}; {worst}", f"try {own}a larger tolerance or fixed steps, or raise max_evaluations"

    @property
    def deflection(self) -> float:
        """The largest so far [m]."""
        return float(self.work.stepper[STEPPER.deflection])

    @property
    def angle_travelled(self) -> float:
        """Angle [rad] that all free joints went through so far, forth and back."""
        return float(self.work.stepper[STEPPER.angle_travelled])

    def _compile(self) -> None:
        kept = self.record.kept if self.given is self.record.inputs else Kept()  # whose code is for the record's types
        start, steps = (0.0, self.inputs, self.state, self.tau, self.forward), self._arguments(0)
        types = self._types(kept)
        self._begin = kept("begin", None, lambda: direct(adaptive.begin, *start, types=kept.types))
        self._take_steps = kept(
            ("steps", self.name), (types, self.method), lambda: direct(adaptive.advance, *steps, types=types)
        )

    def _types(self, kept: Kept) -> bytes:
        """Types of all that steps work on, which a method's own file may change."""
        return b"" if is_user_file(self.name) or not kept.types else kept.types + self.name.encode()

    def _arguments(self, most: int) -> tuple[Any, ...]:
        of_the_method = self.work, self.forward, self.inputs, self.settings
        return *of_the_method, self.count, self.state, self.tau, self.knots, self.samples, most

    def go_on_with(self, name: str, end: float) -> None:
        """Go on with another method, from where it is to a time [s]."""
        before, time, self.evaluations_before = self.work.stepper.copy(), self.time, self.evaluations
        self.count[COUNT.iterations] = 0
        self._take((name, f"{self.why}; {self.name} until t = {time:.3g} s"), time)
        self._put_gains()  # of the inputs that act now: a simulator's are not always the record's
        self.aim(time, end)
        now, carried = self.work.stepper, [STEPPER.deflection, STEPPER.angle_travelled]
        now[carried], now[STEPPER.step] = before[carried], min(before[STEPPER.step], self.settings[-1])

    def cost(self, name: str, evaluations: float) -> float:
        """CPU time of evaluations by a method [s], as it is listed."""
        return run_cost(self.record.chain, name, evaluations)

    @property
    def fastest(self) -> float:
        """The fastest frequency, or decay, at this posture [rad/s]."""
        return max(fastest_motion(self.record, self.state[0]))

    def _stuck(self) -> Failure:
        now, h = self.time, self.work.stepper[STEPPER.step]
        if not self.run.controlled:
            h = self.run.fixed_step / 64  # the smallest part that is tried
        text = f"no step down to {h:.3g} s meets the tolerance at t = {now:.6g} s"
        if self.work.stepper[STEPPER.refusal] == REFUSAL.iteration:
            joint = self.record.chain.joint_name(int(self.work.stepper[STEPPER.worst_joint]))
            unsolved = f"Newton's iteration does not converge (joint {joint!r})"
            text = f"no step down to {h:.3g} s works at t = {now:.6g} s: {unsolved}"
        if known := hindrance(self.record, self.state[0]):
            cause, advice = known
            return Failure(f"{text}; {cause}", advice)
        if not self.run.controlled and self.record.chain.hinges["coulomb"].any():
            allowed = DEFAULT_TOLERANCE * self.record.chain.size
            cause = f"{text}; dry friction turns round within it"
            return Failure(cause, f"take run.tolerance, such as {allowed:.1g} m, in place of run.step")
        fixed = f"try a tolerance, which steps follow, or a smaller step than {self.run.fixed_step:g} s"
        return Failure(text, "" if self.run.controlled else fixed)


def may_saturate(inputs: Inputs) -> bool:
    """Whether a motor has a largest torque that it may reach within a step, as `saturation.saturates` of kernels."""
    return not inputs.drive.rate and min(inputs.drive.effort.tolist(), default=np.inf) < np.inf


def with_own_limits(inputs: Inputs) -> Inputs:
    """The inputs with limits of the torques that steps may write to, where they do."""
    if not may_saturate(inputs):
        return inputs
    return inputs._replace(drive=inputs.drive._replace(limits=inputs.drive.limits.copy()))


def pieces(record: Record, control: Control | None) -> tuple[float, list[float]]:
    """Start of a run and the ends of its pieces [s]: sampling instants of a control law, and the end of the run."""
    run = record.run
    start, end = float(record.t[0]), float(record.t[-1])
    if not run.controlled:  # on the grid of all steps, to the bit
        start, end = (run.fixed_step * (record.origin + k * run.steps_per_sample) for k in (0, len(record.t) - 1))
    between = [] if control is None else control.times[1:].tolist()
    return start, [*(t for t in between if t < end - NEAR * run.spacing), *([end] if end > start else [])]


def choose(run: RunSettings, record: Record, slowest: float) -> tuple[str, str]:
    """The method of a run, and the reason where it was chosen automatically."""
    if run.method != AUTO:
        return run.method, ""
    return cheapest(record, run.tolerance_within(record.chain.size), slowest)


def longest_step(name: str, record: Record, t: float, state: tuple[Array, ...]) -> float:
    """Of an explicit method its largest stable step about a state t, q, q̇ [s], beyond which its error only grows."""
    chain, (q, qd, *_) = record.chain, state
    return stable_step(chain, q, qd, method=name, **acting_at(record.inputs, chain, t, q, qd))


def settings(run: RunSettings, method: Method, record: Record, largest: float) -> tuple[float, ...]:
    """Settings of `advance`: error limits, order of the error estimate, shortest and longest step."""
    long_stages = 5  # implicit methods of so many stages take few, long steps
    exact = 1e-13  # residual of a fixed step over the arm's size; a larger one makes the energy drift
    if record.chain.has_free_base:
        exact = 1e-16  # one pass more: all steps leave momentum of one sign, and nothing takes it up
    of_the_iteration = 0.05  # residual of the Newton iteration over the error that a step may have
    of_a_deflection = 0.1  # stricter where the tolerance is on deflection: errors of all steps ring on in its vibration
    size = record.chain.size
    if not run.controlled:
        return np.inf, 0.0, run.fixed_step, exact * size, 0.0, 1.0, run.duration, run.fixed_step, run.fixed_step
    if run.accuracy == "deflection" and not (record.chain.hinges["stiffness"] > 0).any():
        raise SceneError(
            f"run.accuracy = 'deflection': no link of {record.chain.name!r} bends, so there is no deflection to take "
            "a fraction of; take accuracy = 'tip'"
        )
    least = record.least_tolerance
    absolute, part = least, run.relative_tolerance or 0.0  # of no deflection what rounding leaves
    if run.accuracy == "tip":
        absolute, part = run.tolerance_within(size), 0.0
        if absolute < least:
            raise SceneError(
                f"run.tolerance = {absolute:.3g} m: below the rounding error of an arm of {size:.3g} m at "
                f"angles up to {np.abs(record.q[0]).max():.2g} rad; allowed are {least:.2g} m and more"
            )
    order = float(method.order if method.explicit else method.stages + 1)
    long = method.stages >= long_stages
    # Error that one step may have, as a part of the tolerance, of which a run has `Thresholds.long` times as much for
    # all its steps. It is the error of a formula of lower order: that of the step itself is a few hundredths of it, or
    # less. Measured on 16 scenes with 7 tolerances: the errors at the end have a median of 0.14 of the tolerance, or
    # less, and are at most 6 times it where motion is sensitive. An explicit method's steps, small for stability's
    # sake, have the errors they tell, all in one direction.
    one = 0.02 if method.explicit else 0.1 if long else 0.25
    errors = one * absolute, of_a_deflection * one * part, run.duration / Thresholds.long, np.inf, of_the_iteration
    return *errors, order, run.duration, SHORTEST * run.duration, largest
