"""run_gradient(run, dq, dqd): gradient of any function of a run's samples with respect to torques and initial state."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from msgspec import NODEFAULT
from msgspec.structs import fields
from numpy.typing import ArrayLike

from flexlink.chain.arguments import real_array, require_type
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.run_settings import steps_explicitly
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.result import Result
from flexlink.dynamics.terms import mass_matrix
from flexlink.kernels.bodies.rne import rne_workspace
from flexlink.kernels.derivatives.adjoint import adjoint_workspace, go_back
from flexlink.kernels.derivatives.implicit_adjoint import go_back_implicitly
from flexlink.kernels.derivatives.load_gradient import load_gradient_workspace
from flexlink.kernels.derivatives.planar_load_gradient import planar_load_gradient_workspace
from flexlink.kernels.inputs.laws import TABLE
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.layout import ChainArrays, Rare
from flexlink.kernels.stepping.step_state import COUNT
from flexlink.kernels.tools.finite import is_finite
from flexlink.motion.inputs.actuation import LINEAR, input_arrays, of_kind
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.method_steps import MethodSteps
from flexlink.motion.step_workspace import friction_laws
from flexlink.results.record import Record
from flexlink.results.trajectory import Trajectory

SUPPORTED = {
    "name", "about", "arm", "initial", "gravity", "air_density", "drive", "wrench", "sensor", "run", "uncertain",
}  # fmt: skip
"""Fields of a scene that the gradient takes into account, or that do not act on the motion; all others are refused."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class RunGradient(Result):
    """Gradient of a function J of the samples of a run."""

    dtau: Array  # ∂J/∂T_EX, (samples − 1, d) [1/(N m)]; row k: torques held from sample k to sample k + 1
    dq: Array  # ∂J/∂q of the initial state, (n,) [1/rad]
    dqd: Array  # ∂J/∂q̇ of the initial state, (n,) [s/rad]

    def __repr__(self) -> str:
        return f"<RunGradient: {' × '.join(map(str, self.dtau.shape))} torques>"


def run_gradient(run: Trajectory, dq: ArrayLike | None = None, dqd: ArrayLike | None = None) -> RunGradient:
    """Gradient of a function J of a run's samples with respect to all drive torques and the initial state.

    It is the gradient of the steps themselves, by the adjoint of each step from the last to the first: exact up to
    rounding, and of implicit steps up to the residual of their iteration, 1e-13 of the arm's size. That takes one to
    five times as long as the run, whatever the number of torques. For other parameters or runs, see `sensitivities`.

    Parameters
    ----------
    run
        A run with fixed steps, without a drive or with torques that are given in time, up to `drive.effort`.
    dq, dqd
        ∂J/∂q and ∂J/∂q̇ of every sample, shape (samples, n); None: 0.

    Returns
    -------
    RunGradient
        `dtau`, `dq`, `dqd`: ∂J/∂T_EX of torques held from sample to sample, and ∂J/∂q and ∂J/∂q̇ at the start.

    Raises
    ------
    ArgumentError
        `dq` or `dqd` has the wrong shape, is not real or not finite; or the steps cannot be repeated, since a law in
        Python or another machine made the run.
    SceneError
        The scene has a feature without gradient, takes adaptive steps, or an implicit step's adjoint is not found.

    Examples
    --------
    >>> steps = fl.RunSettings(method="RK4", step=1e-4, sample=1e-3, duration=0.05)
    >>> falling = fl.simulate(scene.varied({"drive": fl.Drive(), "run": steps}))
    >>> dq = np.zeros_like(falling.q)
    >>> dq[-1] = fl.jacobian(chain, falling.q[-1]).linear[1]  # J: height of the tip at the end
    >>> print((1e3 * fl.run_gradient(falling, dq).dtau.sum(axis=0)).round(3))  # mm per N m, held for the whole run
    [0.124 0.082]
    """
    scene = require_type("run.scene", require_type("run", run, Trajectory).scene, Scene)
    chain = of_kind(scene, run.chain)
    inputs = input_arrays(scene, chain)
    refuse_without_gradient(scene, chain, inputs.drive)
    given = np.array([_slopes("dq", dq, run.q.shape), _slopes("dqd", dqd, run.q.shape)])
    size = int(np.frexp(np.abs(given).max(initial=0.0))[1])  # a power of two, so that no product over- or underflows
    given = np.ldexp(given, -size)
    h, every, λ, dtau = scene.run.fixed_step, scene.run.steps_per_sample, given[:, -1].copy(), np.empty_like(run.q[1:])
    work, samples = workspace_for(scene, chain), ((run.q, run.qd), given, λ, dtau)
    if steps_explicitly(scene.run):
        steps = method(scene.run.method).arrays, inputs, h, round(float(run.t[0]) / h), every
        row = go_back(work, *steps, *samples)
    else:
        weights = np.diag(mass_matrix(chain, run.q[-1])).copy()
        row = go_back_implicitly(work, weights, *_implicit_steps(run, problem_of(scene, chain, inputs)), *samples)
    if row < -1:
        why = f"run.step = {h!r}: the adjoint of a step after t = {run.t[-2 - row]:.6g} s does not converge"
        raise SceneError(f"{why}; give a smaller run.step", id="gradient-not-found")
    if row >= 0:
        why = f"run: sample {row + 1} does not follow from its scene; a law in Python or another machine made it"
        raise ArgumentError(f"{why}; repeat it by simulate(run.scene)", id="run-not-repeatable")
    with np.errstate(over="ignore"):
        found = [np.ldexp(part, size) for part in (dtau[:, chain.active], *λ)]
    if not all(np.isfinite(part).all() for part in found):
        raise ArgumentError("dq, dqd: the gradient overflows float64; give smaller ones", id="overflow")
    return RunGradient(*found)


