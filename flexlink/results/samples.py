"""Samples of a run, and quantities derived from them, whose modules are imported when a quantity is first used."""

from __future__ import annotations

import dataclasses
import functools
import operator
import warnings
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexlink.chain.arguments import integer
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, Diagnostic
from flexlink.common.types import Array, Indices
from flexlink.common.wording import did_you_mean, plural, short_list
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import column_names
from flexlink.dynamics.conserved import Energy, Momentum
from flexlink.dynamics.placement import tip_position
from flexlink.dynamics.result import Result, read_only
from flexlink.results import balance

if TYPE_CHECKING:
    from flexlink.dynamics.loads import InternalLoads
    from flexlink.dynamics.ties import Ties


class Steps(NamedTuple):
    """Method of a run, and its numbers of steps and evaluations."""

    method: str
    taken: int
    evaluations: int  # evaluations of forward or inverse dynamics
    rejected: int = 0  # steps repeated with a shorter length because their error was too large
    failed: int = 0  # Newton failures: steps repeated because the iteration did not converge
    why: str = ""  # reason for an automatically chosen method

    def __str__(self) -> str:
        again = f", {self.rejected} rejected, {self.failed} Newton failures" if self.rejected or self.failed else ""
        picked = f" ({self.why})" if self.why else ""
        return f"{self.method}{picked}: {self.taken} steps{again}, {self.evaluations} evaluations"


class State(NamedTuple):
    """State of an arm, from which a run can be continued."""

    t: float  # time [s]
    q: Array  # (n,) joint angles [rad]
    qd: Array  # (n,) joint rates [rad/s]


class StatedError(NamedTuple):
    """Estimated error of a run, what it may be, and what the error of a run that continues it depends on."""

    tip: Array  # (samples,) of the tip, the largest of all tips [m]
    allowed: float  # tolerance of the run [m]
    compared: bool  # whether it is the distance to another run, or estimated from the errors of the steps
    outputs: Mapping[str, Array]  # of what is read besides the tip, by name with unit, (samples,)
    start: State  # of the motion, which may have begun in an earlier run
    travelled: float  # angle travelled by all free joints since then [rad]
    drifting: float  # sum of the estimated errors of rates that last [m/s]; the displacement by these [m]
    drifted: float
    end: State | None = None  # where the run ended with which this one was compared
    delayed: Array | None = None  # torques on their way then, as in `Trajectory.delayed`

    def __str__(self) -> str:
        """The largest error, whether the tolerance is kept, and how the error was found."""
        error = float(self.tip.max())
        verdict = "kept" if error <= self.allowed else f"exceeded {error / self.allowed:.2g}-fold; take a smaller one"
        found = "by a second run" if self.compared else "from the errors of the steps"
        return f"tip error {error:.2g} m, {found}; tolerance {self.allowed:.2g} m, {verdict}"


@dataclasses.dataclass(frozen=True, eq=False)
class BaseMotion(Result):
    """Attitude and angular velocity of a free base, and momentum of all bodies, at every sample.

    Position and velocity of the base are the first three coordinates.
    """

    attitude: Array  # (samples, 4) unit quaternions w, x, y, z: v_0 = R v
    spin: Array  # (samples, 3) angular velocity, in axes of the base [rad/s]
    _momentum: Momentum | Callable[[], Momentum] = dataclasses.field(repr=False)

    @functools.cached_property
    def momentum(self) -> Momentum:
        """Momentum of all bodies, computed when it is first used."""
        return self._momentum() if callable(self._momentum) else self._momentum

    def __reduce__(self) -> tuple[Any, ...]:
        return BaseMotion, (self.attitude, self.spin, self.momentum)


