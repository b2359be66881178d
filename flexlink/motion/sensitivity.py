"""sensitivities(scene, parameters): derivatives of a run with respect to parameters of its scene."""

from __future__ import annotations

import dataclasses

from flexlink.chain.arguments import require_type, sequence
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.describe.scene import Scene
from flexlink.dynamics.result import Result
from flexlink.motion.slopes_of_runs import RunSlopes, slopes_of_runs
from flexlink.results.trajectory import Trajectory


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Sensitivities(Result):
    """A run and its derivatives with respect to p parameters of the scene, per unit of each parameter."""

    run: Trajectory
    parameters: tuple[str, ...]  # their paths
    values: Array  # of the parameters, (p,)
    q: Array  # ∂q/∂p and ∂q̇/∂p at the samples, (samples, n, p) [rad, rad/s per unit]
    qd: Array
    tip: Array  # ∂tip/∂p in frame 0, (samples, 3, p) [m per unit]
    q_error: Array  # estimated largest error of these derivatives for each parameter, (p,), in the same units
    qd_error: Array
    tip_error: Array
    step: Array  # in each parameter between the runs whose differences are taken, (p,)
    runs: RunSlopes  # the runs whose differences are taken

    def column(self, name: str) -> Array:
        """∂y/∂p of a column of the run, such as a sensor reading, shape (samples, p) [its unit per unit].

        Noise and resolution of sensors are ignored.

        Raises
        ------
        ArgumentError
            There is no such column, or it is the time or the imbalance, which have no derivative.

        Examples
        --------
        >>> gauge = fl.Sensor(name="gauge", kind="strain", link="upper", x=0.1, fibre=(0.025, 0.0))
        >>> falling = scene.varied({"drive": fl.Drive(), "run.duration": 0.1, "sensor": (gauge,)})
        >>> slopes = fl.sensitivities(falling, ["tip.mass"])
        >>> print((1e6 * slopes.column("gauge [1]")[0]).round(1))  # µm/m per kg
        [42.]
        """
        return self._column(name)[0]

    def column_error(self, name: str) -> Array:
        """Estimated largest error of `column` for each parameter, shape (p,) [its unit per unit].

        Examples
        --------
        >>> falling = scene.varied({"drive": fl.Drive(), "run.duration": 0.1})
        >>> slopes = fl.sensitivities(falling, ["tip.mass"])
        >>> print(slopes.column_error("kinetic [J]") < 1e-6 * abs(slopes.column("kinetic [J]")).max())
        [ True]
        """
        return self._column(name)[1]

    def _column(self, name: str) -> tuple[Array, Array]:
        known = [name for name in self.run.columns if name not in {"t [s]", "imbalance [J]"}]
        if name not in known:
            allowed = f"allowed are {short_list(known)}{did_you_mean(name, known)}"
            raise ArgumentError(f"name = {truncated(name)}: no column with a derivative; {allowed}", id="unknown-name")
        return self.runs.of(lambda run: run.columns[name])

    def __repr__(self) -> str:
        return f"<Sensitivities of {self.run!r} to {', '.join(self.parameters)}>"


def sensitivities(scene: Scene, parameters: object) -> Sensitivities:
    """Derivatives of a run with respect to parameters of its scene, by differences between runs, with error estimates.

    Three additional runs per parameter, side by side, give derivatives with a third-order error. The parameter changes
    by 1e-5 of its value (1e-5 if it is 0), in one direction only if it is at its bound. The error estimate is the
    difference from a derivative of lower order. If it exceeds 3e-6 of the largest derivative, other changes are tried,
    with five runs. With fixed steps the error is 1e-7 to 1e-9 of the largest derivative. With a tolerance it is 1e-5;
    the compared runs then have a relative tolerance of 1e-9. Errors are larger where the motion is so sensitive that
    rounding errors grow. Errors of the run's own steps are not included. For derivatives by many torques see
    `run_gradient`.

    Parameters
    ----------
    scene
        The scene.
    parameters
        Paths of parameters, as in `Scene.varied`: "material.aluminium.young", "link.upper.damping.ratio", "tip.mass",
        "drive.kp.upper", "initial.joint_deg.upper", "link.fore.length" …; `*` selects several of equal value.

    Returns
    -------
    Sensitivities
        The run, and ∂q/∂p, ∂q̇/∂p, ∂tip/∂p at its samples, with their errors.

    Raises
    ------
    ArgumentError
        There is no such parameter, it is a run setting, or the scene does not run on either side of its value.
    SceneError, UnstableStepError, DivergenceError, InterruptedRunError
        As in `simulate`.

    Examples
    --------
    >>> falling = scene.varied({"drive": fl.Drive(), "run.duration": 0.2})
    >>> slopes = fl.sensitivities(falling, ["tip.mass", "material.aluminium.young"])
    >>> print((1e3 * slopes.tip[-1, 1, 0]).round(2))  # mm of tip height per kg
    -0.97
    """
    if not (paths := sequence("parameters", parameters, "path, such as 'tip.mass'")):
        raise ArgumentError("parameters = (): empty; name at least one path", id="empty")
    found = slopes_of_runs(require_type("scene", scene, Scene), paths)
    (q, of_q), (qd, of_qd), (tip, of_tip) = found.states()
    return Sensitivities(found.run, tuple(paths), found.values, q, qd, tip, of_q, of_qd, of_tip, found.step, found)
