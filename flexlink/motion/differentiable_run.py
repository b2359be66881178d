"""differentiable_run(scene, tau): a run under given torques, with exact gradients of any function of its samples."""

from __future__ import annotations

import dataclasses
from threading import Lock
from typing import Any

import numpy as np
from msgspec import NODEFAULT
from msgspec.structs import FieldInfo, fields, replace
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_type
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.interruption import deferred
from flexlink.common.memo import Kept, Memo
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.drive import Drive
from flexlink.describe.numbers import multiples, numbers
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import build_unchecked
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.result import Result
from flexlink.kernels.derivatives.adjoint import go_back
from flexlink.kernels.inputs.record import Drive as HeldDrive
from flexlink.kernels.layout import ChainArrays, Rare
from flexlink.kernels.tools.finite import is_finite
from flexlink.motion.inputs.actuation import drive_for
from flexlink.motion.inputs.drives import effort_of, held_torques
from flexlink.motion.inputs.problem import problem_of, started, started_from
from flexlink.motion.single_run import SingleRun
from flexlink.results.trajectory import Trajectory

SUPPORTED = {"name", "about", "arm", "initial", "gravity", "air_density", "drive", "wrench", "sensor", "run"}
"""Fields of a scene that the adjoint takes into account, or that do not act on the motion; it refuses all others."""
MANY = 20_000
"""Steps of one call of the compiled loop, between which Ctrl-C is noticed."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RunGradient(Result):
    """Gradient of a function J of a run's samples."""

    dtau: Array  # ∂J/∂tau, (m, d) [1/(N m)]; 0 for torques beyond `drive.effort`
    dq0: Array  # ∂J/∂q at the start, (n,) [1/rad]
    dqd0: Array  # ∂J/∂q̇ at the start, (n,) [s/rad]

    def __repr__(self) -> str:
        return f"<RunGradient: {' × '.join(map(str, self.dtau.shape))} torques>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class DifferentiableRun(Result):
    """A run under given torques, and the gradient of any function of its samples.

    Attributes
    ----------
    run
        The run, of m + 1 samples.
    tau
        The torques, shape (m, d) [N m].
    scene
        The scene as given.
    """

    run: Trajectory
    tau: Array
    scene: Scene

    def gradient(self, dq: ArrayLike | None = None, dqd: ArrayLike | None = None) -> RunGradient:
        """Gradient of a function J of the samples, by the discrete adjoint; takes two to four times as long as the run.

        Parameters
        ----------
        dq, dqd
            ∂J/∂q and ∂J/∂q̇ of every sample, shape (m + 1, n); None: 0.

        Returns
        -------
        RunGradient
            `dtau`, `dq0`, `dqd0`.

        Raises
        ------
        ArgumentError
            `dq` or `dqd` has the wrong shape, is not real or not finite.

        Examples
        --------
        >>> found = fl.differentiable_run(stepped, np.zeros((50, 2)))
        >>> dq = np.zeros_like(found.run.q)
        >>> dq[-1] = fl.jacobian(chain, found.run.q[-1]).linear[1]  # J: height of the tip at the end
        >>> print((1e3 * found.gradient(dq).dtau.sum(axis=0)).round(3))  # mm per N m, held for the whole run
        [ 0.03  -0.014]
        """
        shape = self.run.q.shape
        given = [
            np.zeros(shape) if each is None else matrix(name, each, shape) for name, each in (("dq", dq), ("dqd", dqd))
        ]
        dtau, (dq0, dqd0) = prepared(self.scene).back(self, np.array(given))
        return RunGradient(dtau, dq0 + given[0][0], dqd0 + given[1][0])

    def __repr__(self) -> str:
        return f"<DifferentiableRun of {self.run!r}>"


def differentiable_run(
    scene: Scene, tau: ArrayLike, *, q0: ArrayLike | None = None, qd0: ArrayLike | None = None
) -> DifferentiableRun:
    """A run under given torques, from which gradients of any function of its samples follow.

    The steps are those of `simulate` and `Simulator`, bit for bit, and the gradient is that of these steps, exact up to
    rounding, whatever the number of torques. For derivatives with respect to other parameters of a scene, or of runs
    with a tolerance, see `sensitivities`.

    Parameters
    ----------
    scene
        Arm, gravity, initial state, wrench, and run settings: fixed steps of an explicit method.
    tau
        Torques of the driven joints (`chain.active`) [N m], shape (m, d), which replace the scene's drive. Each row is
        held for `run.sample`; the run lasts m samples.
    q0, qd0
        Initial angles [rad] and rates [rad/s], shape (n,); None: as in `scene.initial`.

    Returns
    -------
    DifferentiableRun
        The `run`, and the method `gradient`.

    Raises
    ------
    ArgumentError
        `tau` has the wrong shape, is not real or not finite.
    SceneError
        The scene has a feature without gradient, or does not take fixed steps of an explicit method.
    UnstableStepError, DivergenceError, InterruptedRunError
        As in `simulate`.

    Examples
    --------
    >>> stepped = scene.varied({"run": fl.RunSettings(method="RK4", step=1e-4, sample=1e-3, duration=0.1)})
    >>> found = fl.differentiable_run(stepped, np.zeros((50, 2)))  # 50 × 2 torques, each held for 1 ms
    >>> print(found)
    <DifferentiableRun of <Trajectory 'two_links': 51 samples, 0 … 0.05 s, 6 joints>>
    >>> slopes = found.gradient(dq=2 * found.run.q)  # of J = Σ q²
    >>> print(slopes.dtau.shape, slopes.dq0.shape)
    (50, 2) (6,)
    """
    ready = prepared(require_type("scene", scene, Scene))
    given = numbers("tau", tau, f"real numbers, shape (m, {ready.d})")
    torques = matrix("tau", given, (max(1, len(given)) if given.ndim else 1, ready.d))
    return DifferentiableRun(ready.run(torques, q0, qd0), torques, scene)


