"""What an engine must answer, and what the adapters share.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Units, signs and order of the joints are those of `flexlink.dynamics`; arrays are float64 of shape (n,). The tip wrench
(f_x, f_y, f_z, m_x, m_y, m_z) [N, N m] acts on the arm at the origin of the tip frame, in axes of frame 0.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import ArgumentError
from flexlink.describe.conditions import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.engines.read_back import ReadBack
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.drives import drive_arrays
from flexlink.inputs.initial_state import initial_state
from flexlink.inputs.step_check import judge_step
from flexlink.inputs.tip_wrench import initial_wrench, wrench_table
from flexlink.kernels.inputs.drive_torque import drive_torque, sample_law
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.inputs.tip_wrench import put_given
from flexlink.results.record import trajectory_from_states
from flexlink.results.stop_reasons import DivergenceError

Array = NDArray[np.float64]
Samples = tuple[Array, Array, Array]
"""t (samples,), q and q̇ (samples, n)."""


class Engine(Protocol):
    """A chain loaded in one engine; made by `flexlink.engines.load`."""

    name: str
    version: str
    n: int

    def mass_matrix(self, q: Array) -> Array:
        """M(q), full and symmetric, armature on the diagonal, shape (n, n)."""

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC = RNE(q, q̇, 0) − Jᵀ F."""

    def gravity_torque(self, q: Array) -> Array:
        """T_G, T_GC with q̇ = 0 and no wrench."""

    def elastic_torque(self, q: Array) -> Array:
        """T_FL = k (θ − θ₀)."""

    def friction_torque(self, qd: Array) -> Array:
        """T_FR = d q̇ + c tanh(q̇ / w)."""

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """q̈ from the equation of motion."""

    def integrate(self, scene: Scene) -> Samples:
        """Run the scene with this engine's dynamics and its method at its fixed step.

        Raises
        ------
        DivergenceError
            The state left the finite numbers; the error holds the samples up to there.
        ArgumentError
            The engine does not have the scene's method or its prescribed motions, or the step is not stable.
        """


class File(NamedTuple):
    """A file that somebody else wrote."""

    path: Path
    form: str  # "mjcf", "urdf", "sdf"


@runtime_checkable
class Reader(Protocol):
    """An engine that tells what it has read of a file; those that read none have nothing to tell."""

    def read_back(self) -> ReadBack:
        """What the engine has read."""


class DriveTorque:
    """The scene's drive as a function T_EX(t, q, q̇), shape (n,).

    Attributes
    ----------
    middle
        Middle of the step that t belongs to [s], by which a torque that is held is sought; None: t itself.
    """

    def __init__(self, drive: Drive, n: int) -> None:
        self.middle: float | None = None
        self._drive, self._tau = drive, np.zeros(n)

    def begin(self, number: int, h: float, q: Array, qd: Array) -> None:
        """A step from t = number · h begins, of length h, in state q, q̇: at its instants a sampled law is asked."""
        self.middle = (number + 0.5) * h
        sample_law(self._drive, number * h, self.middle, q, qd, self._tau)

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """T_EX; the array is overwritten by the next call."""
        drive_torque(self._drive, t, t if self.middle is None else self.middle, q, qd, self._tau)
        return self._tau


def drive_function(scene: Scene) -> DriveTorque | None:
    """The scene's drive as a function, or None if it never pushes."""
    chain = lump(scene)
    drive = drive_arrays(scene, chain)
    return DriveTorque(drive, chain.n) if len(drive.joints) else None


