"""One run of a scene: preparation, integration to its end, verification by a second run."""

from __future__ import annotations

import contextlib
import dataclasses
import signal
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, cast

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import Diagnostic, FlexlinkError, SceneError
from flexlink.common.interruption import Stop
from flexlink.common.memo import Kept, keep_last
from flexlink.common.types import Array
from flexlink.describe.numbers import multiples
from flexlink.describe.run_settings import RunSettings, check_method
from flexlink.describe.spec import build_unchecked, build_validated
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.tools.machine_code import types_of
from flexlink.motion import verification
from flexlink.motion.inputs.drives import recall, remembered
from flexlink.motion.inputs.problem import problem_of, started, started_from
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import Thresholds, compared_with, estimated_error, extrapolated, shown_by, stated_of
from flexlink.results.record import Record, derived
from flexlink.results.samples import StatedError
from flexlink.results.stop_reasons import (
    ControlError,
    EvaluationLimitError,
    InterruptedRunError,
    LawFailure,
    ended_early,
)
from flexlink.results.trajectory import Trajectory

if TYPE_CHECKING:
    from flexlink.motion.adaptive_steps import AdaptiveSteps
    from flexlink.motion.fixed_steps import FixedSteps
    from flexlink.motion.sampled_control import Control

Report = Callable[[float], None] | None  # function that is called with the completed fraction of a run
Warn = Callable[[Diagnostic], None] | None  # function that is called with a warning during a run


class SingleRun:
    """A run that is ready to start, with its step checked, its samples allocated and its code compiled.

    `control` replaces the scene's drive; `before`: torques on their way when an earlier run ended, as in
    `Trajectory.delayed`; `motion`: what this run continues; `rows`: number of samples to allocate, by default all;
    `kept`: workspace and machine code of other runs of the problem; `warnings`: from the check of the step, if it has
    been checked; `halved`: the longest steps are halved, as in a verification run; `passes`: long steps of an explicit
    method may extend beyond samples. Errors are as in `simulate`.
    """

    def __init__(
        self, problem: InitialValueProblem, control: Control | None = None, before: Array | None = None, *,
        rows: int | None = None, kept: Kept | None = None, warnings: tuple[Diagnostic, ...] | None = None,
        halved: bool = False, passes: bool = True, motion: StatedError | None = None,
    ) -> None:  # fmt: skip
        check_method(problem.run)
        if control is not None:
            problem = dataclasses.replace(problem, inputs=problem.inputs._replace(drive=control.drive))
        elif before is not None:
            recall(problem.inputs.drive, before)
        kept = Kept() if kept is None else kept
        record = Record(problem, *_samples(problem, rows, kept), kept)
        _identify_types(record)
        self.monitor = Monitor(record, _step_warnings(record) if warnings is None else warnings, control)
        self.monitor.before = motion
        self._rows, self._before, self._warned = rows, before, False
        if control is not None:
            try:
                control.note(0, problem.q, problem.qd)
            except LawFailure as failure:
                raise ControlError(f"{problem.chain.name}: {failure}", self.monitor.trajectory()) from failure.__cause__
        self.monitor.compile()
        self.steps = _stepper(record, control, halved=halved, passes=passes)

    def start(self, problem: InitialValueProblem, before: Array | None, motion: StatedError | None) -> None:
        """Get ready to run again, from the initial state of a problem that otherwise equals that of the last run."""
        if before is not None:
            recall(problem.inputs.drive, before)
        record = self.monitor.record
        record.hold(problem, *_samples(problem, self._rows, record.kept))
        self.monitor.start(_step_warnings(record))
        self.monitor.before = motion
        self._before, self._warned = before, False
        self.steps.start(record)

    def finish(self, stop: Stop, progress: Report = None, *, compared: bool = True, warn: Warn = None) -> Trajectory:
        """Run to the end, or until stopped; if `compared`, verify it by another; `warn` names the cause if slow."""
        self.advance(stop, progress, warn)
        return self.result(stop, compared=compared)

    def result(self, stop: Stop, *, compared: bool = True) -> Trajectory:
        """The run after `advance`; if `compared`, it is verified as in `finish`."""
        monitor, steps = self.monitor, self.steps
        try:
            if compared and not (monitor.failure or steps.failure or stop.requested):
                if monitor.run.controlled:
                    monitor = settled(monitor, self._before, stop)
                else:
                    monitor.warnings += verify(monitor, stop)
        except KeyboardInterrupt:
            stop.signal = signal.SIGINT
        if monitor.failure or steps.failure:
            raise monitor.diverged(steps.failure)
        if stop.signal is not None:
            raise InterruptedRunError(monitor.trajectory(), stop.signal)
        return monitor.trajectory()

    def advance(self, stop: Stop, report: Report = None, warn: Warn = None) -> None:
        """Advance until the run ends, a check fails, or it is stopped."""
        monitor, steps, t = self.monitor, self.steps, self.monitor.record.t
        try:
            for rows, part in steps:
                if not self._sound(rows, part, warn):
                    return
                if report is not None:
                    report(part)
                if stop.requested:
                    return
            steps.failure = ended_early(float(t[max(0, monitor.n_valid - 1)]), float(t[-1]))
        except LawFailure as failure:
            raise ControlError(f"{monitor.record.chain.name}: {failure}", monitor.trajectory()) from failure.__cause__
        except KeyboardInterrupt:  # from a signal handler of the caller, or from `report`
            stop.signal = signal.SIGINT

    def _sound(self, rows: int, part: float, warn: Warn) -> bool:
        """Check the samples before index `rows`; return whether the run may go on."""
        monitor, steps = self.monitor, self.steps
        good = True
        if rows > 1 or part == 1.0 or steps.failure:  # one check is enough for a short run
            good = monitor.check(rows, steps.steps, methods=steps.methods, so_far=steps.so_far)
        row, slow = steps.slow
        # do not warn about steps after an invalid sample
        if warn and slow and not self._warned and row <= max(1, monitor.n_valid):
            warn(Diagnostic(f"{monitor.record.chain.name}: {slow}", "slow-progress"))
            self._warned = True
        if not good:
            monitor.steps = steps.steps_before(monitor.n_valid)
        return good and not steps.failure


