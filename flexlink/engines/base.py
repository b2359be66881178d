"""The interface of an engine, and the code that the adapters share.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Units, signs and joint order are as in `flexlink.dynamics`; arrays are float64 of shape (n,). The tip wrench
(f_x, f_y, f_z, m_x, m_y, m_z) [N, N m] acts on the arm at the origin of the tip frame and is given in axes of frame 0.
"""

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.dynamics.forces import drag_torque
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines.read_back import ReadBack
from flexlink.kernels.inputs.drive_torque import drive_torque, sample_law
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.inputs.tip_wrench import put_given
from flexlink.motion.inputs.actuation import wrench_at
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.inputs.step_check import check_step
from flexlink.results.record import trajectory_from_states
from flexlink.results.stop_reasons import DivergenceError

Samples = tuple[Array, Array, Array]  # t of shape (samples,); q and q̇ of shape (samples, n)
Tied = tuple[Array, Array, Array]  # q̈ with ties (n,), their torques Jᵀ λ (n,), (r, 2) g or λ, ġ of exact and other rows


class Engine(Protocol):
    """A chain loaded into an engine by `flexlink.engines.load`."""

    name: str
    version: str
    n: int

    def mass_matrix(self, q: Array) -> Array:
        """Full symmetric M(q) with the armature on the diagonal, shape (n, n)."""

    def bias_torque(self, q: Array, qd: Array, *, tip_wrench: Array | None = None) -> Array:
        """T_GC = RNE(q, q̇, 0) − Jᵀ F, where RNE is the recursive Newton-Euler algorithm."""

    def gravity_torque(self, q: Array) -> Array:
        """T_G: T_GC with q̇ = 0 and no wrench."""

    def elastic_torque(self, q: Array) -> Array:
        """T_FL = K (θ − θ₀), including springs between joints."""

    def friction_torque(self, qd: Array) -> Array:
        """T_FR = D q̇ + c tanh(q̇ / w), including dampers between joints."""

    def forward_dynamics(self, q: Array, qd: Array, tau: Array, *, tip_wrench: Array | None = None) -> Array:
        """Return q̈ from the equation of motion."""

    def integrate(self, scene: Scene) -> Samples:
        """Run the scene with this engine's dynamics and the scene's method and fixed step.

        A DivergenceError has the samples before; methods, inputs and motions that an engine lacks, and unstable steps,
        are refused.
        """

    def read_back(self) -> ReadBack:
        """Return the arm's properties as this engine has read them."""


class FileEngine(Engine, Protocol):
    """An engine that has loaded a foreign file."""

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify."""

    def neutralize_settings(self) -> None:
        """Disable everything that acts in addition to gravity, springs and dampers."""


class ForeignFile(NamedTuple):
    """A file that flexlink did not write."""

    path: Path
    format: str  # "mjcf", "urdf" or "sdf"
    base: Array | None = None  # rotation of a floating base at zero angles; None: the scene's base is fixed


class DriveTorque:
    """The scene's drive as a function T_EX(t, q, q̇) of shape (n,); a zero-order hold is evaluated at mid-step."""

    def __init__(self, drive: Drive, n: int) -> None:
        self.middle: float | None = None
        self._drive, self._tau = drive, np.zeros(n)

    def begin(self, number: int, h: float, q: Array, qd: Array) -> None:
        """Begin the step from t = number · h in state q, q̇; evaluate a sampled controller at its sampling times."""
        self.middle = (number + 0.5) * h
        sample_law(self._drive, number * h, self.middle, q, qd, self._tau)

    def __call__(self, t: float, q: Array, qd: Array) -> Array:
        """Return T_EX; the next call overwrites the array."""
        drive_torque(self._drive, t, t if self.middle is None else self.middle, q, qd, self._tau)
        return self._tau


def drive_function(problem: InitialValueProblem) -> DriveTorque | None:
    """Return the drive as a function, or None if there is none."""
    drive = problem.inputs.drive
    return DriveTorque(drive, problem.chain.n) if len(drive.joints) else None


def drag_function(problem: InitialValueProblem) -> Callable[[Array, Array], Array] | None:
    """Return the drag of the scene's links as T_DRAG(q, q̇), computed by flexlink; None without drag."""
    chain = problem.chain
    return (lambda q, qd: drag_torque(chain, q, qd)) if len(chain.drag) else None


