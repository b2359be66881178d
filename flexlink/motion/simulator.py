"""Simulator: an arm that is stepped from outside, as by a controller or a learning agent."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import given, positive, vector
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.describe.methods import method, steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.situation import whole
from flexlink.kernels.runge_kutta import NEVER, integrate
from flexlink.kernels.samples import tips_and_energies
from flexlink.motion import balance
from flexlink.motion.actuation import held
from flexlink.motion.endings import DivergenceError
from flexlink.motion.result import State, Trajectory
from flexlink.motion.single import prepare, starting_from

Array = NDArray[np.float64]

OFTEN = 128
"""Calls of `step` from one look at the power balance to the next; of the first ones, those of number 1, 2, 4, …"""


class Simulator:
    """An arm that is stepped from outside: M q̈ + T_GC + T_FL + T_FR = T_EX, by the scene's method at its fixed step.

    The numbers are those of `simulate` with the same torques, to the bit. It judges itself as a run does: its step at
    `reset`, finite numbers at every call, and the power balance at some.

    Parameters
    ----------
    scene
        Arm, gravity, initial state, drive, wrench, and the method and step of its run.

    Attributes
    ----------
    chain
        The chain that moves.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, or its run has no fixed steps of an explicit method.
    SceneError, UnstableStepError
        As in `simulate`.

    Examples
    --------
    >>> arm = Simulator(scene)
    >>> while arm.time < 2.0:
    ...     t, q, qd = arm.state
    ...     arm.step(-50.0 * q[arm.chain.active] - 5.0 * qd[arm.chain.active], duration=1e-3)
    """

    def __init__(self, scene: Scene) -> None:
        run = given("scene", scene, Scene).run
        if not steps_explicitly(run):
            raise ArgumentError(f"method = {run.method!r}: a Simulator takes fixed steps of an explicit method")
        self._scene, self.chain = scene, lump(scene)
        self._tableau = method(run.method).arrays
        nothing = np.empty((0, self.chain.n))
        self._no_samples = nothing, nothing, np.empty(0)
        self._held = held(self.chain, np.zeros(1), np.zeros((1, len(self.chain.active))))
        self._steps: dict[float, int] = {}  # of durations that were asked for
        self.reset()

    def __repr__(self) -> str:
        return f"<Simulator {self.chain.name!r}: t = {self.time:g} s, {self.chain.n} joints>"

    def reset(self, q: ArrayLike | None = None, qd: ArrayLike | None = None, *, time: float | None = None) -> State:
        """Start again, from angles [rad] and rates [rad/s], shape (n,), at a time [s]; None: as the scene says.

        Raises
        ------
        SceneError
            A state of the wrong shape, or that is not finite; a time that is no multiple of the step.
        UnstableStepError
            The step is larger than the largest stable one there.
        """
        changes = starting_from(q, qd, time)
        scene = self._scene.varied(changes) if changes else self._scene
        record = prepare(scene.varied({"run.duration": scene.run.sample}), self.chain).record  # room for one sample
        self._record, self._origin, self._number, self._calls = record, record.origin, 0, 0
        self._state = record.q[0].copy(), record.qd[0].copy(), np.zeros(1)
        self._balance = balance.Balance(self.chain, record.energy[:, 0])
        integrate(*self._fixed(record.inputs), 0, 0, NEVER, self._state, self._no_samples)  # compiles
        return self.state

    @property
    def time(self) -> float:
        """Where the arm is in time [s]."""
        return (self._origin + self._number) * self._scene.run.step

    @property
    def state(self) -> State:
        """Time [s], angles [rad] and rates [rad/s], shape (n,); copies."""
        return State(self.time, self._state[0].copy(), self._state[1].copy())

    def step(self, tau: ArrayLike | None = None, *, duration: float | None = None) -> State:
        """Go on for a time, with torques that are held, and return the state at its end.

        Parameters
        ----------
        tau
            T_EX of the driven joints (`chain.active`) [N m], shape (d,), in place of the scene's drive; None: the
            scene's drive acts. Of a joint whose motion is prescribed it has no effect.
        duration
            How long [s], a multiple of the step; None: `run.sample`.

        Raises
        ------
        ArgumentError
            A torque of the wrong shape, or that is not finite; a duration that is no multiple of the step.
        DivergenceError
            The state left the finite numbers, or the energy does not balance; the simulator stays where it was before
            this call.
        """
        inputs, first = self._record.inputs, self._number
        if tau is not None:
            self._held.coefficients[0, 0] = vector("tau", tau, len(self.chain.active))
            inputs = inputs._replace(drive=self._held)
        last = first + self._steps_of(self._scene.run.sample if duration is None else duration)
        q, qd, done = self._state
        before = q.copy(), qd.copy(), done.copy()
        reached = integrate(*self._fixed(inputs), first, last, NEVER, self._state, self._no_samples)
        self._number, self._calls = last, self._calls + 1
        often = self._calls % OFTEN == 0 or self._calls & (self._calls - 1) == 0
        fault = "no longer finite" if reached < last else self._unbalanced() if often else ""
        if fault:
            self._state, self._number = before, first
            raise self._diverged(fault, reached)
        return self.state

    def _fixed(self, inputs: object) -> tuple[object, ...]:
        return self._record.scratch, self._tableau, inputs, self._scene.run.step, self._origin

    def _steps_of(self, duration: float) -> int:
        if duration not in self._steps:
            step = self._scene.run.step
            try:
                whole("duration", positive("duration", duration), "run.step", step)
            except SceneError as error:
                raise ArgumentError(str(error)) from None
            self._steps[duration] = round(duration / step)
        return self._steps[duration]

    def _unbalanced(self) -> str:
        """What is wrong with the energy, if anything is."""
        (q, qd, done), record = self._state, self._record
        tip, energy = np.empty((1, 3)), np.empty((3, 1))
        tips_and_energies(self.chain.arrays, q[None], qd[None], tip, energy)
        work = done + (tip - record.tip[0]) @ record.inputs.wrench[:3]
        judged = self._balance.judge(energy, work, q[None], self._number)
        if np.isfinite(judged.imbalance).all() and not judged.garbage.any():
            return ""
        return (
            f"the energy does not balance, E − E(0) − W = {judged.imbalance[0]:.3g} J with {judged.exchanged[0]:.3g} J "
            "exchanged"
        )

    def _diverged(self, fault: str, number: int) -> DivergenceError:
        (t, q, qd), h = self.state, self._scene.run.step
        at = (self._origin + number) * h
        return DivergenceError(
            f"{self.chain.name}: t = {at:.6g} s: {fault}; try a smaller step than {h:g} s",
            Trajectory.from_states(self._scene, self.chain, np.array([t]), q[None], qd[None]),
        )