def prepared_run(
    problem: InitialValueProblem, kept: Kept, before: Array | None = None, motion: StatedError | None = None,
    *, halved: bool = False, rows: int | None = None,
) -> SingleRun:  # fmt: skip
    """A run without a law in Python, ready to start: the last one of the same problem if `kept`, or a new one."""
    check_method(problem.run)
    for array in remembered(problem.inputs.drive):
        array[...] = 0
    new: list[SingleRun] = []

    def find() -> SingleRun:
        new.append(SingleRun(problem, before=before, kept=kept, motion=motion, halved=halved, rows=rows))
        return new[0]

    about = halved, problem.explicit, problem.run.unstable, id(problem.chain), id(problem.inputs)
    run: SingleRun = kept("run", about, find)
    if not new:
        run.start(problem, before, motion)
    return run


def _step_warnings(record: Record) -> tuple[Diagnostic, ...]:
    """Warnings from the check of a fixed explicit step; errors as in `check_step`."""
    problem = record.problem
    if not problem.explicit:
        return ()
    from flexlink.motion.inputs.step_check import check_step  # noqa: PLC0415  only fixed steps need eigenvalues

    about = problem.q.tobytes(), problem.qd.tobytes(), problem.start
    found: tuple[Diagnostic, ...] = record.kept("step", about, lambda: check_step(problem))
    return found


def _stepper(record: Record, control: Control | None, *, halved: bool, passes: bool) -> FixedSteps | AdaptiveSteps:
    """The stepper of a run: fixed steps of an explicit method, or adaptive or implicit steps; only one is imported."""
    if record.problem.explicit:
        from flexlink.motion.fixed_steps import FixedSteps  # noqa: PLC0415

        return FixedSteps(record, control)
    from flexlink.motion.adaptive_steps import AdaptiveSteps  # noqa: PLC0415

    return AdaptiveSteps(record, control, halved=halved, passes=passes)