def _implicit_steps(run: Trajectory, problem: InitialValueProblem) -> tuple[object, ...]:
    """Implicit steps, number of laws of friction, room for steps, knots up to each sample, times of samples."""
    steps = MethodSteps(Record(problem, run.t, run.q.copy(), run.qd.copy()), by_drive=True, halved=False, passes=True)
    starts = problem.run.fixed_step * (steps.record.origin + problem.run.steps_per_sample * np.arange(len(run.t)))
    steps.aim(*starts[[0, -1]].tolist())
    steps.count[COUNT.row] = len(run.t)  # no step writes a sample
    passed = np.searchsorted(steps.knots[0], starts, "right")
    every, between = problem.run.steps_per_sample, int(np.diff(passed).max(initial=0))
    divided = max(0, (run.steps.taken if run.steps else 0) - every * (len(run.t) - 1))  # beyond those planned
    most = 2 * (every + between) + divided + 1000
    return steps.arguments(1), len(friction_laws(steps.work)), most, passed, starts


def _slopes(name: str, value: ArrayLike | None, shape: tuple[int, ...]) -> Array:
    """∂J/∂q or ∂J/∂q̇ as a finite array of this shape, or refuse it."""
    slopes = np.zeros(shape) if value is None else real_array(name, value, shape)
    if slopes.shape != shape:
        raise ArgumentError(f"{name} has shape {slopes.shape}; expected {shape}, as of run.q", id="wrong-shape")
    if not is_finite(slopes.reshape(-1)):
        at = np.argwhere(~np.isfinite(slopes))[0].tolist()
        raise ArgumentError(f"{name}{at} is not finite; expected finite numbers", id="not-finite")
    return slopes


def workspace_for(scene: Scene, chain: Chain) -> object:
    """Scratch of `go_back`, with a copy of the chain that has no gravity, springs, friction and force elements."""
    arrays, hinges, bodies = chain.arrays, chain.hinges.copy(), chain.bodies.copy()
    for name in ("stiffness", "damping", "coulomb"):
        hinges[name] = 0.0
    bodies["springs"] = 0
    rare = None if arrays.rare is None else Rare(*(rows[:0].copy() for rows in arrays.rare))
    free = ChainArrays(bodies, hinges, np.zeros(3), rare)
    bare = solver_for(chain, "articulated").workspace(free)
    loads = planar_load_gradient_workspace(bare) if chain.is_planar else load_gradient_workspace(arrays)
    forward = solver_for(chain, scene.run.solver).workspace(arrays)
    if not steps_explicitly(scene.run):
        bare = free, bare if chain.is_planar else rne_workspace(free)
    return adjoint_workspace(arrays, forward, bare, loads, method(scene.run.method).stages)


def refuse_without_gradient(scene: Scene, chain: Chain, drive: Drive) -> None:
    """Refuse what the gradient does not take into account, and adaptive steps."""
    if found := [*_without_gradient(scene, chain, drive)]:
        text = f"{short_list(found)}: gradients of runs do not support it; leave it out, or use sensitivities"
        raise SceneError(text, id="gradient-not-supported")
    if scene.run.controlled:
        given = f"run.method = {scene.run.method!r}: gradients of runs need fixed steps"
        raise SceneError(f"{given}; give run.step and run.method = 'RK4'", id="gradient-needs-steps")


def _without_gradient(scene: Scene, chain: Chain, drive: Drive) -> Iterator[str]:
    """Keys of a scene that have no gradient."""
    for field in fields(scene):
        default = field.default if field.default_factory is NODEFAULT else field.default_factory()
        if field.name not in SUPPORTED and getattr(scene, field.name) != default:
            yield field.encode_name
    if drive.rate or drive.law != TABLE:
        yield f"drive.kind = {scene.drive.kind!r}"
    table = drive.feedforward.coefficients  # of a cubic spline, values between knots may exceed those at knots
    if ((np.abs(table[:, 0]) > drive.effort) | (np.isfinite(drive.effort) & (table.shape[1] > LINEAR))).any():
        yield "drive.effort"
    if scene.wrench.acts and scene.wrench.frame == "tip":
        yield "wrench.frame = 'tip'"
    if scene.arm.base.free:
        yield "base.kind = 'free'"
    if chain.shapes is not None:
        yield "link.modes"
