"""Trajectory: what a simulation returns."""

from __future__ import annotations

import dataclasses
import functools
import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.analysis.loads import InternalLoads, internal_loads
from flexlink.chain.arguments import integer
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, MissingDependencyError
from flexlink.common.output import write_whole
from flexlink.describe.catalogue import given_path
from flexlink.describe.scene import Scene
from flexlink.dynamics.accelerations import forward_dynamics, solver_for
from flexlink.dynamics.batches import each
from flexlink.dynamics.terms import Energy
from flexlink.kernels.samples import drive_torques, tips_and_energies
from flexlink.motion import balance, tables
from flexlink.motion.actuation import Inputs, input_arrays
from flexlink.motion.columns import Columns
from flexlink.motion.saving import Writer, output_format

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


class Steps(NamedTuple):
    """How a run advanced."""

    method: str
    taken: int
    evaluations: int  # of forward or inverse dynamics
    rejected: int = 0  # steps that were taken again, shorter: their error was too large
    failed: int = 0  # … whose stages were not found
    why: str = ""  # of a method that was picked

    def __str__(self) -> str:
        again = f", {self.rejected} rejected, {self.failed} not solved" if self.rejected or self.failed else ""
        picked = f" ({self.why})" if self.why else ""
        return f"{self.method}{picked}: {self.taken} steps{again}, {self.evaluations} evaluations"


class State(NamedTuple):
    """Where an arm is: what a run is continued from."""

    t: float  # [s]
    q: Array  # (n,) [rad]
    qd: Array  # (n,) [rad/s]