def settled(first: Monitor, before: Array | None, stop: Stop) -> Monitor:
    """The run to return with its stated error: the first one, or a finer one if its error exceeds the tolerance.

    Where steps may hide errors, or motion amplifies them, the run is compared with others. `before`: as in `SingleRun`.
    """
    stated = first.stated = stated_of(first)
    if first.control is not None:  # a law in Python may have internal states, so its runs cannot be repeated
        if (error := float(stated.tip[-1])) > Thresholds.unrepeated * first.tolerance:
            grown = verification.multiplies(first) or error > Thresholds.tolerable * first.tolerance
            first.warnings.append((verification.exceeded if grown else verification.unrepeated)(first, error))
    elif verification.needs_comparison(first):
        if (coarser := verification.coarser_run(first)) and (other := _other(first, coarser, before, stop, 0)):
            found = shown_by(other, first)
            if found.tip.max() <= first.tolerance:
                return _confirmed(first, first, found)
        return _compared(first, before, stop)
    return first


def _compared(first: Monitor, before: Array | None, stop: Stop) -> Monitor:
    """The run to return after comparison with runs by a method of another order.

    If two are farther apart than the tolerance, or the errors of the steps of the other run are large, finer runs
    follow until one confirms the first or the previous run. The run with which a continued run is compared begins where
    that of the earlier run ended, or at the start of the motion, so that it shows the error handed on.
    """
    record, motion, stated = first.record, first.before, first.stated or stated_of(first)
    part = min(verification.PART, float(first.tolerance / stated.tip[-1]) ** 0.5)
    size, least = record.chain.size, record.least_tolerance
    finer = verification.runs_of_other_order(first.run, first.steps.method, size, least, part)
    gap = wider = None  # of the last run but one, from the last; of the run before it
    runs, distance = [first], None  # distance of the last two runs, in tolerances
    with contextlib.suppress(StopIteration):
        while not verification.too_dear(runs, run := finer.send(distance)):
            if (other := _other(first, run, before, stop, len(runs), motion)) is None:
                break
            sound = estimated_error(other)[-1] <= first.tolerance
            for own in dict.fromkeys((first, runs[-1])):
                found = compared_with(other, own, first)
                distance = float(found.tip.max()) / first.tolerance
                if sound and distance <= 1.0:
                    return _confirmed(own, first, found)
            wider, gap = gap, found
            runs.append(other)
            if motion is not None:
                break
    if gap is not None and not stop.requested:
        if motion is None:
            lasts = gap.tip.max() > Thresholds.grown * first.extent  # as of chaos: no smaller tolerance reduces it
            if wider is not None:
                shrinks = min(0.5, 3.0 * runs[-2].tolerance / runs[-3].tolerance)
                lasts = lasts or gap.tip.max() > shrinks * wider.tip.max()
            return _confirmed(runs[-1], first, gap if lasts else extrapolated(gap, runs[-1], runs[-2]))
        again = next(finer, None)
        return _nearer(first, gap, _other(first, again, before, stop, len(runs)) if again else None, runs[-1])
    if not stop.requested:
        first.warnings.append(verification.unknown(first))
    return first


def _nearer(first: Monitor, found: StatedError, finer: Monitor | None, other: Monitor) -> Monitor:
    """A continued run, `found` at its distance to the other run, or a finer one if that is nearer to the other run."""
    if finer is not None and (nearer := compared_with(other, finer, first)).tip.max() < found.tip.max():
        return _confirmed(finer, first, nearer)
    return _confirmed(first, first, found)


def _confirmed(run: Monitor, first: Monitor, found: StatedError) -> Monitor:
    """This run as the result instead of the `first` one, with its stated error."""
    error, run.stated = float(found.tip.max()), found
    first.confirmed = run.confirmed = True
    if run is not first:
        run.scene, run.warnings = first.scene, [*dict.fromkeys([*first.warnings, *run.warnings])]
        run.steps = run.steps._replace(why=f"{first.steps.method} missed the tolerance")
    if verification.is_exceeded(first, error):
        run.warnings.append(verification.exceeded(first, error))
    return run


