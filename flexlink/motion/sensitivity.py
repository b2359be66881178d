"""sensitivities(scene, parameters): how a run changes with numbers of its scene, forward mode along its own steps."""

from __future__ import annotations

import dataclasses

import numpy as np

from flexlink.chain.arguments import require_type, sequence
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.drag import refuse_drag
from flexlink.dynamics.floating_base import ANGLES
from flexlink.dynamics.placement import jacobian
from flexlink.dynamics.result import Result
from flexlink.kernels.derivatives.sensitivity import integrate_derivatives, tip_derivatives
from flexlink.motion.column_slopes import column_slope
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.parameters import parametric
from flexlink.motion.simulate import simulate
from flexlink.results.stop_reasons import DivergenceError
from flexlink.results.trajectory import Trajectory

MOST = np.pi / 3
"""Angle about Y of a free base [rad] up to which its coordinates are differentiated: their rates are then twice the
angular velocity, at most."""


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result):
    """A run, and its derivatives along p numbers of the scene, each in units of the quantity per unit of the number.

    Attributes
    ----------
    run
        The run itself.
    parameters
        Paths of the numbers.
    values
        The numbers, shape (p,).
    q, qd
        ∂q/∂p and ∂q̇/∂p at the samples, shape (samples, n, p) [rad, rad/s per unit].
    tip
        ∂tip/∂p in frame 0, shape (samples, 3, p) [m per unit].
    """

    run: Trajectory
    parameters: tuple[str, ...]
    values: Array
    q: Array
    qd: Array
    tip: Array

    def column(self, name: str) -> Array:
        """∂y/∂p of a column of the run, such as what a sensor shows, shape (samples, p) [its unit per unit].

        By differences of the column, of states that move as they do along p; noise and resolution of sensors are left
        out.

        Raises
        ------
        ArgumentError
            There is no such column, or its slope is not known: works and the imbalance are integrals.

        Examples
        --------
        >>> gauge = fl.Sensor(name="gauge", kind="strain", link="upper", x=0.1, fibre=(0.025, 0.0))
        >>> falling = scene.varied({"drive": fl.Drive(), "run.duration": 0.1, "sensor": (gauge,)})
        >>> slopes = fl.sensitivities(falling, ["tip.mass"])
        >>> print((1e6 * slopes.column("gauge [1]")[0]).round(1))  # µm/m per kg
        [42.]
        """
        given = zip(self.parameters, self.values.tolist(), strict=True)
        found = [
            column_slope(self.run, path, value, name, self.q[..., p], self.qd[..., p])
            for p, (path, value) in enumerate(given)
        ]
        return np.column_stack(found)

    def __repr__(self) -> str:
        return f"<Sensitivities of {self.run!r} to {', '.join(self.parameters)}>"


