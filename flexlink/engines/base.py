"""The interface of an engine, and the code that the adapters share.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Units, signs and joint order are as in `flexlink.dynamics`; arrays are float64 of shape (n,). The tip wrench
(f_x, f_y, f_z, m_x, m_y, m_z) [N, N m] acts on the arm at the origin of the tip frame and is given in axes of frame 0.
"""

import functools
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain, add_products
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.floating_base import ANGLES, FAR
from flexlink.dynamics.forces import drag_torque
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines.coordinates import Coordinates
from flexlink.engines.read_back import COUPLED_FIELDS, ReadBack, of_matrices
from flexlink.formats.document import ROTATION_SPRINGS
from flexlink.kernels.forces.rotation_springs import excess_torque
from flexlink.kernels.inputs.drive_torque import drive_torque, follow, sample_law
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


def evaluated(method: Any) -> Any:
    """The method of an engine, with its signature, that hands its name and its arguments to `_evaluate`."""

    @functools.wraps(method)
    def call(engine: Any, *arguments: Any, **named: Any) -> Any:
        return engine._evaluate(method.__name__, *arguments, **named)

    return call


class Delegate:
    """An engine that has `_evaluate`, by which others evaluate its terms."""

    mass_matrix = evaluated(Engine.mass_matrix)
    bias_torque = evaluated(Engine.bias_torque)
    gravity_torque = evaluated(Engine.gravity_torque)
    elastic_torque = evaluated(Engine.elastic_torque)
    friction_torque = evaluated(Engine.friction_torque)
    forward_dynamics = evaluated(Engine.forward_dynamics)


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


# What adapters share: torques that a program lacks, and runs of the scene's method with its accelerations.


class OtherProgram(Engine):
    """An arm in another program, with the torques that it lacks: dry friction and springs between joints.

    Files describe them by flexlink's own elements. Rotation-vector springs act as angle springs in a program; `excess`
    is the rest of their torque.
    """

    title: str  # name in messages
    coordinates: Coordinates
    has_ties = False  # whether ties of a scene are held
    tied: Callable[[float, Array, Array, Array], Tied] | None = None  # what ties do at t, q, q̇, and q̈ without them
    coulomb: Array
    coulomb_width: Array
    couplings: NDArray[np.void]
    excess: Callable[[Array], Array] | None = None

    def fill_missing(self, fields: Mapping[str, Array]) -> None:
        """Set the fields of `ReadBack` that the file does not specify."""
        for field in fields.keys() & vars(self).keys():
            setattr(self, field, np.array(fields[field]))
        if COUPLED_FIELDS.keys() <= fields.keys():
            self.couplings = of_matrices(fields)

    def neutralize_settings(self) -> None:
        """Do nothing: most programs have no settings that act at a given state."""

    def gravity_torque(self, q: Array) -> Array:
        """Return T_G: T_GC with zero rates."""
        return self.bias_torque(q, np.zeros(self.n))

    def tip_rotation(self, q: Array) -> Array:
        """Return the rotation from the tip frame into frame 0, for a wrench that follows the tip."""
        raise NotImplementedError

    def accelerations(
        self, q: Array, qd: Array, tau: Array, wrench: Array | None, *, follows: bool, held: Array
    ) -> Array:
        """Return q̈, `held` at joints with a given motion; the wrench is in axes of the tip if it `follows`."""
        if follows and wrench is not None:
            wrench = rotate_wrench(self.tip_rotation(q), wrench)
        return self.forward_dynamics(q, qd, tau, tip_wrench=wrench)

    def run_in_steps(self, problem: InitialValueProblem) -> Samples:
        """Samples of a run with fixed steps; after a large rotation of the base the engine gets new coordinates."""
        samples = t, q, qd = allocate_samples(problem)
        theirs = self.coordinates
        reference = theirs.reference
        try:
            _fill(self, problem, samples)
        finally:
            theirs.reference = reference
        return samples if problem.base is None else (t, *problem.base.from_the_start(q, qd)[:2])

    def _friction(self, qd: Array) -> Array:
        return np.asarray(self.coulomb * np.tanh(qd / self.coulomb_width))

    def _between(self, field: str, φ: Array) -> Array:
        """Torques Σ_j K_ij φ_j of springs, or Σ_j D_ij φ_j of dampers between joints, by `field` of `COUPLING`."""
        total = np.zeros(len(φ))
        add_products(total, self.couplings, self.couplings[field], φ)
        return total

    def _beyond(self, q: Array) -> Array | float:
        """Torque of rotation-vector springs minus the torque of angle springs."""
        return 0.0 if self.excess is None else self.excess(q)


