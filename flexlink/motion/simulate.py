"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in chunks between which Python checks the samples."""

from __future__ import annotations

import dataclasses
import math
import signal
from collections.abc import Callable, Iterator

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.errors import FlexlinkError, SceneError
from flexlink.common.interruption import Stop, deferred
from flexlink.common.memo import Kept, Memo, keep_last
from flexlink.data.documents import is_user_file
from flexlink.describe.run_settings import Accuracy, ForwardSolver, Unstable, check_method
from flexlink.describe.scene import Scene
from flexlink.describe.spec import build_validated
from flexlink.describe.whole_steps import multiples
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.machine_code import types_of
from flexlink.motion.adaptive_steps import AdaptiveSteps
from flexlink.motion.budget import warn
from flexlink.motion.fixed_steps import FixedSteps
from flexlink.motion.inputs.drives import remembered
from flexlink.motion.inputs.problem import problem_of, started
from flexlink.motion.inputs.step_check import judge_step
from flexlink.motion.monitor import RunMonitor
from flexlink.motion.sampled_control import Law, control_of
from flexlink.motion.verification import GIVEN_UP, UNKNOWN, advice, doubt, second_runs
from flexlink.results.record import Record
from flexlink.results.stop_reasons import (
    ControlError,
    EvaluationLimitError,
    InterruptedRunError,
    LawFailure,
    ended_early,
)
from flexlink.results.trajectory import Trajectory


def simulate(
    scene: Scene,
    *,
    progress: Callable[[float], None] | None = None,
    method: str | None = None,
    step: float | None = None,
    duration: float | None = None,
    sample: float | None = None,
    solver: ForwardSolver | None = None,
    unstable: Unstable | None = None,
    tolerance: float | None = None,
    relative_tolerance: float | None = None,
    accuracy: Accuracy | None = None,
    max_evaluations: float | None = None,
    q0: ArrayLike | None = None,
    qd0: ArrayLike | None = None,
    t0: float | None = None,
    control: Law | None = None,
    rate: float | None = None,
) -> Trajectory:
    """Integrate the equation of motion M q̈ + T_GC + T_FL + T_FR = T_EX from the scene's initial state.

    Runge-Kutta with a fixed step, t = k · step (paper, equations 5 to 12), or, with a tolerance, with steps that follow
    from their error. The run judges itself: its step before it starts, and each sample by the power balance
    E(t) − E(0) = W(t).

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.
    progress
        Called with the finished fraction, now and then: 0 when everything is compiled and the run starts, 1 at its end.
    method, step, duration, sample, solver, unstable, tolerance, relative_tolerance, accuracy, max_evaluations
        In place of those of `scene.run`, times in s, tolerance in m; None: as the scene says. A tolerance takes the
        place of a fixed step, and a step that of a tolerance.
    q0, qd0, t0
        State to start from: joint angles [rad] and rates [rad/s], shape (n,), and the time [s], as `run.state` gives
        them; None: as `scene.initial` says. A run with fixed steps that is continued from one of its samples gives
        the same numbers to the bit.
    control
        Control law tau(t, q, qd) in place of the scene's drive: torques of the driven joints (`chain.active`) [N m],
        shape (d,), from time [s], angles [rad] and rates [rad/s], shape (n,). A law tau(t, q, qd, sensors), which needs
        a rate, is told what the scene's sensors show at its instants, too: numbers by the names of their columns.
    rate
        How often the law is asked [Hz], its torques held in between, as a real controller's are; None: at every stage
        of every step, fixed ones of an explicit method.

    Returns
    -------
    Trajectory
        Samples at t = t0, t0 + sample, t0 + 2 · sample, … t0 + duration.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, or `progress` no function.
    SceneError
        A run setting with a value that is not allowed.
    DataFileError
        The method's own file is not valid.
    UnstableStepError
        The step is larger than the largest stable one at the start (`stable_step`); unstable = "allow" insists.
    DivergenceError
        The state left the finite numbers, or the energy does not balance by more than a tenth of what was exchanged
        (implicit steps with a tolerance: a second run is made, and may mark the run as doubtful instead); the error's
        `trajectory` holds the good samples.
    EvaluationLimitError
        A DivergenceError, too: steps with a tolerance would take more than `max_evaluations`. Where such a run hangs is
        told, as a RuntimeWarning, a fiftieth of the way to there.
    ControlError
        The law raised, or gave no d finite numbers; its `trajectory` holds the samples before.
    InterruptedRunError
        Ctrl-C or SIGTERM; its `trajectory` holds the samples up to there.

    Examples
    --------
    >>> run = fl.simulate(scene)  # as the scene says
    >>> print(run, run.warnings)
    <Trajectory 'two_links': 101 samples, 0 … 1 s, 6 joints> ()
    >>> exact = fl.simulate(scene, tolerance=1e-5)  # m; the method is picked, the steps follow
    >>> print(abs(run.tip - exact.tip).max() < 1e-4)  # m
    True
    >>> later = fl.simulate(scene, q0=run.q[-1], qd0=run.qd[-1], t0=1.0, duration=0.1)  # goes on
    >>> def damp(t, q, qd):  # a law in place of the scene's drive [N m]
    ...     return fl.gravity_torque(chain, q)[chain.active] - 50.0 * qd[chain.active]
    >>> undriven = scene.varied({"drive": fl.Drive()})
    >>> lazy = fl.simulate(undriven, control=damp, rate=1000.0, duration=0.1)
    """
    require_callable("progress", progress)
    settings = {
        "method": method, "step": step, "duration": duration, "sample": sample,
        "solver": solver, "unstable": unstable,
        "tolerance": tolerance, "relative_tolerance": relative_tolerance, "accuracy": accuracy,
        "max_evaluations": max_evaluations,
    }  # fmt: skip
    changes: dict[str, object] = {f"run.{name}": value for name, value in settings.items() if value is not None}
    start, scene = starting_from(q0, qd0, t0), require_type("scene", scene, Scene)
    problem = Problem(scene.varied(changes | start)) if start else problem_with(scene, changes)
    return problem.simulate(progress=progress, control=control, rate=rate)


