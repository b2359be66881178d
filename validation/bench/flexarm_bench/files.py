"""Values of a program without Python: one CSV file per benchmark, which `flexarm-bench blank` writes to fill in."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flexarm_bench.benchmark import Benchmark
from flexarm_bench.case import Array, BenchError, Cannot, Case, Settings

NOT_GIVEN = "not given"


def heads(case: Case) -> list[str]:
    """Heads of a file: the part, or the time of a motion, and its values."""
    if case.ask == "motion":
        return ["time [s]", "x [m]", "y [m]"]
    values = {
        "statics": ["ux [m]", "uy [m]", "uz [m]"], "buckling": ["factor [1]"],
        "frequencies": [f"mode {k + 1} [rad/s]" for k in range(case.modes)],
    }[case.ask]  # fmt: skip
    return ["part", *values]


def labels(case: Case) -> list[str]:
    """First cells of the lines of a part."""
    return [f"{t:.12g}" for t in case.times] if case.ask == "motion" else [case.part or case.name]


def write_blank(folder: Path, benchmark: Benchmark) -> Path:
    """Write the file of a benchmark without values."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{benchmark.name}.csv"
    first = heads(benchmark.parts[0][0])
    with path.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(first)
        for case, _ in benchmark.parts:
            writer.writerows([label, *[""] * (len(first) - 1)] for label in labels(case))
    return path


class Files:
    """Values in the files of a folder, as a solver."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        if not any(folder.glob("*.csv")):
            raise BenchError(f"--solver {folder}: no CSV file; flexarm-bench blank {folder} writes them, to fill in")

    def run(self, case: Case, settings: Settings) -> Array:
        """The values of a part."""
        path = self.folder / f"{case.name}.csv"
        if not path.is_file():
            raise Cannot(NOT_GIVEN)
        rows = dict(self._rows(path, heads(case)))
        missing = [label for label in labels(case) if label not in rows]
        if missing:
            raise BenchError(f"{path}: no line {missing[0]!r}; flexarm-bench blank writes all lines")
        values = np.array([rows[label] for label in labels(case)])
        if np.isnan(values).any():
            raise Cannot(NOT_GIVEN)
        return values if case.ask == "motion" else values[0]

    @staticmethod
    def _rows(path: Path, expected: list[str]) -> Iterator[tuple[str, list[float]]]:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [[cell.strip() for cell in line] for line in csv.reader(file) if any(line)]
        if not lines or lines[0] != expected:
            raise BenchError(f"{path}: heads {','.join(lines[0]) if lines else ''}; expected {','.join(expected)}")
        for number, (label, *cells) in enumerate(lines[1:], 2):
            try:
                values = [float(cell) if cell else math.nan for cell in cells]
            except ValueError:
                raise BenchError(f"{path}: line {number}: {','.join(cells)!r}: expected numbers") from None
            if len(values) != len(expected) - 1:
                raise BenchError(f"{path}: line {number}: {len(values) + 1} cells; expected {len(expected)}")
            yield label, values
