"""Trajectory: what a simulation returns."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.dynamics import Energy
from flexlink.errors import ArgumentError, MissingDependencyError
from flexlink.kernels.energy import energies
from flexlink.kernels.kinematics import kinematics
from flexlink.output import write_whole

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
    tip
        Position of the tip in frame 0 [m], shape (samples, 3).
    energy
        Kinetic, gravity and elastic energy [J], each of shape (samples,).
    """

    chain: Chain
    t: Array
    q: Array
    qd: Array
    tip: Array
    energy: Energy

    @classmethod
    def from_states(cls, chain: Chain, t: Array, q: Array, qd: Array) -> Trajectory:
        """Add tip and energies to states; arrays become read-only."""
        tip, parts = np.empty((len(t), 3)), np.empty((3, len(t)))
        bodies = len(chain.bodies)
        rotations, points, axes = np.empty((bodies, 3, 3)), np.empty((bodies, 3)), np.empty((chain.n, 3))
        for i in range(len(t)):
            kinematics(chain.arrays, q[i], rotations, points, axes)
            tip[i] = points[-1]
            parts[:, i] = energies(chain.arrays, q[i], qd[i])
        for array in (t, q, qd, tip, parts):
            array.flags.writeable = False
        return cls(chain, t, q, qd, tip, Energy(*parts))

    @property
    def columns(self) -> dict[str, Array]:
        """Every sampled quantity as a named column with its unit, in the order of the CSV file."""
        names = [self.chain.joint_name(k) for k in range(self.chain.n)]
        return {
            "t [s]": self.t,
            **{f"q {name} [rad]": self.q[:, k] for k, name in enumerate(names)},
            **{f"qd {name} [rad/s]": self.qd[:, k] for k, name in enumerate(names)},
            **{f"tip {axis} [m]": self.tip[:, k] for k, axis in enumerate("xyz")},
            "kinetic [J]": np.asarray(self.energy.kinetic),
            "gravity [J]": np.asarray(self.energy.gravity),
            "elastic [J]": np.asarray(self.energy.elastic),
        }

    def save(self, path: str | Path) -> Path:
        """Write an .npz archive (t, q, qd, tip, kinetic, gravity, elastic, joints) or a .csv table.

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
        """Draw joint angles, tip and energy against time; needs matplotlib (`pip install 'flexlink[report]'`).

        Raises
        ------
        MissingDependencyError
            matplotlib is not installed.
        """
        try:
            from flexlink.plotting import plot_trajectory  # noqa: PLC0415  matplotlib is optional
        except ImportError:
            raise MissingDependencyError(
                "plotting needs matplotlib; install it with: python -m pip install 'flexlink[report]'"
            ) from None
        return plot_trajectory(self)


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
                    file, t=run.t, q=run.q, qd=run.qd, tip=run.tip, joints=joints,
                    kinetic=kinetic, gravity=gravity, elastic=elastic,
                )  # fmt: skip
            return
        rows = zip(*(column.tolist() for column in run.columns.values()), strict=True)
        header = ",".join(f'"{name}"' for name in run.columns)
        with path.open("w", encoding="utf-8") as file:
            file.write(header + "\n")
            file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def output_format(path: Path) -> str:
    """Format of a trajectory file, ".npz" or ".csv", from the ending of `path`.

    Raises
    ------
    ArgumentError
        It is neither.
    """
    if path.suffix not in {".npz", ".csv"}:
        raise ArgumentError(f"{str(path)!r}: unknown format; a trajectory is saved as .npz or .csv")
    return path.suffix