def sensitivities(scene: Scene, parameters: object) -> Sensitivities:
    """How a run changes with numbers of its scene: exact derivatives of the numbers that its fixed steps give.

    Every stage of every step is differentiated, δq̈ = ∂q̈/∂q δq + ∂q̈/∂q̇ δq̇ + M⁻¹ (δT_EX − δ(M q̈ + T_GC + T_FL + T_FR)),
    the feedback of a PD drive and a start bent by gravity counted; no difference of runs, no step size to choose. Off
    by rounding, which a sensitive motion multiplies, and by how well the chain's numbers are differentiated, 1e-12.

    Parameters
    ----------
    scene
        The scene; fixed steps of an explicit method, a drive of kind none, constant, table or pd.
    parameters
        Paths of numbers, as in `Scene.varied`: "material.aluminium.young", "link.upper.damping.ratio", "tip.mass",
        "drive.kp.upper", "initial.joint_deg.upper", "link.fore.length" …; `*` for several that are equal.

    Returns
    -------
    Sensitivities
        The run, and ∂q/∂p, ∂q̇/∂p, ∂tip/∂p at its samples.

    Raises
    ------
    ArgumentError
        There is no such number, or none that a run depends on smoothly; steps that follow from an error; a drive or
        wrench whose derivative is not known.
    SceneError, UnstableStepError, DivergenceError, InterruptedRunError
        As in `simulate`; a DivergenceError, too, where a derivative leaves the finite numbers.

    Examples
    --------
    >>> falling = scene.varied({"drive": fl.Drive(), "run.duration": 0.2})
    >>> slopes = fl.sensitivities(falling, ["tip.mass", "material.aluminium.young"])
    >>> print((1e3 * slopes.tip[-1, 1, 0]).round(2))  # mm of the tip's height per kg
    -0.97
    """
    problem = problem_of(require_type("scene", scene, Scene))
    run, chain = problem.run, problem.chain
    paths = sequence("parameters", parameters, "path, such as 'tip.mass'")
    if not paths:
        raise ArgumentError("parameters = (): empty; name at least one path")
    if not problem.explicit:
        raise ArgumentError(
            f"run.method = {run.method!r}: sensitivities need fixed steps of an explicit method; give run.step, such "
            "as 1e-4, and run.method = 'RK4'"
        )
    refuse_drag("derivatives of runs", chain)
    trajectory = simulate(scene)
    _check_base(trajectory)
    varied, (δq, δqd) = parametric(scene, chain, paths)
    _check_drive(scene, trajectory, varied.drive)
    found = np.empty((2, len(trajectory.t), chain.n, len(paths)))
    origin = round(problem.start / run.fixed_step)  # steps from t = 0 to the start
    state = trajectory.q[0].copy(), trajectory.qd[0].copy()
    slopes = δq.ravel().copy(), δqd.ravel().copy()
    fixed = problem.workspace(), method(run.method).arrays, problem.inputs, varied, run.fixed_step
    every = run.steps_per_sample
    found[0, 0], found[1, 0] = δq, δqd
    for row in range(1, len(trajectory.t)):
        first = origin + (row - 1) * every
        if not integrate_derivatives(*fixed, first, first + every, state, slopes):
            raise DivergenceError(
                f"{chain.name}: a derivative overflows at t = {trajectory.t[row]:.6g} s; shorten the run, or take "
                "smaller steps",
                trajectory,
            )
        found[0, row], found[1, row] = slopes[0].reshape(δq.shape), slopes[1].reshape(δq.shape)
    tip = [
        jacobian(chain, q).linear @ by_p + tip_derivatives(varied, q)
        for q, by_p in zip(trajectory.q.copy(), found[0], strict=True)
    ]
    values = np.array([float(scene.values_at(path)[0]) for path in paths])
    return Sensitivities(trajectory, tuple(paths), values, found[0], found[1], np.array(tip))


def _check_base(run: Trajectory) -> None:
    """A free base stays where its angles from the start, which are differentiated, are far from 90° about Y."""
    if run.base is not None and (most := float(np.abs(run.q[:, ANGLES][:, 1]).max())) > MOST:
        raise ArgumentError(
            f"{run.chain.name}: the free base turns to base.ry = {np.degrees(most):.0f}° from where it starts; "
            f"sensitivities go up to {np.degrees(MOST):.0f}°; shorten the run"
        )


def _check_drive(scene: Scene, run: Trajectory, drive: Array) -> None:
    """The run took the torques that are differentiated, u + v q + w q̇; those of a table hang on no parameter."""
    close = 1e-12  # Of the parts of a drive's torque: a few roundings of each
    if scene.drive.kind == "table":
        return
    parts = np.array([np.broadcast_to(drive[0], run.q.shape), drive[1] * run.q, drive[2] * run.qd])
    other = np.abs(parts.sum(axis=0) - run.tau) > close * np.abs(parts).sum(axis=0)
    other[:, run.chain.hinges["prescribed"] != 0] = False
    if other.any():
        raise ArgumentError(
            f"drive.kind = {scene.drive.kind!r}: the run's torques differ from those that sensitivities differentiate"
        )
