"""Simulator: an arm that the caller advances step by step, for example a controller or a learning agent."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Never, NoReturn, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import positive, refuse_call, require_type, vector
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, Diagnostic
from flexlink.common.memo import Kept
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.numbers import parts, whole
from flexlink.describe.scene import Scene
from flexlink.dynamics.sensors.instrument import Readings
from flexlink.kernels.inputs.record import Inputs
from flexlink.motion.adaptive_steps import AdaptiveSteps
from flexlink.motion.hindrance import held_torques_advice
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import effort_of, held_torques, remembered
from flexlink.motion.inputs.problem import problem_of, started, started_from
from flexlink.motion.sampled_control import impulses, nothing_read, sample_at
from flexlink.motion.single_run import prepared_run
from flexlink.motion.verification import exceeded, is_exceeded, runs_of_other_order
from flexlink.results.record import trajectory_from_states
from flexlink.results.samples import State
from flexlink.results.stop_reasons import DivergenceError, Failure, ended_early
from flexlink.results.tip_motion import apart, compared_path

OFTEN = 128  # calls of `step` between two checks of the power balance; the first checks are at calls 1, 2, 4, …


class Simulator:
    """An arm that the caller advances step by step: M q̈ + T_GC + T_FL + T_FR = T_EX, by the scene's method.

    With fixed steps and the same torques, states are identical, bit for bit, to the samples of `simulate` at the calls.
    As in a run, the stability of fixed explicit steps is checked at `reset`, finite numbers at every call, and the
    power balance at some calls. With a tolerance, every call ends a step, and the steps allow for errors as in a run of
    `run.duration`, whatever the time simulated here; `error` states what they add up to.

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench, and the method and step, or tolerance, of its run.

    Attributes
    ----------
    chain
        The chain that is simulated.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene.
    SceneError, UnstableStepError
        As in `simulate`.

    Examples
    --------
    >>> arm = fl.Simulator(scene)
    >>> while arm.time < 0.05:
    ...     t, q, qd = arm.state
    ...     torque = fl.gravity_torque(arm.chain, q)[arm.chain.active] - 50.0 * qd[arm.chain.active]
    ...     after = arm.step(torque, duration=1e-3)
    >>> print(round(arm.time, 3), fl.tip_position(arm.chain, arm.state.q)[:2].round(3))
    0.05 [1.558 0.092]
    """

    def __init__(self, scene: Scene) -> None:
        run = require_type("scene", scene, Scene).run
        self._scene = scene if run.duration else scene.varied({"run.duration": run.spacing})
        self.chain = lump(open_chain(scene))
        none = np.zeros((1, len(self.chain.active)))
        driven = short_list([self.chain.joint_name(int(k)) for k in self.chain.active])
        self._wanted = f", a torque for each driven joint: {driven}; a time is given as duration=…"
        self._held = held_torques(self.chain, np.zeros(1), none, effort_of(scene, self.chain))
        self._problem, self._kept = problem_of(self._scene, self.chain, tied=True), Kept()
        self._readings: dict[str, float] = {}
        self._lengths: dict[float, int] = {}  # number of fixed steps of each duration used so far
        self.reset()

    def __reduce_ex__(self, protocol: SupportsIndex) -> NoReturn:
        """Refuse copies and pickles: they would share arrays that steps change, or the links between them."""
        kind = type(self).__name__
        remedy = f"make another {kind} of the same scene, and pass the angles and rates of `state` to its reset()"
        why = f"{kind}: cannot be copied or pickled, since compiled code changes its state in place; {remedy}"
        raise ArgumentError(why, id="cannot-copy")

    def __repr__(self) -> str:
        return f"<Simulator {self.chain.name!r}: t = {self.time:g} s, {self.chain.n} joints>"

    def reset(self, q: ArrayLike | None = None, qd: ArrayLike | None = None, *, time: float | None = None) -> State:
        """Restart from angles [rad] and rates [rad/s], shape (n,), at a time [s]; None: as in the scene.

        Raises
        ------
        SceneError
            A state of the wrong shape or with numbers that are not finite; a time that is not a multiple of the step.
        UnstableStepError
            The step is larger than the largest stable one in this state.

        Examples
        --------
        >>> arm = fl.Simulator(scene)
        >>> after = arm.step([30.0, 10.0], duration=0.01)
        >>> print(arm.reset().t)
        0.0
        """
        scene = started_from(self._scene, q, qd, time)
        problem = self._problem if scene is self._scene else started(self._problem, scene)
        single = prepared_run(problem, self._kept, rows=1)
        self._monitor, self._steps = single.monitor, single.steps
        self._run, self._record = self._monitor.run, self._monitor.record
        self._driven = self._record.inputs
        self._pushed = self._driven._replace(drive=drive_for(self._record.chain, self._held))
        self._time, self._calls = float(self._record.t[0]), 0
        if not self._run.controlled:
            self._time = self._record.origin * self._run.fixed_step
        self._sensing = Readings(scene) if scene.sensor else None
        self._read = nothing_read(self.chain)
        self._past: list[tuple[Array | None, float, Array]] = []  # torques, duration, and angles after each call
        self._again: Simulator | None = None
        self._given = [None if each is None else np.array(each) for each in (q, qd)]  # the caller may change its arrays
        self._began, self._error = time, 0.0
        self._monitor.begin()
        self._steps.go(self._pushed, self._time, self._time)  # compiles
        self._sense(self._driven)
        return self.state

    def _sense(self, inputs: Inputs) -> None:
        """Update the sensor readings from the present state and the inputs that act."""
        if self._sensing is not None:
            q, qd, *_ = self._steps.state
            self._readings = self._sensing.after(sample_at(self._record.problem, inputs, self._time, q, qd))

    @property
    def readings(self) -> dict[str, float]:
        """Sensor readings at the present time, by the names of their columns, "gauge [1]".

        Sensors sample the arm at the end of every call of `step`, and their signals are linear in between.
        Accelerometers measure the acceleration under the torques of the step that ends. With the scene's drive and
        steps of `run.sample`, the readings are the same as in a run.

        Examples
        --------
        >>> encoder = fl.Sensor(name="encoder", kind="joint", link="upper", resolution=0.01)  # rad
        >>> arm = fl.Simulator(scene.varied({"sensor": (encoder,)}))
        >>> after = arm.step(duration=0.1)
        >>> print(after.q[0].round(4), arm.readings)  # rad
        0.5486 {'encoder [rad]': 0.55}
        """
        return dict(self._readings)

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self._time

    @property
    def state(self) -> State:
        """Copy of the present time [s], angles [rad] and rates [rad/s], shape (n,); sliding joints in m and m/s."""
        q, qd, *_ = self._steps.state
        if self._record.base is not None:
            return State(self._time, *self._record.base.relative_to_start(q, qd))
        return State(self._time, q.copy(), qd.copy())

    @property
    def error(self) -> float | None:
        """Estimated error of the tip up to the present time [m], the largest of all tips; None for fixed steps.

        It is the distance to a second simulator, which repeats all calls since `reset` by a method of another order and
        a smaller tolerance. That takes up to twice as long as the calls did; `step` itself costs no more, but remembers
        torques and angles of each call until then. Later uses of `error` continue there.

        Examples
        --------
        >>> arm = fl.Simulator(scene.varied({"run": fl.RunSettings(tolerance=1e-3)}))
        >>> after = arm.step(duration=0.1)
        >>> print(arm.error < 1e-3, arm.warnings)  # m
        True ()
        """
        if not (self._run.controlled and isinstance(self._steps, AdaptiveSteps)):
            return None
        if self._again is None:
            finer = next(runs_of_other_order(self._run, self._steps.name, self.chain.size))
            self._again = Simulator(self._scene.varied({"run": finer}))
            self._again.reset(*self._given, time=self._began)
        for tau, duration, q in self._past:
            both = q, self._again.step(tau, duration=duration).q
            own, other = (compared_path(self.chain, each[None], every=self._record.tied) for each in both)
            self._error = max(self._error, float(apart(own, other)[0]))
        self._past.clear()
        return self._error

    @property
    def warnings(self) -> tuple[Diagnostic, ...]:
        """Warnings about the motion so far, as of a run: an unstable loop, or an `error` beyond the tolerance."""
        found, error = tuple(self._monitor.warnings), self.error
        if error is None or not is_exceeded(self._monitor, error):
            return found
        return (*found, exceeded(self._monitor, error))

    def step(self, tau: ArrayLike | None = None, *_more: Never, duration: float | None = None) -> State:
        """Advance the arm under constant torques, and return the state at the end.

        Parameters
        ----------
        tau
            T_EX of the driven joints (`chain.active`) [N m], shape (d,), which replaces the scene's drive; None: the
            scene's drive acts. The torque of a joint with prescribed motion has no effect.
        duration
            Duration [s], a multiple of a fixed step; None: `run.sample`.

        Raises
        ------
        ArgumentError
            A torque of the wrong shape or not finite; a duration that is not a multiple of a fixed step.
        DivergenceError
            The state is no longer finite, no step meets the tolerance, or the energy does not balance; the simulator
            stays in its state before this call.

        Examples
        --------
        >>> arm = fl.Simulator(scene)
        >>> after = arm.step([30.0, 10.0], duration=0.01)  # N m on the driven joints, held for 0.01 s
        >>> print(after.t, after.q.shape)
        0.01 (6,)
        """
        if _more:
            refuse_call(self.step, "too many positional arguments", {})
        duration = self._run.spacing if duration is None else duration
        inputs, end, steps = self._driven, self._later(duration), self._steps
        drive = remembered(inputs.drive) if inputs.drive.rate else ()  # only a sampled drive has memory
        calls = self._calls + 1
        torque = None if tau is None else vector("tau", tau, len(self.chain.active), meaning=self._wanted).copy()
        if torque is not None:
            self._held.feedforward.coefficients[0, 0] = torque
            inputs, drive = self._pushed, (*drive, self._read)
        before = steps.saved(), drive, [array.copy() for array in drive]
        try:
            if torque is not None and isinstance(steps, AdaptiveSteps):
                steps.reads(impulses(self._read, self.chain, torque, steps.state[1], duration))
            fault = steps.go(inputs, self._time, end) or ended_early(steps.time, end)
            if not fault and (calls % OFTEN == 0 or calls & (calls - 1) == 0):
                q, qd, *_, done = steps.state
                fault = self._monitor.unbalanced(q, qd, done[:1], steps.steps, steps.so_far[0])
        except BaseException:  # including Ctrl-C
            self._restore(*before)
            raise
        if fault:
            self._restore(*before)
            raise self._diverged(fault, 0.0 if tau is None else end - self._time)
        self._time, self._calls = end, calls
        self._sense(inputs)
        after = self.state
        if self._run.controlled:
            self._past.append((torque, duration, after.q.copy()))
        return after

    def _restore(self, steps: Any, drive: Sequence[NDArray[Any]], remembered: Sequence[NDArray[Any]]) -> None:
        self._steps.restore(steps)
        for array, before in zip(drive, remembered, strict=True):
            array[:] = before

    def _later(self, duration: float) -> float:
        """End time [s] of a call: a multiple of a fixed step, or, for other steps, the next multiple of `duration`."""
        run, now = self._run, self._time
        if type(duration) is not float or duration not in self._lengths:
            duration = positive("duration", duration)
            unit = run.label("step", "run."), run.fixed_step
            self._lengths[duration] = 0 if run.controlled else whole("duration", duration, *unit, ArgumentError)
        if not run.controlled:
            return (round(now / run.fixed_step) + self._lengths[duration]) * run.fixed_step
        end = (parts(now, duration) + 1) * duration
        if end <= now:
            why = f"duration = {duration!r}: too short to change t = {now!r} s in float64"
            raise ArgumentError(why, id="duration-too-short")
        return end

    def _diverged(self, fault: Failure, held: float) -> DivergenceError:
        """Return the error of a step that failed; `held`: time for which the caller's torques are held [s], or 0."""
        (t, q, qd), run = self.state, self._run
        fixed = f"a smaller step than {run.fixed_step:g} s"
        advice = fault.advice or f"try {'another tolerance, or fixed steps' if run.controlled else fixed}"
        if held and run.unstable == "refuse":
            advice = held_torques_advice(held)
        problem, text = problem_of(self._scene, self.chain, tied=True), f"after t = {t:.6g} s: {fault.text}; {advice}"
        found = trajectory_from_states(problem, np.array([t]), q[None], qd[None])
        return fault.kind(f"{self.chain.name}: {text}", found, id=fault.id)