@dataclasses.dataclass(frozen=True, eq=False)
class RunSamples(Result):
    """Read-only samples of a run, and quantities derived from them; `Trajectory` documents the attributes."""

    chain: Chain
    t: Array
    q: Array
    qd: Array
    drive_torques: Array
    tip: Array
    energy: Energy
    work: Array | None = None
    warnings: tuple[Diagnostic, ...] = ()
    steps: Steps | None = None
    tip_wrench: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 6)))  # empty: not from a run
    scene: Scene | None = None
    base: BaseMotion | None = None
    delayed: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 1)))
    stated: StatedError | None = None

    def __str__(self) -> str:
        """The run, and its stated error if it has one."""
        return repr(self) if self.stated is None else f"{self!r}\n{self.stated}"

    def __repr__(self) -> str:
        samples, (start, end) = len(self.t), self.t[[0, -1]] if len(self.t) else (0.0, 0.0)
        doubts = f"; {plural(len(self.warnings), 'warning')}" if self.warnings else ""
        doubts += f"; {plural(len(self.hints), 'hint')} on units" if self.hints else ""
        size = f"{plural(samples, 'sample')}, {start:g} … {end:g} s, {plural(self.chain.n, 'joint')}"
        return f"<Trajectory {self.chain.name!r}: {size}{doubts}>"

    @property
    def error(self) -> Array | None:
        """Estimated error of the tip at the samples [m], (samples,); of several tips the largest. None: fixed steps.

        It is caused by the steps alone: how close the chain is to the beam is another question. Where steps may hide
        errors, or motion may amplify them, it is the distance to a second run by a method of another order; elsewhere
        it is estimated from the errors of the steps, and at least half a tolerance.
        """
        return None if self.stated is None else self.stated.tip

    @property
    def errors(self) -> Mapping[str, Array]:
        """Estimated errors of the scene's sensors and `run.outputs`, (samples,), by name with unit."""
        return {} if self.stated is None else self.stated.outputs

    @property
    def kept(self) -> bool | None:
        """Whether the estimated error of the tip is within the tolerance at all samples; None for fixed steps."""
        return None if self.stated is None else bool(self.stated.tip.max(initial=0.0) <= self.stated.allowed)

    def warn_of_vibrations(self, what: str = "accelerations, loads and sensors", output: str = "loads") -> None:
        """Warn if what is read may lack vibrations, since steps were controlled for the tip alone."""
        scene, springs = self.scene, bool((self.chain.hinges["stiffness"] > 0).any())
        if self.stated is not None and scene is not None and springs and not scene.run.follows_vibrations(scene.sensor):
            text = f"{what} of this run may lack vibrations that do not move the tip; for these, run the scene with "
            text += f'run.outputs = ["{output}"] (accuracy = "auto")'
            warnings.warn(Diagnostic(text, id="vibrations-not-followed"), RuntimeWarning, stacklevel=4)

    @property
    def momentum_error(self) -> tuple[float, float] | None:
        """Largest errors of linear momentum [N s] and angular momentum about the centre of mass [N m s] of a free base.

        From the first sample on, linear momentum must change by m g t, and angular momentum must be constant. The
        result is None if a wrench acts, if a tie holds a point in frame 0, or if the base is fixed.
        """
        held = self.scene is not None and any(not tie.on_joint and tie.to.link is None for tie in self.scene.ties)
        if self.base is None or held or self.tip_wrench.any() or not len(self.t):
            return None
        momentum, weight = self.base.momentum, self.chain.mass * self.chain.gravity
        fallen = np.multiply.outer(self.t - self.t[0], weight)
        parts = momentum.linear - momentum.linear[0] - fallen, momentum.spin - momentum.spin[0]
        linear, angular = (float(np.linalg.norm(part, axis=1).max()) for part in parts)
        return linear, angular

    @functools.cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes on defaults that the run used, settings without effect, and sensors that need more samples."""
        from flexlink.dynamics.notes import defaults, notes  # noqa: PLC0415
        from flexlink.dynamics.sensors.instrument import coarse_samples  # noqa: PLC0415

        if self.scene is None:
            return ()
        return (*defaults(self.scene), *notes(self.scene), *coarse_samples(self.scene, self))

    @functools.cached_property
    def hints(self) -> tuple[str, ...]:
        """Numbers in the scene that were likely given in a wrong unit, one line each with the likely unit."""
        from flexlink.describe.plausibility.hints import hints  # noqa: PLC0415

        return () if self.scene is None else hints(self.scene)

    def state(self, k: int) -> State:
        """Time, joint angles and rates at sample `k` (−1: last), from which `simulate(…, q0=, qd0=, t0=)` continues.

        Raises
        ------
        ArgumentError
            There is no such sample.
        """
        k = integer("k", k, -len(self.t), len(self.t) - 1)
        return State(float(self.t[k]), self.q[k].copy(), self.qd[k].copy())

    def tip_of(self, link: str | int) -> Array:
        """Position in frame 0 of the tip of a link without child links, at the samples [m], shape (samples, 3).

        The attribute `tip` is the position of the last link's tip.

        Raises
        ------
        ArgumentError
            There is no such link, or other links are attached to it.
        """
        return read_only(tip_position(self.chain, self.q, tip=link))

    @functools.cached_property
    def tau(self) -> Array:
        """Drive torques [N m], (samples, n); with a RuntimeWarning as for `qdd` if they react to vibrations."""
        if (scene := self.scene) and (scene.motion or (scene.drive.controls and scene.drive.rate is None)):
            self.warn_of_vibrations("torques", "torques")
        return self.drive_torques

    @functools.cached_property
    def qdd(self) -> Array:
        """Joint accelerations at the samples [rad/s²], shape (samples, n): `forward_dynamics` of q, q̇ and `tau`.

        If the steps did not follow the vibrations that accelerations and loads contain, there is a RuntimeWarning. With
        `run.outputs = ["loads"]` they do, and `errors` states how accurately.

        Raises
        ------
        SingularMassError
            As in `forward_dynamics`.
        """
        self.warn_of_vibrations()
        return self.accelerations()

    def accelerations(self) -> Array:
        """As `qdd`, without its warning."""
        return self._untied() if self._ties is None else self._tied[0]

    def _untied(self) -> Array:
        """Accelerations of the chain without its ties."""
        from flexlink.dynamics.accelerations import accelerations_under  # noqa: PLC0415

        return read_only(accelerations_under(self.drive_torques, self.chain, self.q, self.qd, self.tip_wrench))

    @functools.cached_property
    def _ties(self) -> Ties | None:
        if self.scene is None or not self.scene.ties:
            return None
        from flexlink.dynamics.ties import tie_rows  # noqa: PLC0415  few scenes have ties

        return tie_rows(self.scene, self.chain)

    @functools.cached_property
    def _tied(self) -> tuple[Array, Array]:
        """Accelerations (samples, n), and multipliers of all rows of ties (samples, r)."""
        from flexlink.dynamics.accelerations import released  # noqa: PLC0415
        from flexlink.dynamics.tied_motion import tied_motion  # noqa: PLC0415

        assert self._ties is not None
        return tied_motion(self._ties, released(self.chain), self.t, self.q, self.qd, self._untied())

    @functools.cached_property
    def tie_forces(self) -> Mapping[str, Array]:
        """Force of each tie at the samples, by its name: positive where it pulls, shape (samples,) [N].

        For ties on a joint it is the torque [N m] or force that pulls the coordinate down. Ties that hold a point in
        several directions give the force on the point of the link, in axes of `to`, shape (samples, 3).
        """
        if self.scene is None or self._ties is None:
            return {}
        from flexlink.dynamics.tied_motion import tie_forces  # noqa: PLC0415

        self.warn_of_vibrations()
        return tie_forces(self.scene, self._ties, self._tied[1])

    @functools.cached_property
    def pressures(self) -> Mapping[str, Array]:
        """Pressures [Pa] above that of the air on the bore side and the rod side of each cylinder, (samples, 2)."""
        if self.scene is None or self._ties is None:
            return {}
        from flexlink.dynamics.tied_motion import pressures  # noqa: PLC0415

        return pressures(self.scene, self._ties, self.chain, self.t, self.q)

    @functools.cached_property
    def loads(self) -> InternalLoads:
        """`internal_loads` at the samples, with a leading axis of samples; includes the run's own tip wrench.

        Raises
        ------
        SingularMassError
            As in `qdd`.
        """
        from flexlink.dynamics.loads import internal_loads  # noqa: PLC0415

        if self._ties is not None:
            from flexlink.dynamics.tied_motion import tied_loads  # noqa: PLC0415

            motion = self.q, self.qd, self.qdd
            return tied_loads(self._ties, self.chain, motion, self.tip_wrench, self._tied[1])
        return internal_loads(self.chain, self.q, self.qd, self.qdd, tip_wrench=self.tip_wrench)

    @property
    def sensor_names(self) -> tuple[str, ...]:
        """Names with units of the columns of the scene's sensors."""
        return () if self.scene is None else column_names(self.scene.sensor, self.scene.arm)

    @functools.cached_property
    def readings(self) -> Mapping[str, Array]:
        """Sensor readings at the samples, each of shape (samples,), by sensor name with unit.

        Delays and low-pass filters act on the signals at the samples, with linear interpolation between them.

        Raises
        ------
        SceneError
            A sensor is attached to a body that is fixed in frame 0.
        SingularMassError
            For accelerometers, as in `qdd`.
        """
        from flexlink.dynamics.sensors.instrument import sensor_columns  # noqa: PLC0415

        if self.scene is None:
            return {}
        if self.scene.sensor:
            self.warn_of_vibrations()
        return {name: read_only(column) for name, column in sensor_columns(self.scene, self).items()}

    @property
    def imbalance(self) -> Array:
        """E(t) − E(0) − W(t) [J], shape (samples,): the energy error of the discretisation.

        Raises
        ------
        ArgumentError
            The run is from another engine, so its work is unknown.
        """
        energy = self.energy.parts
        return balance.imbalance(energy, self._known_work, energy[:, 0])

    @property
    def exchanged(self) -> Array:
        """Energy exchanged up to each sample, the largest T + |ΔV_g| + |ΔV_e| + |W| [J]; errors as in `imbalance`."""
        energy = self.energy.parts
        return np.asarray(np.maximum.accumulate(balance.turned_over(energy, self._known_work, energy[:, 0])))

    @property
    def _known_work(self) -> Array:
        if self.work is None:
            text = "imbalance: only for runs of flexlink's own engine; other engines do not integrate work"
            raise ArgumentError(text, id="engine-does-not-support")
        return self.work