@dataclasses.dataclass(frozen=True, eq=False)
class Trajectory:
    """Samples of a simulation.

    Attributes
    ----------
    chain
        The chain that moved.
    t
        Time of each sample [s], shape (samples,).
    q, qd
        Joint angles [rad] and rates [rad/s], shape (samples, n).
    tau
        Drive torques T_EX [N m], shape (samples, n): 0 on passive joints; where a motion is prescribed, what it takes.
    tip
        Position of the tip in frame 0 [m], shape (samples, 3).
    energy
        Kinetic, gravity and elastic energy [J], each of shape (samples,).
    work
        Work W done on the arm so far by drives, prescribed motions, tip wrench and friction [J], shape (samples,),
        integrated with the run's own method; None of a run of another engine.
    warnings
        What a reader of the result must know, such as that it was insisted on an unstable step.
    steps
        How the run advanced; None of a run of another engine.
    tip_wrench
        Force and moment that acted on the tip, frame 0, shape (samples, 6) [N, N m].
    scene
        The scene that ran, with the run's own settings: what a chain no longer knows, such as sections. Of a control
        law in Python it knows nothing.
    """

    chain: Chain
    t: Array
    q: Array
    qd: Array
    tau: Array
    tip: Array
    energy: Energy
    work: Array | None = None
    warnings: tuple[str, ...] = ()
    steps: Steps | None = None
    tip_wrench: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 6)))  # none: that of no run
    scene: Scene | None = None

    def __repr__(self) -> str:
        samples, (start, end) = len(self.t), self.t[[0, -1]] if len(self.t) else (0.0, 0.0)
        doubts = f"; {len(self.warnings)} warnings" if self.warnings else ""
        return (
            f"<Trajectory {self.chain.name!r}: {samples} samples, {start:g} … {end:g} s, {self.chain.n} joints{doubts}>"
        )

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, _read_only(getattr(self, field.name)))

    def __reduce__(self) -> tuple[type[Trajectory], tuple[object, ...]]:
        """Copies and pickles are built anew: their arrays, too, are read-only."""
        return Trajectory, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    @classmethod
    def from_states(cls, scene: Scene, chain: Chain, t: Array, q: Array, qd: Array) -> Trajectory:
        """Add tip, energies and drive torques to states that another engine's run of `scene` went through."""
        record = Record(scene, chain, input_arrays(scene, chain), t, q.copy(), qd.copy())
        record.derive(0, len(t))
        return record.trajectory(len(t), balanced=False)

    def state(self, k: int) -> State:
        """Time, joint angles and rates of sample `k`, −1 the last; `simulate(scene, q0=, qd0=, t0=)` goes on there.

        Raises
        ------
        ArgumentError
            There is no such sample.
        """
        k = integer("k", k, -len(self.t), len(self.t) - 1)
        return State(float(self.t[k]), self.q[k].copy(), self.qd[k].copy())

    @functools.cached_property
    def qdd(self) -> Array:
        """Joint accelerations at the samples [rad/s²], shape (samples, n), by `forward_dynamics` from q, q̇ and `tau`.

        Raises
        ------
        SingularMassError
            As in `forward_dynamics`.
        """
        hinges = self.chain.hinges.copy()
        hinges["prescribed"] = 0  # the torque that a prescribed motion has taken is in `tau`
        free = dataclasses.replace(self.chain, hinges=hinges)
        # state by state: what takes many at once takes seconds to compile, and the numbers are the same to the bit
        qdd = each(forward_dynamics, free, {"q": self.q, "qd": self.qd, "tau": self.tau}, tip_wrench=self.tip_wrench)
        return np.asarray(_read_only(qdd))

    @functools.cached_property
    def loads(self) -> InternalLoads:
        """`internal_loads` at the samples, each with a leading axis of samples, the run's own tip wrench counted.

        Raises
        ------
        SingularMassError
            As in `qdd`.
        """
        found = internal_loads(self.chain, self.q, self.qd, self.qdd, tip_wrench=self.tip_wrench)
        return InternalLoads(*map(_read_only, found))

    @property
    def imbalance(self) -> Array:
        """E(t) − E(0) − W(t) [J], shape (samples,): what the discretisation has done to the energy.

        Raises
        ------
        ArgumentError
            The run is another engine's, whose work is not known.
        """
        energy = np.array(self.energy)
        return balance.imbalance(energy, self._known_work, energy[:, 0])

    @property
    def exchanged(self) -> Array:
        """Energy exchanged up to each sample, the largest T + |ΔV_g| + |ΔV_e| + |W| [J]; errors as in `imbalance`."""
        energy = np.array(self.energy)
        return np.asarray(np.maximum.accumulate(balance.turned_over(energy, self._known_work, energy[:, 0])))

    @property
    def _known_work(self) -> Array:
        if self.work is None:
            raise ArgumentError("imbalance: known of flexlink's own runs only; other engines do not integrate work")
        return self.work

    @property
    def columns(self) -> Mapping[str, Array]:
        """Every sampled quantity as a column, shape (samples,), by its name with unit, in the order of the CSV file.

        "t [s]", then by the names of joints "q upper [rad]", "qd upper [rad/s]", of driven ones "tau upper [N m]", then
        "tip x [m]", "tip y [m]", "tip z [m]", "kinetic [J]", "gravity [J]", "elastic [J]", and, of flexlink's own runs,
        "work [J]", "imbalance [J]".
        """
        return Columns(self)

    def save(self, path: str | Path) -> Path:
        """Write an .npz archive (t, q, qd, tau, tip, energies, work, imbalance, joints, warnings) or a .csv table.

        Numbers are written so that they read back exactly. The file appears whole or not at all.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        OutputError
            It cannot be written.
        """
        path = given_path("path", path)
        write_whole(path, self.writer(path))
        return path

    def writer(self, path: Path) -> Writer:
        """The function that writes this trajectory in the format that the ending of `path` names.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        """
        return Writer(self, output_format(path))

    def to_pandas(self) -> Any:
        """All `columns` as a pandas.DataFrame, whose index is the time "t [s]".

        Raises
        ------
        MissingDependencyError
            pandas is not installed.
        """
        return tables.to_pandas(self)

    def to_xarray(self) -> Any:
        """All samples as an xarray.Dataset: q, qd, tau (time, joint), tip (time, axis), energies (time); with `units`.

        Raises
        ------
        MissingDependencyError
            xarray is not installed.
        """
        return tables.to_xarray(self)

    def plot(self) -> Figure:
        """Draw joint angles, tip and energy against time; needs matplotlib.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.
        """
        figure: Figure = plotting().plot_trajectory(self)
        return figure

    def animate(
        self,
        path: str | Path,
        *,
        magnify: float = 1.0,
        colour: Literal["moment", "strain"] = "moment",
        fps: float = 25.0,
        speed: float = 1.0,
        width: int = 640,
        progress: Callable[[float], None] | None = None,
    ) -> Path:
        """Draw the arm in motion, its links as wide as their sections, gravity downwards, with the path of its tip.

        Planar arms are seen across their plane, others from the side and above, with their shadow on a level floor. The
        payload is a ball of steel of its mass; joints and thin links are drawn no smaller than they can be seen.

        Parameters
        ----------
        path
            File, by its ending: .gif; .mp4, by the program ffmpeg; or .html, one page with a player, which needs
            neither a network nor matplotlib.
        magnify
            How many times as far hinges and gears are bent as they are; the picture says so.
        colour
            What colours the links: the size of the "moment" that bends them [N m], of `loads`, exact at hinges and
            joints and linear between, or the "strain" that it makes at their surface.
        fps
            Frames in a second of the film, at most as many as there are samples; a GIF lasts whole 1/100 s a frame.
        speed
            Seconds of the run in a second of the film.
        width
            Of the picture, in pixels, 320 to 3840.
        progress
            Called with the finished fraction, 0 to 1.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ArgumentError
            An argument is not allowed, the film would have too many frames, or the run does not know its scene.
        MissingDependencyError
            matplotlib is not installed, or ffmpeg for .mp4.
        EngineError
            ffmpeg failed.
        KeyboardInterrupt
            Ctrl-C or SIGTERM while it was drawn; nothing is written.
        OutputError
            The file cannot be written.
        SingularMassError
            As in `qdd`.
        """
        room = importlib.import_module("flexlink.pictures.animate")
        wanted = room.shot(path, magnify=magnify, colour=colour, fps=fps, speed=speed, width=width)
        drawn: Path = room.animate(self, wanted, progress)
        return drawn