class Problem:
    """A scene that is prepared once and simulated many times, from other starts, over other times or by other laws.

    Each run is what `simulate` makes of the same arguments, equal to the bit, and costs little more than its steps: the
    chain, what is found of it, the inputs, scratch and machine code are those of the runs before. Threads may share it.

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.

    Attributes
    ----------
    scene, chain
        The scene, and its chain as `lump` cuts it.

    Raises
    ------
    ArgumentError
        `scene` is no Scene.
    SceneError, ConvergenceError, DataFileError
        As in `lump` and `initial_state`.

    Examples
    --------
    >>> falling = scene.varied({"drive": fl.Drive(), "run.tolerance": 1e-4, "run.duration": 0.2})
    >>> problem = fl.Problem(falling)
    >>> runs = [problem.simulate(q0=q + angle) for angle in (-0.1, 0.0, 0.1)]
    >>> print(len(runs), runs[0].steps.method)
    3 Radau5
    """

    def __init__(self, scene: Scene) -> None:
        self._problem = problem_of(require_type("scene", scene, Scene))
        self.scene, self.chain = scene, self._problem.original
        self._idle: list[tuple[InitialValueProblem, Kept]] = [(self._problem, Kept())]

    def __reduce__(self) -> tuple[type[Problem], tuple[Scene]]:
        """Copies and pickles are prepared anew: machine code stays in its process."""
        return Problem, (self.scene,)

    def __repr__(self) -> str:
        return f"<Problem {self.chain.name!r}: {self.chain.n} joints>"

    def simulate(
        self,
        *,
        q0: ArrayLike | None = None,
        qd0: ArrayLike | None = None,
        t0: float | None = None,
        duration: float | None = None,
        control: Law | None = None,
        rate: float | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Trajectory:
        """Integrate the equation of motion; arguments, result and errors as in the function `simulate`.

        Parameters
        ----------
        q0, qd0, t0
            State to start from: joint angles [rad] and rates [rad/s], shape (n,), and the time [s]; None: as
            `scene.initial` says.
        duration
            How long [s]; None: as `scene.run` says.
        control, rate
            Control law tau(t, q, qd) in place of the scene's drive, and how often it is asked [Hz].
        progress
            Called with the finished fraction, now and then.

        Returns
        -------
        Trajectory
            Samples, at the distances that `scene.run` says.

        Examples
        --------
        >>> problem = fl.Problem(scene)
        >>> print(problem.simulate(duration=0.1).t[-1])
        0.1
        """
        require_callable("progress", progress)
        if duration is not None:
            longer = problem_with(self.scene, {"run.duration": duration})
            return longer.simulate(q0=q0, qd0=qd0, t0=t0, control=control, rate=rate, progress=progress)
        try:
            problem, kept = self._idle.pop()
        except IndexError:  # another thread runs it
            problem, kept = problem_of(self.scene, self.chain), Kept()
        try:
            for array in remembered(problem.inputs.drive):
                array[...] = 0
            scene = started_from(self.scene, q0, qd0, t0)
            run = SingleRun(
                prepare(
                    problem if scene is self.scene else started(problem, scene), control, rate,
                    kept=kept if control is None else None,
                )
            )  # fmt: skip
            with deferred() as stop:
                return run.finish(stop, progress, warn=warn)
        finally:
            self._idle.append((problem, kept))


PROBLEMS = Memo(16)
"""Problems of scenes by the settings of their runs: who simulates a scene again has prepared it already."""


def problem_with(scene: Scene, settings: dict[str, object]) -> Problem:
    """The problem of a scene with other settings of its run, by path; errors as in `Scene.varied` and `Problem`."""

    def prepared() -> Problem:
        return Problem(scene.varied(settings) if settings else scene)

    known = all(isinstance(value, str | int | float) for value in settings.values())
    may_change = names_files(scene) or is_user_file(settings.get("run.method"))
    if may_change or not known:
        return prepared()
    return PROBLEMS(scene, tuple((name, type(value), value) for name, value in settings.items()), prepared)


@keep_last(64)
def names_files(scene: Scene) -> bool:
    """Whether a scene names a method, a lumping rule or a shaper by a user's own file."""
    reference = scene.drive.reference
    shaper = reference.shaper.kind if reference is not None and reference.shaper is not None else ""
    return any(map(is_user_file, (scene.run.method, shaper, *(link.lumping for link in scene.arm.links))))


def starting_from(q0: ArrayLike | None, qd0: ArrayLike | None, t0: float | None) -> dict[str, object]:
    """Changes of a scene, by path, that start it from this state; None leaves a part as it is."""
    changes: dict[str, object] = {} if t0 is None else {"initial.time": t0}
    if q0 is not None:
        changes |= {"initial.passive": None, "initial.q": q0}
    if qd0 is not None:
        changes |= {"initial.rate_deg": None, "initial.rate_m": None, "initial.qd": qd0}
    return changes


def started_from(scene: Scene, q0: ArrayLike | None, qd0: ArrayLike | None, t0: float | None) -> Scene:
    """The scene varied so; from arrays of finite numbers, which need no reading, in a tenth of the time."""
    changes = starting_from(q0, qd0, t0)
    if not changes:
        return scene
    if not (_is_read(q0) and _is_read(qd0) and (t0 is None or (isinstance(t0, float) and 0.0 <= t0 < math.inf))):
        return scene.varied(changes)
    initial: dict[str, object] = {} if t0 is None else {"time": float(t0)}
    if isinstance(q0, np.ndarray):
        initial |= {"q": tuple(q0.tolist()), "passive": "zero"}
    if isinstance(qd0, np.ndarray):
        initial |= {"qd": tuple(qd0.tolist()), "rate_deg": None, "rate_m": None}
    started: Scene = build_validated(replace, scene, initial=build_validated(replace, scene.initial, **initial))
    return started


def _is_read(state: ArrayLike | None) -> bool:
    if state is None:
        return True
    return isinstance(state, np.ndarray) and state.dtype == np.float64 and state.ndim == 1 and is_finite(state)


class SingleRun:
    """A run that is ready to start: checked, allocated, compiled; errors as in `simulate`."""

    def __init__(self, monitor: RunMonitor, halved: bool = False) -> None:
        self.monitor = monitor
        self.steps = steps_of(self.monitor, halved)

    def finish(
        self,
        stop: Stop,
        progress: Callable[[float], None] | None = None,
        *,
        compared: bool = True,
        warn: Callable[[str], None] | None = None,
    ) -> Trajectory:
        """Run to the end, or until stopped; `compared` with a verification run where its steps call for one.

        `warn` is told, once, and while the run goes on, where it hangs.
        """
        monitor, steps = self.monitor, self.steps
        try:
            self.advance(stop, progress or (lambda _: None), warn=warn)
            if compared and not (monitor.failure or steps.failure or stop.asked):
                monitor.warnings += verify(monitor, steps.steps.method, stop)
        except LawFailure as failure:
            raise ControlError(f"{monitor.record.chain.name}: {failure}", monitor.trajectory()) from failure.__cause__
        except KeyboardInterrupt:  # of a caller's own handler, or of its `progress`
            stop.signal = signal.SIGINT
        if monitor.failure or steps.failure:
            raise monitor.diverged(steps.failure)
        if stop.signal is not None:
            raise InterruptedRunError(monitor.trajectory(), stop.signal)
        return monitor.trajectory()

    def advance(self, stop: Stop, report: Callable[[float], None], warn: Callable[[str], None] | None = None) -> None:
        """Advance until the run ends, a check fails, or somebody stops it."""
        monitor, steps = self.monitor, self.steps
        for reached in steps:
            good = True
            if reached.rows > 1 or reached.part == 1.0 or steps.failure:  # one look is enough for a short run
                good = monitor.check(
                    reached.rows,
                    steps.steps,
                    methods=steps.methods,
                    deflection=steps.deflection,
                    angle_travelled=steps.angle_travelled,
                )
            row, slow = steps.slow
            if warn and slow and row <= max(1, monitor.n_valid):  # not of what came after a sample that is wrong
                warn(f"{monitor.record.chain.name}: {slow}")
                warn = None
            if not good:
                monitor.steps = steps.steps_before(monitor.n_valid)
                break
            if steps.failure:
                break
            report(reached.part)
            if stop.asked:
                break
        else:
            steps.failure = ended_early(monitor.last_time, float(monitor.record.t[-1]))


def verify(monitor: RunMonitor, name: str, stop: Stop) -> Iterator[str]:
    """Compare a finished run of this method with verification runs: yields a warning where they contradict it."""
    text, own, problem = "", monitor.steps.evaluations, monitor.record.problem
    for second in second_runs(monitor, name):
        text = text or UNKNOWN.format(times=GIVEN_UP, advice=advice(monitor))
        most = min(second.run.max_evaluations, GIVEN_UP * own)
        limited = replace(second.run, max_evaluations=most) if second.run.controlled else second.run
        try:
            again = replace(problem.scene, run=limited)  # whose steps may not be such that one begins at its start
            other = SingleRun(prepare(problem_of(again, problem.original)), halved=limited.controlled)
            other.advance(stop, lambda _: None)
        except FlexlinkError:
            continue
        if stop.asked:
            return
        evaluations, wrong, failure = other.monitor.steps.evaluations, other.monitor.failure, other.steps.failure
        limited_out = failure is not None and failure.kind is EvaluationLimitError and not wrong
        if limited_out or evaluations > GIVEN_UP * own:
            break
        # a step of 2 h in two parts is two steps of the run itself, which would agree with themselves
        in_parts = not second.run.controlled and other.steps.steps.failed > 0
        if not (wrong or failure or in_parts):
            text = doubt(monitor, second, other.monitor.record.compared(other.monitor.n_valid))
            monitor.confirmed = not text
            if not text or second.strict or evaluations > own:
                break
    if text:
        yield text


def steps_of(monitor: RunMonitor, halved: bool = False) -> FixedSteps | AdaptiveSteps:
    """The stepper of a run: fixed steps of an explicit method, or adaptive and implicit ones, the longest `halved`."""
    return FixedSteps(monitor) if monitor.explicit else AdaptiveSteps(monitor, halved)


def prepare(
    problem: InitialValueProblem,
    law: Law | None = None,
    rate: float | None = None,
    *,
    rows: int | None = None,
    kept: Kept | None = None,
) -> RunMonitor:
    """`allocate` a run, with its checks compiled; errors as there."""
    monitor = allocate(problem, law, rate, rows=rows, kept=kept)
    monitor.compile()
    return monitor


def allocate(
    problem: InitialValueProblem,
    law: Law | None = None,
    rate: float | None = None,
    *,
    rows: int | None = None,
    kept: Kept | None = None,
    warnings: tuple[str, ...] | None = None,
) -> RunMonitor:
    """Allocate the sample arrays of a run, write the initial state into row 0, and check the fixed step.

    With scratch and machine code that is `kept` from another run of the problem, if there is one; `warnings`, if known:
    those of the step check.

    Raises
    ------
    SceneError
        The method is unknown, or cannot do what the run asks of it, or the samples do not fit into memory.
    UnstableStepError
        As in `simulate`.
    """
    run, chain = problem.run, problem.chain
    check_method(run)
    control = control_of(problem, law, rate)
    if control is not None:
        problem = dataclasses.replace(problem, inputs=problem.inputs._replace(drive=control.drive))
    try:
        times = multiples(problem.start, run.between, run.samples if rows is None else rows)
        q, qd = np.empty((2, len(times), chain.n))
        record = Record(problem, times, q, qd, kept)
    except (MemoryError, ValueError):  # ValueError: more than numpy can count
        raise SceneError(
            f"{run.said('sample', 'run.')} = {run.spacing!r}: {run.samples} samples of {chain.n} joints do not fit "
            "into memory"
        ) from None
    record.q[0], record.qd[0] = problem.q, problem.qd
    if not record.kept.types:  # all else that kernels are given here is made in one way
        solver = f"{run.solver} {chain.is_planar}".encode()
        drive, *others = problem.inputs
        record.kept.types = types_of(chain.arrays, *others) + _types_of_drive(drive) + solver
    about = problem.q.tobytes(), problem.qd.tobytes(), problem.start
    if warnings is None:
        warnings = record.kept("step", about, lambda: judge_step(problem))
    monitor = RunMonitor(record, warnings, control)
    if control is not None:
        try:
            control.note(0, problem.q, problem.qd)
        except LawFailure as failure:
            raise ControlError(f"{chain.name}: {failure}", monitor.trajectory()) from failure.__cause__
    return monitor


@keep_last(64)
def _types_of_drive(drive: Drive) -> bytes:
    """Types of the numbers of a drive, which runs share."""
    return types_of(drive)
