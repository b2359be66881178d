"""simulate(scene) → Trajectory: runs the compiled Runge-Kutta loop in chunks, between which Python checks samples."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Never

from msgspec.structs import replace
from numpy.typing import ArrayLike

from flexlink.chain.arguments import explained, refuse_call, require_callable, require_type
from flexlink.common.errors import ArgumentError
from flexlink.common.interruption import deferred
from flexlink.common.memo import Kept, Memo
from flexlink.data.documents import is_user_file
from flexlink.describe.run_settings import Accuracy, ForwardSolver, Unstable, check_method
from flexlink.describe.scene import Scene
from flexlink.describe.spec import key_mistakes
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.motion.budget import warn
from flexlink.motion.inputs.problem import problem_of, started, started_from
from flexlink.motion.single_run import SingleRun, prepared_run
from flexlink.results.samples import State, StatedError
from flexlink.results.trajectory import Trajectory

if TYPE_CHECKING:
    from flexlink.motion.sampled_control import Law


def simulate(
    scene: Scene, *_more: Never, progress: Callable[[float], None] | None = None, method: str | None = None,
    step: float | None = None, duration: float | None = None, sample: float | None = None,
    solver: ForwardSolver | None = None, unstable: Unstable | None = None, tolerance: float | None = None,
    relative_tolerance: float | None = None, accuracy: Accuracy | None = None, max_evaluations: float | None = None,
    q0: ArrayLike | None = None, qd0: ArrayLike | None = None, t0: float | None = None, control: Law | None = None,
    rate: float | None = None, delay: float = 0.0, after: Trajectory | None = None, **unknown: Never,
) -> Trajectory:  # fmt: skip
    """Integrate the equation of motion M q̈ + T_GC + T_FL + T_FR = T_EX from the scene's initial state.

    The method is Runge-Kutta with a fixed step, t = k · step (paper, equations 5 to 12), or with adaptive steps that
    meet a tolerance. The stability of a fixed step is checked before the run starts, and each sample is checked by the
    power balance E(t) − E(0) = W(t).

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.
    progress
        Function called with the completed fraction from time to time: 0 when the run starts, 1 at its end.
    method, step, duration, sample, solver, unstable, tolerance, relative_tolerance, accuracy, max_evaluations
        Replacements for the settings of `scene.run`, times in s, tolerance in m; None: as in the scene. A tolerance
        replaces a fixed step, and a step replaces a tolerance.
    q0, qd0, t0
        State to start from: joint angles [rad] and rates [rad/s], shape (n,), and the time [s], as `run.state` returns
        them; None: as in `scene.initial`. If a run with fixed steps is continued from one of its samples, the result is
        identical bit for bit.
    control
        Control law tau(t, q, qd), used instead of a drive in the scene. It returns the torques of the driven joints
        (`chain.active`) [N m], shape (d,), from time [s], angles [rad] and rates [rad/s], shape (n,). A law
        tau(t, q, qd, sensors), which needs a rate, also gets the sensor readings, a dict by column name, at its
        sampling instants.
    rate
        Sampling rate of the law [Hz]; torques are held between samples, as by a digital controller. None: the law is
        evaluated at every stage of every step, which requires fixed steps of an explicit method.
    delay
        Time from a sampling instant of the law until its torques act [s], also parts of 1 / rate or several; with fixed
        steps a multiple of the step. Until the first torques act, they are those of the first instant.
    after
        A run whose last sample this run starts from, in place of `q0`, `qd0` and `t0`. Torques of a delayed law that
        were on their way then act in this run.
    *_more, **unknown
        Refused; the message names what was probably meant.

    Returns
    -------
    Trajectory
        Samples at t = t0, t0 + sample, t0 + 2 · sample, … t0 + duration.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene, or `progress` is not callable.
    SceneError
        A run setting has a value that is not allowed.
    DataFileError
        The user's method file is not valid.
    UnstableStepError
        The step is larger than the largest stable step at the start (`stable_step`); unstable = "allow" permits it.
    DivergenceError
        The state is no longer finite, or the energy imbalance exceeds a tenth of the energy exchanged (with adaptive
        implicit steps a second run decides, and may mark the run as doubtful instead); or adaptive steps would take
        more than `max_evaluations`, with the id "too-many-evaluations" (after a fiftieth of the evaluations, a
        RuntimeWarning gives the cause of slow progress). The error's `trajectory` contains the good samples.
    ControlError
        The law raised an exception, or did not return d finite numbers; `trajectory` contains the samples before that.
    InterruptedRunError
        Ctrl-C or SIGTERM; `trajectory` contains the samples up to that point.

    Examples
    --------
    >>> run = fl.simulate(scene)  # as specified in the scene
    >>> print(run, run.warnings)
    <Trajectory 'two_links': 101 samples, 0 … 1 s, 6 joints> ()
    >>> exact = fl.simulate(scene, tolerance=1e-5)  # m; automatic method, adaptive steps
    >>> print(abs(run.tip - exact.tip).max() < 1e-4)  # m
    True
    >>> later = fl.simulate(scene, after=run, duration=0.1)  # continues
    >>> def damp(t, q, qd):  # replaces the scene's drive [N m]
    ...     return fl.gravity_torque(chain, q)[chain.active] - 50.0 * qd[chain.active]
    >>> undriven = scene.varied({"drive": fl.Drive()})
    >>> lazy = fl.simulate(undriven, control=damp, rate=1000.0, duration=0.1)
    """
    if _more:
        refuse_call(simulate, "too many positional arguments", {})
    for wrong in key_mistakes(unknown, [*(simulate.__kwdefaults__ or ())], (), "simulate"):
        raise ArgumentError(wrong, id=wrong.id)
    require_callable("progress", progress)
    settings = {
        "method": method, "step": step, "duration": duration, "sample": sample,
        "solver": solver, "unstable": unstable,
        "tolerance": tolerance, "relative_tolerance": relative_tolerance, "accuracy": accuracy,
        "max_evaluations": max_evaluations,
    }  # fmt: skip
    changes: dict[str, object] = {f"run.{name}": value for name, value in settings.items() if value is not None}
    scene = require_type("scene", scene, Scene)
    if after is not None:
        t0, q0, qd0 = _end_of(after, q0, qd0, t0)
    starts = not (q0 is None and qd0 is None and t0 is None)
    problem = Problem(started_from(scene, q0, qd0, t0, **changes)) if starts else problem_with(scene, changes)
    with problem._run(problem.scene, control, rate, delay, after) as run, deferred() as stop:
        run.advance(stop, progress, warn)
        return run.result(stop)


MANY = 100_000
"""Numbers in the samples of a run from which on they are not kept for the next run, whose preparation costs less."""


class Problem:
    """A scene prepared once for many simulations with different initial states, durations or control laws.

    Each run is identical, bit for bit, to `simulate` with the same arguments, and takes little more time than its
    steps, since the chain, its derived data, inputs, workspace and machine code are reused. Threads may share a
    Problem.

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench and run settings.

    Attributes
    ----------
    scene, chain
        The scene, and its chain as returned by `lump`.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene.
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
        self._problem = problem_of(require_type("scene", scene, Scene), tied=True)
        self.scene, self.chain = scene, self._problem.original
        self._idle: list[tuple[InitialValueProblem, Kept]] = [(self._problem, Kept())]

    def __reduce__(self) -> tuple[type[Problem], tuple[Scene]]:
        """Prepare copies and pickles anew from the scene, since machine code cannot leave its process."""
        return Problem, (self.scene,)

    def __repr__(self) -> str:
        return f"<Problem {self.chain.name!r}: {self.chain.n} joints>"

    @explained
    def simulate(
        self, *, q0: ArrayLike | None = None, qd0: ArrayLike | None = None, t0: float | None = None,
        duration: float | None = None, control: Law | None = None, rate: float | None = None, delay: float = 0.0,
        after: Trajectory | None = None, progress: Callable[[float], None] | None = None,
    ) -> Trajectory:  # fmt: skip
        """Integrate the equation of motion; arguments, result and errors as in the function `simulate`.

        Parameters
        ----------
        q0, qd0, t0
            State to start from: joint angles [rad] and rates [rad/s], shape (n,), and the time [s]; None: as in
            `scene.initial`.
        duration
            Duration [s]; None: as in `scene.run`.
        control, rate, delay
            Control law tau(t, q, qd) that replaces the scene's drive, its sampling rate [Hz], and the delay of its
            torques [s].
        after
            A run whose last sample this run starts from.
        progress
            Function called with the completed fraction from time to time.

        Returns
        -------
        Trajectory
            Samples at the interval of `scene.run`.

        Examples
        --------
        >>> problem = fl.Problem(scene)
        >>> print(problem.simulate(duration=0.1).t[-1])
        0.1
        """
        require_callable("progress", progress)
        problem = self if duration is None else problem_with(self.scene, {"run.duration": duration})
        if after is not None:
            t0, q0, qd0 = _end_of(after, q0, qd0, t0)
        scene = started_from(problem.scene, q0, qd0, t0)
        with problem._run(scene, control, rate, delay, after) as run, deferred() as stop:
            run.advance(stop, progress, warn)
            return run.result(stop)

    @contextlib.contextmanager
    def _run(
        self, scene: Scene, control: Law | None, rate: float | None, delay: float, after: Trajectory | None
    ) -> Iterator[SingleRun]:
        """A run of the scene, perhaps from another state, ready to start, with what the run `after` hands on."""
        before = None if after is None or not len(after.delayed) else after.delayed
        try:
            problem, kept = self._idle.pop()
        except IndexError:  # in use by another thread
            problem, kept = problem_of(self.scene, self.chain, tied=True), Kept()
        try:
            drive = problem.inputs.drive
            stored = drive.held.shape[1] if drive.rate else len(self.chain.active)
            if before is not None and before.shape[1] != 1 + stored:
                counts = f"{before.shape[1] - 1} numbers at each instant (torques, then its memory), this one {stored}"
                text = f"after: the drive of that run stores {counts}; start from its state: q0, qd0 and t0"
                raise ArgumentError(text, id="wrong-shape")
            begun = problem if scene is self.scene else started(problem, scene)
            motion = continued(after, scene)
            if control is None and rate is None and not delay:
                yield prepared_run(begun, kept, before, motion)
            else:
                from flexlink.motion.sampled_control import control_of  # noqa: PLC0415  few runs have a law in Python

                check_method(begun.run)
                yield SingleRun(begun, control_of(begun, control, rate, delay, before), before, motion=motion)
        finally:
            self._idle.append((problem, kept if self.scene.run.samples * self.chain.n < MANY else Kept()))


