"""Trajectory: what a simulation returns."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

from flexlink.common.notebook import drawing_module, html_table
from flexlink.common.output import write_whole
from flexlink.common.types import Array
from flexlink.data.documents import require_path
from flexlink.results import tables
from flexlink.results.columns import Columns
from flexlink.results.files import output_format, write
from flexlink.results.samples import RunSamples

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Trajectory(RunSamples):
    """Samples of a simulation (`RunSamples`), with files, tables, plots and pictures of them.

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

        "t [s]", then by the names of joints "q upper [rad]", "qd upper [rad/s]", of driven ones "tau upper [N m]", of
        those that slide in m, m/s and N, then "tip x [m]", "tip y [m]", "tip z [m]", "kinetic [J]", "gravity [J]",
        "elastic [J]", of flexlink's own runs "work [J]", "imbalance [J]", and of a free base "attitude w [1]" and so on
        to z, "spin x [rad/s]" in axes of the base, "momentum x [N s]" and "angular momentum x [N m s]"; last what the
        scene's sensors show, under their names.
        """
        return Columns(self)

    def save(self, path: str | Path) -> Path:
        """Write an .npz archive, which `load_trajectory` reads back equal to the bit, or a .csv table of `columns`.

        The archive holds t, q, qd, tau, tip, kinetic, gravity, elastic, work, imbalance, tip_wrench, joints, warnings,
        steps, scene (TOML), chain_… and, of a scene with sensors, their names, sensors, and readings. Numbers of the
        table read back exactly. A file appears whole or not at all.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        OutputError
            It cannot be written.

        Examples
        --------
        >>> archive = run.save("move.npz")  # or a table, "move.csv"
        >>> print(np.array_equal(fl.load_trajectory(archive).q, run.q))
        True
        """
        path = require_path("path", path)
        write_whole(path, self.writer(path))
        return path

    def writer(self, path: Path) -> Callable[[Path], None]:
        """The function that writes this trajectory in the format that the ending of `path` names.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        """
        format = output_format(path)
        return lambda place: write(self, format, place)

    def to_pandas(self) -> Any:
        """All `columns` as a pandas.DataFrame, whose index is the time "t [s]".

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
        return tables.to_pandas(self)

    def to_xarray(self) -> Any:
        """All samples as an xarray.Dataset: q, qd, tau (time, joint), tip (time, axis), energies (time); with `units`.

        Of a scene with sensors, too, their readings (time, sensor).

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
        return tables.to_xarray(self)

    def _repr_html_(self) -> str:
        columns = [] if not len(self.t) else self.columns.items()
        rows = [(name, *map(float, (c[0], c[-1], c.min(), c.max()))) for name, c in columns]
        doubts = "".join(f"; {warning}" for warning in self.warnings)
        return html_table(f"{self!r}{doubts}", ("quantity", "first", "last", "smallest", "largest"), rows)

    def plot(self) -> Figure:
        """Draw joint angles, tip and energy against time; a notebook shows the figure once. Needs matplotlib.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.

        Examples
        --------
        >>> run.plot().savefig("move.png")  # in a notebook run.plot() alone shows it
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
            The file, which a notebook plays.

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

        Examples
        --------
        >>> print(run.animate("move.html", magnify=5, speed=0.5))  # a page with a player; also .gif, .mp4
        move.html
        """
        room = importlib.import_module("flexlink.results.pictures.animate")
        wanted = room.shot(path, magnify=magnify, colour=colour, fps=fps, speed=speed, width=width)
        drawn: Path = room.animate(self, wanted, progress)
        return drawn


def plotting() -> ModuleType:
    """The module that draws, which needs matplotlib.

    Raises
    ------
    MissingDependencyError
        matplotlib is not installed.
    """
    return drawing_module("results.plotting")