class TipWrench:
    """The scene's tip wrench as a function of time: force and moment (6,) in axes of frame 0 or of the tip."""

    def __init__(self, problem: InitialValueProblem) -> None:
        self.middle: float | None = None  # of the current step [s], as in `DriveTorque`
        self._loads = problem.inputs.changing
        self._now, frame = wrench_at(problem.inputs, problem.start)
        self.follows = frame == "tip"  # the engine rotates the wrench with its own kinematics
        self.constant = problem.scene.wrench.times is None

    def begin(self, number: int, h: float, q: Array, qd: Array) -> None:
        """Begin the step from t = number · h; the state is not used."""
        self.middle = (number + 0.5) * h

    def __call__(self, t: float) -> Array:
        """Return force and moment; the next call overwrites the array."""
        if self._loads is not None:
            put_given(self._loads, t, t if self.middle is None else self.middle, self._now)
        return self._now


def rotate_wrench(rotation: Array, wrench: Array) -> Array:
    """Rotate a force F and a moment M, together of shape (6,); return R F and R M."""
    return (wrench.reshape(2, 3) @ rotation.T).ravel()


def wrench_function(problem: InitialValueProblem) -> TipWrench | None:
    """Return the tip wrench as a function of time, or None if there is none."""
    return TipWrench(problem) if problem.scene.wrench.acts else None


def refuse_sampled_inputs(engine: str, scene: Scene) -> None:
    """Refuse inputs that engines with their own time stepping do not support; their runs always start at t = 0."""
    unsupported = [f"{name}.hold = True" for name in ("drive", "wrench") if getattr(scene, name).hold]
    unsupported += [] if scene.drive.rate is None else [f"drive.rate = {scene.drive.rate!r}"]
    if (course := scene.course) is not None and (scene.drive.kind != "pd" or course.jumps.size):
        unsupported.append("drive.reference with jumps in its derivatives")
    unsupported += [f"initial.time = {scene.initial.time!r}"] if scene.initial.time else []
    if unsupported:
        why = f"{unsupported[0]}: not supported by {engine}; use native, pinocchio or mujoco"
        raise ArgumentError(why, id="engine-does-not-support")


def refuse_method(engine: str, method: str, known: Collection[str]) -> None:
    """Refuse an integration method that the engine does not have."""
    if method not in known:
        why = f"method = {method!r}: {engine} supports only {' and '.join(map(repr, known))}; set run.method"
        raise ArgumentError(why, id="engine-method")


def refuse_held_joints(engine: str, chain: Chain) -> None:
    """Refuse a chain with prescribed motions for an engine that does not support them."""
    held = np.flatnonzero(chain.held)
    if len(held):
        why = f"the motion of joint {chain.joint_name(int(held[0]))!r} is prescribed, which {engine} does not support"
        remedy = "use native or pinocchio, or remove the motion from the scene"
        raise ArgumentError(f"{chain.name}: {why}; {remedy}", id="engine-does-not-support")


def fixed_steps_problem(scene: Scene, engine: str = "", *, tied: bool = False) -> InitialValueProblem:
    """Return the problem of a scene that engines, `tied` or not, also integrate; a named `engine` holds no joints."""
    problem = problem_of(scene, tied=tied)
    if unknown := problem.chain.forces.keys() - {"drag"}:
        why = f"{scene.name}: other engines do not support {', '.join(sorted(unknown))}; remove it from the scene"
        raise ArgumentError(why, id="arguments-not-counted")
    if not steps_explicitly(problem.run):
        method = scene.run.method
        why = f"method = {method!r}: other engines need fixed steps of an explicit method; set method and step"
        raise ArgumentError(why, id="engine-method")
    check_step(problem)
    if engine:
        refuse_held_joints(engine, problem.chain)
    return problem


def allocate_samples(problem: InitialValueProblem) -> Samples:
    """Allocate times and states of all samples; row 0 is the initial state, the other rows are uninitialized."""
    run = problem.run
    q, qd = np.empty((2, run.samples, problem.chain.n))
    q[0], qd[0] = problem.q, problem.qd
    return run.times_from(problem.start), q, qd


def divergence_error(engine: str, problem: InitialValueProblem, samples: Samples, row: int) -> DivergenceError:
    """Return the error of a run that diverged at sample `row`; the error contains all earlier samples."""
    time = f"t = {samples[0][row]:.6g} s"
    message = f"{problem.scene.name}: the state in {engine} is no longer finite at {time}; {row} samples were saved"
    return DivergenceError(message, trajectory_from_states(problem, *(array[:row].copy() for array in samples)))