Source = Callable[[Any], Array]
"""Function that computes a column from `RunSamples`, or from an object with the same fields and a last axis of runs."""


class Columns(Mapping[str, Array]):
    """Every sampled quantity of a run as an array (samples,), by its name with unit."""

    def __init__(self, run: RunSamples) -> None:
        self._run, self._sources = run, dict(sources_of(run.chain, run.work is not None))
        self._sources |= {name: lambda run, of=name: run.readings[of] for name in run.sensor_names}  # type: ignore[misc]

    def __reduce__(self) -> tuple[type[Columns], tuple[RunSamples]]:
        return Columns, (self._run,)

    def __repr__(self) -> str:
        return f"<Columns of {self._run!r}: {', '.join(map(repr, self))}>"

    def __getitem__(self, name: str) -> Array:
        if name not in self._sources:
            known = did_you_mean(name, self._sources) or f"; allowed are {short_list([*self])}"
            raise KeyError(f"no column {name!r}{known}")
        return self._sources[name](self._run)

    def __iter__(self) -> Iterator[str]:
        return iter(self._sources)

    def __len__(self) -> int:
        return len(self._sources)


def sources_of(chain: Chain, balanced: bool = True) -> Mapping[str, Source]:
    """Source of each column of runs of a chain, in the order of the CSV file; `balanced`: with work and imbalance."""
    units, active = (chain.joint_units, chain.torque_units), tuple(chain.active.tolist())
    return _sources(chain.joint_names, units, active, balanced, chain.has_free_base)


