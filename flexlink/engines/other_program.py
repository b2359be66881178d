"""What adapters share: torques that a program lacks, and runs of the scene's method with its accelerations."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain, add_products
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.floating_base import ANGLES, FAR
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines import base
from flexlink.engines.coordinates import Coordinates
from flexlink.engines.read_back import COUPLED_FIELDS, of_matrices
from flexlink.formats.document import ROTATION_SPRINGS
from flexlink.kernels.forces.rotation_springs import excess_torque
from flexlink.kernels.inputs.drive_torque import follow


class OtherProgram(base.Engine):
    """An arm in another program, with the torques that it lacks: dry friction and springs between joints.

    Files describe them by flexlink's own elements. Rotation-vector springs act as angle springs in a program; `excess`
    is the rest of their torque.
    """

    title: str  # name in messages
    coordinates: Coordinates
    has_ties = False  # whether ties of a scene are held
    tied: Callable[[float, Array, Array, Array], base.Tied] | None = None  # what ties do at t, q, q̇, and q̈ without them
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
            wrench = base.rotate_wrench(self.tip_rotation(q), wrench)
        return self.forward_dynamics(q, qd, tau, tip_wrench=wrench)

    def run_in_steps(self, problem: InitialValueProblem) -> base.Samples:
        """Samples of a run with fixed steps; after a large rotation of the base the engine gets new coordinates."""
        samples = t, q, qd = base.allocate_samples(problem)
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


def _fill(engine: OtherProgram, problem: InitialValueProblem, samples: base.Samples) -> None:
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
                raise base.divergence_error(engine.name, problem, samples, row)


def _step_function(engine: OtherProgram, problem: InitialValueProblem) -> Callable[[int, Array], Array]:
    """Return a function that advances the state (q, q̇) from number · h to (number + 1) h."""
    n, h, wrench = problem.chain.n, problem.run.fixed_step, base.wrench_function(problem)
    A, b, c = method(problem.run.method).arrays
    drive, drag, motion = base.drive_function(problem), base.drag_function(problem), problem.inputs.motion
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