def excess_of(chain: Chain, read: Callable[[], Chain]) -> Callable[[Array], Array] | None:
    """Return a function that maps angles (n,) to extra torques (n,) of the file's chain; None without such springs."""
    if not chain.has_rotation_springs:
        return None
    loaded = read()
    return lambda q: np.array(excess_torque(loaded.bodies, loaded.hinges, loaded.couplings, np.array(q)))


def cannot_load(engine: str, what: str, reason: object) -> ArgumentError:
    """Return the error of a program that refuses an arm or a file."""
    return ArgumentError(f"{engine} cannot load {what}: {reason}", id="engine-cannot-load")


def refuse_in_files(engine: str, path: Path) -> None:
    """Refuse a file with rotation-vector springs, which only chains built by flexlink support."""
    if ROTATION_SPRINGS.encode() in path.read_bytes():
        why = f"the file has rotation-vector springs, which {engine} would read as springs of angles"
        remedy = "compare the scene itself, or export it with a rule of springs = 'angles'"
        raise ArgumentError(f"{why}; {remedy}", id="rotation-springs-in-file")


def _fill(engine: OtherProgram, problem: InitialValueProblem, samples: Samples) -> None:
    """Compute all samples except the first."""
    run, n, step = problem.run, problem.chain.n, _step_function(engine, problem)
    (t, q, qd), floating, every = samples, problem.base, run.steps_per_sample
    first_step = round(problem.start / run.fixed_step)
    y = np.concatenate([q[0], qd[0]])
    with np.errstate(all="ignore"):  # divergence raises an error below
        for row in range(1, len(t)):
            for number in range((row - 1) * every, row * every):
                y = step(first_step + number, y)
                if number + 1 == row * every:
                    q[row], qd[row] = y[:n], y[n:]
                if floating is not None and np.abs(y[ANGLES]).max() > FAR:
                    floating.turn((number + 1) // every + 1, y[:n], y[n:])
                    engine.coordinates.reference = np.array(problem.chain.bodies["rotation"][1])
            if not np.isfinite(y).all():
                raise divergence_error(engine.name, problem, samples, row)


def _step_function(engine: OtherProgram, problem: InitialValueProblem) -> Callable[[int, Array], Array]:
    """Return a function that advances the state (q, q̇) from number · h to (number + 1) h."""
    n, h, wrench = problem.chain.n, problem.run.fixed_step, wrench_function(problem)
    A, b, c = method(problem.run.method).arrays
    drive, drag, motion = drive_function(problem), drag_function(problem), problem.inputs.motion
    F, no_torque, held = np.empty((len(c), 2 * n)), np.zeros(n), np.zeros(n)
    follows, led = wrench is not None and wrench.follows, bool(len(motion.joints))
    stages, whole = [(float(c[i]), h * A[i, :i], F[:i], F[i, :n], F[i, n:]) for i in range(len(c))], h * b

    def step(number: int, y: Array) -> Array:
        for function in (drive, wrench):
            if function is not None:
                function.begin(number, h, y[:n], y[n:])
        for at, weights, before, rates, changes in stages:
            t, x = (number + at) * h, y + weights @ before
            q, qd = x[:n], x[n:]
            if led:
                follow(motion, t, q, qd, held)
            tau = no_torque if drive is None else drive(t, q, qd)
            if drag is not None:
                tau = tau - drag(q, qd)
            rates[:] = qd
            force = None if wrench is None else wrench(t)
            changes[:] = engine.accelerations(q, qd, tau, force, follows=follows, held=held)
            if engine.tied is not None:
                changes[:] = engine.tied(t, q, qd, changes)[0]
        y = y + whole @ F
        if led:
            follow(motion, (number + 1) * h, y[:n], y[n:], held)
        return y

    return step