def _read_only(value: Any) -> Any:
    """Arrays as views that cannot be written through, tuples of them likewise; everything else as it is."""
    if isinstance(value, np.ndarray):
        value = value.view()
        value.flags.writeable = False
    elif isinstance(value, Energy):
        value = Energy(*map(_read_only, value))
    return value


def plotting() -> ModuleType:
    """The module that draws, which needs matplotlib.

    Raises
    ------
    MissingDependencyError
        matplotlib is not installed.
    """
    try:
        return importlib.import_module("flexlink.motion.plotting")
    except ImportError:
        raise MissingDependencyError(
            "plotting needs matplotlib; install it with: python -m pip install 'flexlink[report]'"
        ) from None


class Record:
    """Samples of a run while it goes on: room for all, of which the first ones are filled.

    Attributes
    ----------
    q, qd, works
        States (samples, n) and the integrated work (samples,), without that of a constant tip
        force, which has a potential.
    origin
        Number of fixed steps from t = 0 to the start of the run.
    """

    def __init__(self, scene: Scene, chain: Chain, inputs: Inputs, t: Array, q: Array, qd: Array) -> None:
        self.scene, self.run, self.chain, self.t, self.q, self.qd = scene, scene.run, chain, t, q, qd
        self.tau, self.tip, self.energy = np.empty_like(q), np.empty((len(t), 3)), np.empty((3, len(t)))
        self.works = np.zeros(len(t))
        self.inputs = inputs
        self.origin = 0 if self.run.controlled else round(float(t[0]) / self.run.step)
        self.scratch = solver_for(chain, self.run.dynamics).workspace(chain.arrays)

    def derive(self, first: int, stop: int) -> None:
        """Tip, energies and drive torques of the samples first … stop − 1."""
        rows = slice(first, stop)
        t, q, qd = self.t[rows], self.q[rows], self.qd[rows]
        tips_and_energies(self.chain.arrays, q, qd, self.tip[rows], self.energy[:, rows])
        drive_torques(self.scratch, self.inputs, t, q, qd, self.tau[rows])

    def work(self, rows: slice) -> Array:
        """Work done up to these samples [J]: to the integrated one a constant force f adds f·(p − p(0)), p the tip."""
        return np.asarray(self.works[rows] + (self.tip[rows] - self.tip[0]) @ self.inputs.potential_force)

    def trajectory(
        self, stop: int, warnings: tuple[str, ...] = (), steps: Steps | None = None, balanced: bool = True
    ) -> Trajectory:
        """The samples before `stop`, read-only; this record must not go on."""
        work = self.work(slice(stop)) if balanced else None
        t, q, qd, tau, tip = (_kept(a, stop) for a in (self.t, self.q, self.qd, self.tau, self.tip))
        energy, wrench = Energy(*self.energy[:, :stop]), self.inputs.tip_wrenches(t, q, qd)
        return Trajectory(self.chain, t, q, qd, tau, tip, energy, work, warnings, steps, wrench, self.scene)


def _kept(array: Array, stop: int) -> Array:
    """The first rows, without holding the memory of the rest."""
    return array if stop == len(array) else array[:stop].copy()