def matrix(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return `value` as a finite float64 array of this shape, or refuse it."""
    array = numbers(name, value, f"real numbers, shape {shape}")
    if array.shape != shape:
        raise ArgumentError(f"{name} has shape {array.shape}; expected {shape}", id="wrong-shape")
    if not is_finite(array.reshape(-1)):
        at = tuple(np.argwhere(~np.isfinite(array))[0].tolist())
        raise ArgumentError(f"{name}{[*at]} = {array[at]} is not finite; expected finite numbers", id="not-finite")
    return array


class Prepared:
    """What all runs of a scene share; one thread at a time uses it."""

    def __init__(self, scene: Scene) -> None:
        refuse_without_gradient(scene)
        self.problem, self.kept, self.lock = problem_of(scene), Kept(), Lock()
        self.chain = chain = self.problem.chain
        if chain.shapes is not None:
            raise without_gradient(["link.modes"])
        self.d, self.effort = len(chain.active), effort_of(scene, chain)
        self.forward = self.problem.workspace()
        self.bare = solver_for(chain, "articulated").workspace(bare(chain))

    def run(self, tau: Array, q0: ArrayLike | None, qd0: ArrayLike | None) -> Trajectory:
        """The run under these torques; its scene has them as a table."""
        scene = started_from(self.problem.scene, q0, qd0, None)
        problem = self.problem if scene is self.problem.scene else started(self.problem, scene)
        drive, run = Drive(), build_unchecked(replace, scene.run, duration=len(tau) * scene.run.between)
        per_link = np.zeros((len(tau), len(self.chain.link_names)))
        per_link[:, [self.chain.coordinates[k].link - 1 for k in self.chain.active.tolist()]] = tau
        if self.d:
            times, rows = tuple(self.times(tau).tolist()), tuple(map(tuple, per_link.tolist()))
            table = {"kind": "table", "times": times, "torques": rows, "hold": True, "effort": scene.drive.effort}
            drive = build_unchecked(Drive, **table)
        scene = build_unchecked(replace, scene, drive=drive, run=run)
        inputs = self.problem.inputs._replace(drive=self.drive(tau))
        with self.lock, deferred() as stop:
            problem = dataclasses.replace(problem, scene=scene, inputs=inputs)
            return SingleRun(problem, kept=self.kept).finish(stop, compared=False)

    def times(self, tau: Array) -> Array:
        """Times from which the rows of torques act [s]."""
        return multiples(self.problem.start, self.problem.run.between, len(tau))

    def drive(self, tau: Array) -> HeldDrive:
        """The drive of these torques."""
        return drive_for(self.chain, held_torques(self.chain, self.times(tau), tau, self.effort))

    def back(self, found: DifferentiableRun, given: Array) -> tuple[Array, Array]:
        """∂J/∂tau (m, d), and the adjoint (2, n) of the initial state without the derivatives by the first sample."""
        run, tau, λ = self.problem.run, found.tau.copy(), np.zeros((2, self.chain.n))
        inputs, dtau = self.problem.inputs._replace(drive=self.drive(tau)), np.empty((len(tau), self.chain.n))
        every, samples = run.steps_per_sample, (found.run.q, found.run.qd)
        about = method(run.method).arrays, inputs, run.fixed_step, round(self.problem.start / run.fixed_step), every
        rows = max(1, MANY // every)
        with self.lock:
            for stop in range(len(tau), 0, -rows):
                part = max(0, stop - rows), stop
                go_back(self.forward, self.bare, self.chain.arrays, *about, part, samples, given, λ, dtau)
        return np.where(np.abs(tau) > self.effort, 0.0, dtau[:, self.chain.active]), λ


PREPARED = Memo(16)
"""What runs share, by scene."""


def prepared(scene: Scene) -> Prepared:
    """What all runs of the scene share."""
    return PREPARED(scene, None, lambda: Prepared(scene))


def refuse_without_gradient(scene: Scene) -> None:
    """Refuse what the adjoint does not take into account, and methods other than fixed explicit steps."""
    others = {f.encode_name: (getattr(scene, f.name), f) for f in fields(scene) if f.name not in SUPPORTED}
    found = [key for key, (value, f) in others.items() if value != default_of(f)]
    found += ["base.kind"] * scene.arm.base.free
    found += ["wrench.frame"] * (scene.wrench.acts and scene.wrench.frame == "tip")
    if found:
        raise without_gradient(found)
    if not steps_explicitly(scene.run):
        given = f"run.method = {scene.run.method!r}: gradients of runs need fixed steps of an explicit method"
        raise SceneError(f"{given}; give run.step and run.method = 'RK4'", id="gradient-needs-steps")


def default_of(field: FieldInfo) -> Any:
    """The default of a field."""
    return field.default if field.default_factory is NODEFAULT else field.default_factory()


def without_gradient(keys: list[str]) -> SceneError:
    """The error for keys of a scene that have no gradient."""
    text = f"{short_list(keys)}: gradients of runs do not support it; leave it out, or use sensitivities"
    return SceneError(text, id="gradient-not-supported")


def bare(chain: Chain) -> ChainArrays:
    """The chain without gravity, springs, friction and force elements: M q̈ = τ at rest."""
    arrays, hinges, bodies = chain.arrays, chain.hinges.copy(), chain.bodies.copy()
    for name in ("stiffness", "damping", "coulomb"):
        hinges[name] = 0.0
    bodies["springs"] = 0
    rare = None if arrays.rare is None else Rare(*(rows[:0].copy() for rows in arrays.rare))
    return ChainArrays(bodies, hinges, np.zeros(3), rare)
