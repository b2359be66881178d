"""simulate(scene) → Trajectory: the compiled Runge-Kutta loop, in chunks between which Python checks the samples."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec.structs import replace
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_callable, require_type
from flexlink.common.interruption import deferred
from flexlink.common.memo import Kept, Memo
from flexlink.data.documents import is_user_file
from flexlink.describe.run_settings import Accuracy, ForwardSolver, Unstable
from flexlink.describe.scene import Scene
from flexlink.describe.spec import build_validated
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.tools.finite import is_finite
from flexlink.motion.budget import warn
from flexlink.motion.inputs.drives import remembered
from flexlink.motion.inputs.problem import problem_of, started
from flexlink.motion.sampled_control import Law
from flexlink.motion.single_run import SingleRun
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
    scene, starts = require_type("scene", scene, Scene), not (q0 is None and qd0 is None and t0 is None)
    problem = Problem(started_from(scene, q0, qd0, t0, **changes)) if starts else problem_with(scene, changes)
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
            begun = problem if scene is self.scene else started(problem, scene)
            run = SingleRun(begun, control, rate, kept=kept if control is None else None)
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

    if not all(isinstance(value, str | int | float) for value in settings.values()):
        return prepared()
    key = tuple((name, type(value), value) for name, value in settings.items())
    kept: Problem | None = PROBLEMS.kept(scene, key)
    if kept is not None:
        return kept
    may_change = names_files(scene) or is_user_file(settings.get("run.method"))
    return prepared() if may_change else PROBLEMS(scene, key, prepared)


def names_files(scene: Scene) -> bool:
    """Whether a scene names a method, a lumping rule or a shaper by a user's own file."""
    reference = scene.drive.reference
    shaper = reference.shaper.kind if reference is not None and reference.shaper is not None else ""
    return any(map(is_user_file, (scene.run.method, shaper, *(link.lumping for link in scene.arm.links))))


def started_from(
    scene: Scene, q0: ArrayLike | None, qd0: ArrayLike | None, t0: float | None, **changes: object
) -> Scene:
    """The scene, with these changes by path, from this state on, of which None leaves a part as it is.

    From arrays of finite numbers, which need no reading, in a tenth of the time.
    """
    if q0 is None and qd0 is None and t0 is None and not changes:
        return scene
    start: dict[str, object] = {} if t0 is None else {"initial.time": t0}
    if q0 is not None:
        start |= {"initial.passive": None, "initial.q": q0}
    if qd0 is not None:
        start |= {"initial.rate_deg": None, "initial.rate_m": None, "initial.qd": qd0}
    known = _is_read(q0) and _is_read(qd0) and (t0 is None or (isinstance(t0, float) and 0.0 <= t0 < math.inf))
    if changes or not known:
        return scene.varied(changes | start)
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
