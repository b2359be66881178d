"""Files of trajectories and pictures: their formats, by the ending of the name, and what is written."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from flexlink.common.errors import ArgumentError
from flexlink.results.columns import Columns
from flexlink.results.samples import RunSamples


@dataclasses.dataclass(frozen=True)
class Writer:
    """Writes a trajectory to a path, in a format."""

    trajectory: RunSamples
    format: str

    def __call__(self, path: Path) -> None:
        """Write the file."""
        run = self.trajectory
        if self.format == ".npz":
            kinetic, gravity, elastic = run.energy.parts
            joints = np.array(run.chain.joint_names)
            with path.open("wb") as file:
                arrays = {
                    "t": run.t, "q": run.q, "qd": run.qd, "tau": run.tau, "tip": run.tip, "joints": joints,
                    "kinetic": kinetic, "gravity": gravity, "elastic": elastic, "warnings": np.array(run.warnings, str),
                }  # fmt: skip
                if run.work is not None:
                    arrays |= {"work": run.work, "imbalance": run.imbalance}
                np.savez_compressed(file, allow_pickle=False, **arrays)
            return
        rows = zip(*(column.tolist() for column in Columns(run).values()), strict=True)
        header = ",".join('"' + name.replace('"', '""') + '"' for name in Columns(run))
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