def continued(after: Trajectory | None, scene: Scene) -> StatedError | None:
    """The motion that a run of a scene continues; from another scene, only its travel and its error are handed on."""
    if after is None or after.stated is None or not scene.run.controlled:
        return None
    motion, end = after.stated, after.state(-1)
    same = after.scene is not None and replace(after.scene, initial=scene.initial, run=scene.run) == scene
    return motion if same else motion._replace(start=end, end=None, delayed=None)


def _end_of(after: Trajectory, q0: ArrayLike | None, qd0: ArrayLike | None, t0: float | None) -> State:
    """The last state of a run that is continued, refused if the state is also given."""
    for name, given in (("q0", q0), ("qd0", qd0), ("t0", t0)):
        if given is not None:
            raise ArgumentError(f"{name}: after is also given; specify only one", id="both-given")
    return require_type("after", after, Trajectory).state(-1)


PROBLEMS = Memo(16)  # cache of prepared problems by scene and run settings, for scenes that are simulated repeatedly


def problem_with(scene: Scene, settings: dict[str, object]) -> Problem:
    """The problem of a scene with changed run settings, given by path; errors as in `Scene.varied` and `Problem`."""

    def prepared() -> Problem:
        return Problem(scene.varied(settings) if settings else scene)

    if not all(isinstance(value, str | int | float) for value in settings.values()):
        return prepared()
    key = tuple((name, type(value), value) for name, value in settings.items())
    reference = scene.drive.reference
    shaper = reference.shaper.kind if reference is not None and reference.shaper is not None else ""
    named = (scene.run.method, settings.get("run.method"), shaper, *(link.lumping for link in scene.arm.links))
    may_change = any(map(is_user_file, named))  # a user's file of a method, a shaper or a lumping rule
    return prepared() if may_change else PROBLEMS(scene, key, prepared)