@functools.lru_cache(maxsize=64)
def _sources(
    joints: tuple[str, ...], units: tuple[tuple[str, ...], tuple[str, ...]], active: tuple[int, ...], balanced: bool,
    floats: bool,
) -> Mapping[str, Source]:  # fmt: skip
    """Source of each column, in the order of the CSV file; runs of one layout share it."""
    balances = ("work", "imbalance") if balanced else ()  # other engines do not integrate work
    # attitude as a unit quaternion, angular velocity in axes of the base, momentum of all bodies in frame 0
    of_base = {
        "attitude {} [1]": ("wxyz", "base.attitude"), "spin {} [rad/s]": ("xyz", "base.spin"),
        "momentum {} [N s]": ("xyz", "base.momentum.linear"),
        "angular momentum {} [N m s]": ("xyz", "base.momentum.angular"),
    } if floats else {}  # fmt: skip
    return {
        "t [s]": _of("t"),
        **{f"q {name} [{units[0][k]}]": _of("q", k) for k, name in enumerate(joints)},
        **{f"qd {name} [{units[0][k]}/s]": _of("qd", k) for k, name in enumerate(joints)},
        **{f"tau {joints[k]} [{units[1][k]}]": _of("tau", k) for k in active},
        **{f"tip {axis} [m]": _of("tip", k) for k, axis in enumerate("xyz")},
        **{f"{name} [J]": _of(f"energy.{name}") for name in ("kinetic", "gravity", "elastic")},
        **{f"{name} [J]": _of(name) for name in balances},
        **{name.format(axis): _of(place, k) for name, (axes, place) in of_base.items() for k, axis in enumerate(axes)},
    }


def _of(place: str, k: int | None = None) -> Source:
    """Source of an array (samples,), or of column `k` of an array (samples, …), at this place in the run."""
    get = operator.attrgetter(place)
    return (lambda run: np.asarray(get(run))) if k is None else (lambda run: np.asarray(get(run)[:, k]))


def picked(run: RunSamples, rows: Indices) -> RunSamples:
    """The run with only these samples, without its work."""
    parts = {name: getattr(run, name)[rows] for name in ("t", "q", "qd", "drive_torques", "tip", "tip_wrench")}
    return dataclasses.replace(run, **parts, energy=Energy(*run.energy.parts[:, rows]), work=None, stated=None)
