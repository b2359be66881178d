"""Trajectory: what a simulation returns."""

from __future__ import annotations

import dataclasses
import importlib
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.dynamics import Energy, solver_for
from flexlink.errors import ArgumentError, MissingDependencyError
from flexlink.inputs import input_arrays
from flexlink.kernels.samples import drive_torques, tips_and_energies
from flexlink.output import write_whole
from flexlink.scene import Scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


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
    """

    chain: Chain
    t: Array
    q: Array
    qd: Array
    tau: Array
    tip: Array
    energy: Energy

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            object.__setattr__(self, field.name, _read_only(getattr(self, field.name)))

    def __reduce__(self) -> tuple[type[Trajectory], tuple[object, ...]]:
        """Copies and pickles are built anew: their arrays, too, are read-only."""
        return Trajectory, tuple(getattr(self, field.name) for field in dataclasses.fields(self))

    @classmethod
    def from_states(cls, scene: Scene, chain: Chain, t: Array, q: Array, qd: Array) -> Trajectory:
        """Add tip, energies and drive torques to states that a run of `scene` went through.

        The trajectory holds read-only views of the arrays given; who goes on writing to them gives copies.
        """
        tip, parts, tau = np.empty((len(t), 3)), np.empty((3, len(t))), np.empty_like(q)
        tips_and_energies(chain.arrays, q, qd, tip, parts)
        work = solver_for(chain, scene.run.dynamics).workspace(chain.arrays)
        drive_torques(chain.arrays, work, *input_arrays(scene, chain), t, q, qd, tau)
        return cls(chain, t, q, qd, tau, tip, Energy(*parts))

    @property
    def columns(self) -> dict[str, Array]:
        """Every sampled quantity as a named column with its unit, in the order of the CSV file."""
        names = [self.chain.joint_name(k) for k in range(self.chain.n)]
        return {
            "t [s]": self.t,
            **{f"q {name} [rad]": self.q[:, k] for k, name in enumerate(names)},
            **{f"qd {name} [rad/s]": self.qd[:, k] for k, name in enumerate(names)},
            **{f"tau {names[k]} [N m]": self.tau[:, k] for k in self.chain.active},
            **{f"tip {axis} [m]": self.tip[:, k] for k, axis in enumerate("xyz")},
            "kinetic [J]": np.asarray(self.energy.kinetic),
            "gravity [J]": np.asarray(self.energy.gravity),
            "elastic [J]": np.asarray(self.energy.elastic),
        }

    def save(self, path: str | Path) -> Path:
        """Write an .npz archive (t, q, qd, tau, tip, kinetic, gravity, elastic, joints) or a .csv table.

        Numbers are written so that they read back exactly. The file appears whole or not at all.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        OutputError
            It cannot be written.
        """
        path = Path(path)
        write_whole(path, self.writer(path))
        return path

    def writer(self, path: Path) -> _Writer:
        """The function that writes this trajectory in the format that the ending of `path` names.

        Raises
        ------
        ArgumentError
            The name ends neither in .npz nor in .csv.
        """
        return _Writer(self, output_format(path))

    def plot(self) -> Figure:
        """Draw joint angles, tip and energy against time; needs matplotlib.

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.
        """
        figure: Figure = plotting().plot_trajectory(self)
        return figure


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
        return importlib.import_module("flexlink.plotting")
    except ImportError:
        raise MissingDependencyError(
            "plotting needs matplotlib; install it with: python -m pip install 'flexlink[report]'"
        ) from None


@dataclasses.dataclass(frozen=True)
class _Writer:
    trajectory: Trajectory
    format: str

    def __call__(self, path: Path) -> None:
        run = self.trajectory
        if self.format == ".npz":
            kinetic, gravity, elastic = run.energy
            joints = np.array([run.chain.joint_name(k) for k in range(run.chain.n)])
            with path.open("wb") as file:
                np.savez_compressed(
                    file, t=run.t, q=run.q, qd=run.qd, tau=run.tau, tip=run.tip, joints=joints,
                    kinetic=kinetic, gravity=gravity, elastic=elastic,
                )  # fmt: skip
            return
        rows = zip(*(column.tolist() for column in run.columns.values()), strict=True)
        header = ",".join('"' + name.replace('"', '""') + '"' for name in run.columns)
        with path.open("w", encoding="utf-8") as file:
            file.write(header + "\n")
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def picture_format(path: Path) -> str:
    """Format of a picture, from the ending of `path`.

    Raises
    ------
    ArgumentError
        It is none of .png, .svg, .pdf.
    """
    return _ending(path, (".png", ".svg", ".pdf"), "a picture")


def output_format(path: Path) -> str:
    """Format of a trajectory file, ".npz" or ".csv", from the ending of `path`.

    Raises
    ------
    ArgumentError
        It is neither.
    """
    return _ending(path, (".npz", ".csv"), "a trajectory")


def _ending(path: Path, allowed: tuple[str, ...], what: str) -> str:
    if path.suffix not in allowed:
        raise ArgumentError(f"{str(path)!r}: unknown format; {what} is saved as {' or '.join(allowed)}")
    return path.suffix
