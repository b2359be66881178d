"""Trajectory: the result of a simulation."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import explained, positive, real, vector
from flexlink.common.errors import ArgumentError, imported
from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.output import write_whole
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.data.documents import require_path
from flexlink.describe.numbers import within
from flexlink.dynamics.placement import unbent
from flexlink.kernels.geometry.kinematics import tip_points
from flexlink.results.samples import Columns, RunSamples
from flexlink.results.tip_motion import centre_of_motion, distances, largest_distance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Trajectory(RunSamples):
    """Read-only samples of a simulation, with methods to save, tabulate, plot and animate them.

    Attributes
    ----------
    chain
        The chain that moved.
    t
        Time of each sample [s], shape (samples,).
    q, qd
        Joint angles [rad] and rates [rad/s], shape (samples, n).
    tau
        Drive torques T_EX [N m], shape (samples, n): 0 on passive joints; on prescribed joints the required torque.
    tip
        Position of the tip in frame 0 [m], shape (samples, 3).
    energy
        Kinetic, gravity and elastic energy [J], each of shape (samples,).
    work
        Work W done on the arm up to each sample by drives, prescribed motions, tip wrench and friction [J], shape
        (samples,), integrated with the run's method; None for a run of another engine.
    warnings
        Warnings about the result, each a string with a stable `id`, such as "unstable-step".
    steps
        Method and step counts; None for a run of another engine.
    tip_wrench
        Force and moment that acted on the tip, frame 0, shape (samples, 6) [N, N m].
    scene
        The simulated scene with the settings of the run. It contains data that the chain does not, such as sections,
        but not a control law in Python.
    base
        Attitude and angular velocity of a free base; None if it is fixed. The base's coordinates in q are its position
        in frame 0 [m] and angles [rad] about X, Y, Z relative to its initial attitude. Near 90° about Y the rates of
        these angles grow without bound, but `base` remains exact.
    delayed
        Torques that a sampled law with a delay computed before the last sample and that act at it or later, shape
        (m, 1 + d): time from which each acts [s], then the torques of the driven joints [N m]. A run that is continued
        by `simulate(…, after=run)` begins with them. Rows of a cascade drive continue with its memory: the integral,
        the torque before the filters and the states of the filters of each joint.
    stated
        The estimated error and the tolerance; None for fixed steps and for a run of another engine.

    Examples
    --------
    >>> run
    <Trajectory 'two_links': 101 samples, 0 … 1 s, 6 joints>
    >>> print(run.steps)
    RK4: 5000 steps, 20000 evaluations
    >>> print(np.degrees(run.q[-1, chain.active]).round(1))  # °
    [ 60. -60.]
    >>> height = run.columns["tip y [m]"]
    >>> t, q, qd = run.state(-1)
    """

    @property
    def columns(self) -> Mapping[str, Array]:
        """Every sampled quantity as a column, shape (samples,), by its name with unit, in the order of the CSV file.

        They are "t [s]", then "q upper [rad]" and "qd upper [rad/s]" for each joint, by name, "tau upper [N m]" for
        driven joints (sliding joints: m, m/s and N), "tip x [m]", "tip y [m]", "tip z [m]", "kinetic [J]",
        "gravity [J]" and "elastic [J]". Runs of flexlink itself add "work [J]" and "imbalance [J]". A free base adds
        "attitude w [1]" to "attitude z [1]", "spin x [rad/s]" in axes of the base, "momentum x [N s]" and
        "angular momentum x [N m s]". The readings of the scene's sensors come last, under their names.
        """
        return Columns(self)

    def save(self, path: str | Path) -> Path:
        """Write an .npz archive, which `load` restores bit for bit, a .csv table of `columns`, or a file for others.

        An .nc file is the Dataset of `to_xarray` in HDF5 (netCDF-4). A .mat file is for MATLAB: matrices of the same
        names, and `columns`, (samples, names), with their `names`.

        The archive contains t, q, qd, tau, tip, kinetic, gravity, elastic, work, imbalance, tip_wrench, joints,
        warnings, warning_ids, steps, delayed, scene (TOML), chain_…, error_… and motion_… with a tolerance, and, if the
        scene has sensors, sensors (their names) and readings. Numbers in the table have enough digits to be read back
        exactly. A file is written completely or not at all.

        Raises
        ------
        ArgumentError
            The name does not end in .npz, .csv, .nc or .mat.
        OutputError
            The file cannot be written.
        MissingDependencyError
            An .nc file needs xarray and h5netcdf.

        Examples
        --------
        >>> archive = run.save("move.npz")  # or a table, "move.csv"
        >>> print(np.array_equal(fl.Trajectory.load(archive).q, run.q))
        True
        """
        path = require_path("path", path)
        write_whole(path, self.writer(path))
        return path

    def writer(self, path: Path) -> Callable[[Path], None]:
        """Return the function that writes this trajectory in the format given by the extension of `path`.

        Raises
        ------
        ArgumentError
            The extension is unknown.
        """
        from flexlink.results.files import TRAJECTORY, ending, write  # noqa: PLC0415

        format = ending(path, *TRAJECTORY)
        return lambda place: write(self, format, place)

    def to_pandas(self) -> Any:
        """All `columns` as a pandas.DataFrame with the time "t [s]" as its index.

        Raises
        ------
        MissingDependencyError
            pandas is not installed.

        Examples
        --------
        >>> table = run.to_pandas()
        >>> print(table["tip y [m]"].max().round(3), table.index.name)
        0.884 t [s]
        """
        pandas = imported("pandas", "a run as a table of pandas needs pandas;", "tables")
        return pandas.DataFrame(dict(self.columns)).set_index("t [s]")

    def to_xarray(self) -> Any:
        """All samples as an xarray.Dataset: q, qd, tau (time, joint), tip (time, axis), energies (time), with units.

        If the scene has sensors, it also contains their readings (time, sensor).

        Raises
        ------
        MissingDependencyError
            xarray is not installed.

        Examples
        --------
        >>> data = run.to_xarray()
        >>> print(data["tip"].dims, data["tip"].attrs["units"])
        ('time', 'axis') m
        """
        from flexlink.results.files import to_xarray  # noqa: PLC0415

        return to_xarray(self)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run from an .npz archive that `save` has written, with its chain and scene.

        Parameters
        ----------
        path
            The archive.

        Returns
        -------
        Trajectory
            Identical to the saved one bit for bit, with all its properties.

        Raises
        ------
        ArgumentError
            `path` is not a path, or does not end in .npz.
        DataFileError
            The file is missing, or is not a run of this version of flexlink: its arrays have other types or shapes,
            numbers are not finite, or the parts of its chain are inconsistent.

        Examples
        --------
        >>> again = fl.Trajectory.load(run.save("move.npz"))
        >>> print(again, np.array_equal(again.tip, run.tip))
        <Trajectory 'two_links': 101 samples, 0 … 1 s, 6 joints> True
        """
        from flexlink.results.files import stored_run  # noqa: PLC0415

        return stored_run(path, cls)

    def settling_time(self, *, target: ArrayLike, tolerance: float, after: float = 0.0) -> float:
        """Time after which the tip stays within a tolerance of its target to the end of the run.

        Samples should be ten or more per period of the vibration.

        Parameters
        ----------
        target
            Rest position of the tip in frame 0, shape (3,) [m], `fl.tip_position(chain, rest.q)` with
            `rest = fl.solve_static(…)`.
        tolerance
            Largest distance from the target that counts as settled, > 0 [m].
        after
            Time from which settling is measured [s], such as the end of the move.

        Returns
        -------
        float
            Time [s] from `after` to the sample from which on all samples are within the tolerance; inf if the last is
            not.

        Raises
        ------
        ArgumentError
            An argument has the wrong shape or is not finite, or no sample follows `after`.

        Examples
        --------
        >>> rest = run.tip[-1]
        >>> print(run.settling_time(target=rest, tolerance=0.02) < 1.0)  # s
        True
        """
        t, tip = self._from(after)
        outside = np.flatnonzero(distances(tip, vector("target", target, 3)) > positive("tolerance", tolerance))
        first = outside[-1] + 1 if outside.size else 0
        return max(0.0, float(t[first] - after)) if first < len(t) else math.inf

    def overshoot(self, *, target: ArrayLike) -> float:
        """Largest distance by which the tip passes its target, along the straight line from its start to the target.

        Parameters
        ----------
        target
            Rest position of the tip in frame 0, shape (3,) [m].

        Returns
        -------
        float
            Largest u·(p − target) [m], where u is the unit vector from the tip's start to the target; 0 if the tip does
            not pass the target. Divided by |target − p(0)| it is the overshoot of control theory.

        Raises
        ------
        ArgumentError
            `target` has the wrong shape, is not finite, or is where the tip starts; or the run has no sample.

        Examples
        --------
        >>> print(f"{1e3 * run.overshoot(target=run.tip[-1]):.0f} mm beyond")
        26 mm beyond
        """
        _, tip = self._from(-math.inf)
        goal = vector("target", target, 3)
        way = largest_distance(tip[:1], goal)
        if way == 0:
            text = "equals the tip's start, so there is no travel to overshoot"
            raise ArgumentError(f"target = {truncated(goal.tolist())}: {text}", id="no-travel")
        return max(0.0, float(((tip - goal) @ (goal - tip[0]) / way).max()))

    def residual_vibration(self, *, after: float) -> float:
        """Amplitude of the tip's residual vibration after a move, wherever the tip comes to rest.

        Parameters
        ----------
        after
            End of the move [s]; the run continues for at least half a period after it.

        Returns
        -------
        float
            Largest distance [m] between the tip, from the time `after` on, and the centre of the box around its path,
            with edges along the axes of frame 0. For vibration along a line it is half the peak-to-peak range.

        Raises
        ------
        ArgumentError
            `after` is not a number, or fewer than two samples follow.

        Examples
        --------
        >>> print(f"{1e3 * run.residual_vibration(after=0.5):.0f} mm")  # the move ends at 0.5 s
        17 mm
        """
        _, tip = self._from(after, least=2)
        return largest_distance(tip, centre_of_motion(tip))

    def _from(self, after: float, least: int = 1) -> tuple[Array, Array]:
        """Times and positions of the tip from `after` on."""
        t, kept = self.t, within(self.t, real("after", after, "a time [s]"))
        if kept.sum() < least:
            span = f"run from {t[0]:g} to {t[-1]:g} s" if len(t) else "run without samples"
            text = f"a {span} has {kept.sum()} samples from that time on; needs at least {least}"
            raise ArgumentError(f"after = {truncated(after)}: {text}", id="too-few-samples")
        return t[kept], self.tip[kept]

    def _repr_html_(self) -> str:
        columns = [] if not len(self.t) else self.columns.items()
        rows = [(name, *map(float, (c[0], c[-1], c.min(), c.max()))) for name, c in columns]
        doubts = "".join(f"; {warning}" for warning in self.warnings)
        return html_table(f"{self!r}{doubts}", ("quantity", "first", "last", "smallest", "largest"), rows)

    @explained
    def plot(self, *, what: str | Sequence[str] | None = None, ax: Axes | Sequence[Axes] | None = None) -> Figure:
        """Plot joint angles and tip, or other panels, against time; a notebook shows the figure once. Needs matplotlib.

        Parameters
        ----------
        what
            Panels: "joints", "springs", "base", "tip", "energy", "elastic", "balance", "drives", or names of `columns`,
            each a panel; "all" those that have content. Default: joints and tip. "postures" shows the arm at twelve
            times with the path of its tip; "loads", three panels, the internal loads along the arm when a moment is
            largest, and their limits during the run.
        ax
            Axes of matplotlib to draw in, one for each panel. Default: a new figure.

        Raises
        ------
        ArgumentError
            The run has no such panel or column, or the number of axes differs from that of the panels.
        MissingDependencyError
            matplotlib is not installed.

        Examples
        --------
        >>> run.plot().savefig("move.png")  # in a notebook run.plot() alone shows it
        >>> beside = run.plot(what=["tip", "tau upper [N m]"])
        """
        figure: Figure = drawing_module("results.plotting").plot_trajectory(self, what, ax)
        return figure

    @explained
    def animate(
        self, path: str | Path, *, magnify: float = 1.0, colour: Literal["moment", "strain"] = "moment",
        fps: float = 25.0, speed: float = 1.0, width: int = 640, meshes: str | Path | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Path:  # fmt: skip
        """Draw the moving arm with its links as wide as their sections, gravity downwards, and the path of its tip.

        Planar arms are shown perpendicular to their plane, others from the side and above, with their shadow on a level
        floor. The payload is drawn as a steel ball of its mass. Joints and thin links are enlarged to be visible.

        Parameters
        ----------
        path
            File, whose extension gives the format: .gif; .mp4, written by the program ffmpeg; or .html, a single page
            with a player, which works without a network and without matplotlib.
        magnify
            Factor by which deflections of hinges and gears are magnified; it is stated in the picture.
        colour
            Quantity shown by the links' colour: the magnitude of the bending "moment" [N m] from `loads`, exact at
            hinges and joints and linear between them; or the bending "strain" at the surface.
        fps
            Frames per second of the film, at most one per sample; a GIF shows each frame for a multiple of 1/100 s.
        speed
            Seconds of the run per second of the film.
        width
            Width of the picture in pixels, 320 to 3840.
        meshes
            The robot's URDF or MJCF file, from which the scene was imported: its shapes are drawn, by MuJoCo's
            renderer, and beams inside them; not for .html.
        progress
            Function called with the completed fraction, 0 to 1.

        Returns
        -------
        Path
            Path of the file; a notebook plays the film.

        Raises
        ------
        ArgumentError
            An argument is not allowed, the film would have too many frames, or the run has no scene.
        DataFileError
            MuJoCo cannot load the file with the meshes.
        MissingDependencyError
            matplotlib is not installed, ffmpeg for .mp4, or MuJoCo for meshes.
        EngineError
            ffmpeg failed, or MuJoCo cannot draw.
        KeyboardInterrupt
            Ctrl-C or SIGTERM while drawing; nothing is written.
        OutputError
            The file cannot be written.
        SingularMassError
            As in `qdd`.

        Examples
        --------
        >>> print(run.animate("move.html", magnify=5, speed=0.5))  # a page with a player; also .gif, .mp4
        move.html
        """
        room = importlib.import_module("flexlink.results.pictures.animate")
        wanted = room.shot(path, magnify=magnify, colour=colour, fps=fps, speed=speed, width=width, meshes=meshes)
        drawn: Path = room.animate(self, wanted, progress)
        return drawn


def deflections(run: Trajectory) -> Array:
    """Deflection of the tip due to the springs, at every sample of a run [m]."""
    unmoved = np.empty(run.tip.shape)
    tip_points(run.chain.arrays, np.ascontiguousarray(unbent(run.chain, run.q)), unmoved)
    return distances(run.tip, unmoved)