class TipWrench:
    """The scene's tip wrench as a function of time, force and moment (6,) in axes of frame 0 or of the tip.

    Attributes
    ----------
    follows
        Its axes are those of the tip frame: the engine turns it, by its own kinematics.
    constant
        It is the same at all times.
    middle
        As in `DriveTorque`.
    """

    def __init__(self, scene: Scene) -> None:
        self.middle: float | None = None
        chain = lump(scene)
        self._table, (self._now, frame) = wrench_table(scene, chain), initial_wrench(scene, chain)
        self.follows = frame == "tip"
        self.constant = scene.wrench.times is None

    def begin(self, number: int, h: float, q: Array, qd: Array) -> None:
        """As of `DriveTorque`."""
        self.middle = (number + 0.5) * h

    def __call__(self, t: float) -> Array:
        """Force and moment; the array is overwritten by the next call."""
        if self._table is not None:
            put_given(self._table, t, t if self.middle is None else self.middle, self._now)
        return self._now


def turned(rotation: Array, wrench: Array) -> Array:
    """Force and moment (6,) in axes that `rotation` turns them into."""
    return (wrench.reshape(2, 3) @ rotation.T).ravel()


def wrench_function(scene: Scene) -> TipWrench | None:
    """The scene's tip wrench as a function of time, or None if it never acts."""
    return TipWrench(scene) if scene.wrench.acts else None


def refuse_held(engine: str, scene: Scene) -> None:
    """Of an engine whose steps we do not see one by one, or that starts at t = 0.

    Raises
    ------
    ArgumentError
        The drive or the tip wrench is held between times, or the run starts later.
    """
    held = [f"{name}.hold = True" for name in ("drive", "wrench") if getattr(scene, name).hold]
    held += [] if scene.drive.rate is None else [f"drive.rate = {scene.drive.rate!r}"]
    if (course := scene.course) is not None and (scene.drive.kind != "pd" or course.jumps.size):
        held.append("drive.reference, whose derivatives jump")
    for what in [*held, *([f"initial.time = {scene.initial.time!r}"] if scene.initial.time else [])]:
        raise ArgumentError(f"{what}: {engine} cannot follow it; use native, pinocchio or mujoco")


def refuse_methods(engine: str, method: str, known: Collection[str]) -> None:
    """Of an engine that has some Runge-Kutta methods of its own.

    Raises
    ------
    ArgumentError
        The method is none of the known ones.
    """
    if method not in known:
        names = " and ".join(map(repr, known))
        raise ArgumentError(f"method = {method!r}: of flexlink's explicit methods {engine} has only {names}")


def refuse_motion(engine: str, chain: Chain) -> None:
    """Of an engine that knows no prescribed motion.

    Raises
    ------
    ArgumentError
        The motion of one of the joints is prescribed.
    """
    prescribed = np.flatnonzero(chain.hinges["prescribed"])
    if len(prescribed):
        raise ArgumentError(
            f"{chain.name}: the motion of joint {chain.joint_name(int(prescribed[0]))!r} is prescribed, which {engine} "
            "does not know; use native or pinocchio, or take the motion out of the scene"
        )


def start(scene: Scene) -> Samples:
    """Times of all samples, and states of which only the first is filled.

    Raises
    ------
    ArgumentError
        The run has no fixed steps of an explicit method.
    UnstableStepError
        The step is past the largest stable one, and `run.unstable` does not allow it.
    """
    run, chain = scene.run, lump(scene)
    if not steps_explicitly(run):
        raise ArgumentError(f"method = {run.method!r}: other engines take fixed steps of an explicit method")
    q, qd = np.empty((2, run.samples, chain.n))
    q[0], qd[0] = initial_state(scene, chain)
    judge_step(scene, chain, q[0], qd[0], input_arrays(scene, chain))
    return run.times_from(scene.initial.time), q, qd


def diverged(engine: str, scene: Scene, samples: Samples, row: int) -> DivergenceError:
    """The error of a run whose sample `row` is the first that is not finite."""
    message = f"{scene.name}: {engine} is no longer finite at t = {samples[0][row]:.6g} s; {row} samples kept"
    chain = lump(scene)
    kept = (array[:row].copy() for array in samples)
    return DivergenceError(message, trajectory_from_states(scene, chain, input_arrays(scene, chain), *kept))