def _other(
    first: Monitor, run: RunSettings, before: Array | None, stop: Stop, k: int, motion: StatedError | None = None
) -> Monitor | None:
    """The k-th run of the first run's motion, with other settings; it continues `motion`, if any. None: it fails."""
    record, problem, start, longer = first.record, first.record.problem, None, 0.0
    if motion is not None:
        start, before = (motion.start, None) if motion.end is None else (motion.end, motion.delayed)
        longer = float(record.t[0]) - start[0]

    def prepared() -> InitialValueProblem:
        if problem.base is not None:
            return problem_of(problem.scene, problem.original, tied=True)
        drive = problem.inputs.drive  # a sampled drive writes to its memory
        drive = drive._replace(held=drive.held.copy(), next_instant=drive.next_instant.copy())
        return dataclasses.replace(problem, inputs=problem.inputs._replace(drive=drive))

    most = verification.evaluations_within(first) * (1.0 + longer / run.duration)
    halved = k > 0 and run.method == first.steps.method
    try:
        settings = build_validated(replace, run, duration=run.duration + longer) if longer else run
        scene = build_unchecked(replace, problem.scene, run=settings)
        again: InitialValueProblem = record.kept(("comparison", k), longer, prepared)
        if start is None:
            again = dataclasses.replace(again, scene=scene, q=problem.q, qd=problem.qd)
        else:
            again = started(again, started_from(scene, start[1], start[2], start[0]))
        other = prepared_run(again, record.kept(("kept", k), longer, Kept), before, halved=halved)
        cast("AdaptiveSteps", other.steps).budget.most = min(run.max_evaluations, most)
        other.advance(stop)
    except FlexlinkError:
        return None
    return None if other.monitor.failure or other.steps.failure or stop.requested else other.monitor


def verify(monitor: Monitor, stop: Stop) -> Iterator[Diagnostic]:
    """Compare a finished run with fixed steps with verification runs; yield a warning if they contradict it."""
    text = Diagnostic("", "")
    own, problem = monitor.steps.evaluations, monitor.record.problem
    for second in verification.second_runs(monitor):
        text = text or verification.unknown(monitor)
        most = min(second.run.max_evaluations, verification.GIVEN_UP * own)
        limited = replace(second.run, max_evaluations=most) if second.run.controlled else second.run
        try:
            again = replace(problem.scene, run=limited)  # fails if the start is not a multiple of the new step
            other = SingleRun(problem_of(again, problem.original, tied=True), halved=limited.controlled, passes=False)
            other.advance(stop)
        except FlexlinkError:
            continue
        if stop.requested:
            return
        evaluations, wrong, failure = other.monitor.steps.evaluations, other.monitor.failure, other.steps.failure
        limited_out = failure is not None and failure.kind is EvaluationLimitError and not wrong
        if limited_out or evaluations > verification.GIVEN_UP * own:
            break
        # a step of 2 h taken in two parts equals two steps of the first run, so the runs would agree trivially
        in_parts = not second.run.controlled and other.steps.steps.failed > 0
        if not (wrong or failure or in_parts):
            text = verification.doubt(monitor, second, other.monitor.record.compared(other.monitor.n_valid))
            monitor.confirmed = not text
            if not text or second.strict or evaluations > own:
                break
    if text:
        yield text


def _samples(
    problem: InitialValueProblem, rows: int | None, kept: Kept
) -> tuple[Array, Array, Array, tuple[Array, ...]]:
    """Arrays for `rows` samples (None: all) of a run, as in `Record`; the first sample is set to the initial state."""
    run, chain = problem.run, problem.chain
    try:
        number = run.samples if rows is None else rows
        about = problem.start, run.between, number
        times = kept("times", about, lambda: multiples(*about)).copy()
        q, qd = np.empty((2, number, chain.n))
        others = derived(problem, number)
    except (MemoryError, ValueError):  # ValueError: more elements than numpy can count
        text = f"{run.label('sample', 'run.')} = {run.spacing!r}: {run.samples} samples of {chain.n} joints do not fit "
        raise SceneError(f"{text}into memory", id="out-of-memory") from None
    q[0], qd[0] = problem.q, problem.qd
    return times, q, qd, others


def _identify_types(record: Record) -> None:
    """Note the types of the arguments of kernels that runs of one owner share: all others are always the same."""
    if not record.kept.types:
        run, chain = record.run, record.chain
        solver = f"{run.solver} {chain.is_planar} {chain.shapes is not None} {record.tied}".encode()
        drive, *others = record.inputs
        record.kept.types = types_of(chain.arrays, *others) + _types_of_drive(drive) + solver


_types_of_drive: Callable[[Drive], bytes] = keep_last(64)(types_of)  # runs share drives
