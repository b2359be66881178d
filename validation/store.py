"""Store of a study's results: plain files, readable with neither engines nor a terminal library.

    rows.jsonl              one JSON object a line, with the fields of `Row`
    series/CASE.NAME.npz    arrays c0, c1, … (columns of equal length) and `meta`, a JSON string: the fields of `Series`
    environment.json        versions, processor, commit, date
    finished.json           case → key of its last complete run

A row is on disk as soon as it is measured; a case counts as done only when it is in `finished.json`.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexlink.errors import FlexlinkError, OutputError
from flexlink.output import write_text, write_whole

Scale = Literal["linear", "log"]


@dataclasses.dataclass(frozen=True)
class Row:
    """One measured number and the verdict on it."""

    case: str
    kind: str
    title: str
    scene: str  # "" where the case has none
    engine: str  # what was measured: "native", "pinocchio", …
    setting: str  # such as "RK4 h=0.0001"
    quantity: str
    metric: str
    value: float | None  # None if the measurement is not a finite number
    unit: str
    tolerance: float | None  # None: information, no verdict
    bound: str  # "at most" or "at least": the side of the tolerance on which a value passes
    passed: bool | None
    reason: str
    seconds: float
    key: str  # hash of everything that the row depends on


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """A table for a figure: columns of equal length against the column `x`, one curve per column, or per `group`."""

    name: str
    title: str
    columns: Mapping[str, NDArray[Any]]
    x: str  # the column on the horizontal axis
    x_label: str
    y_label: str
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    group: str | None = None  # a text column: each of its values is a curve of its own


class Store:
    """A study's folder of results."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def rows(self) -> list[Row]:
        """All rows in the order in which they were measured; a torn last line of a killed run is dropped.

        Raises
        ------
        FlexlinkError
            Another line is not a row.
        """
        file = self.path / "rows.jsonl"
        if not file.exists():
            return []
        lines = file.read_text(encoding="utf-8").split("\n")[:-1]  # a whole line ends in a newline
        rows = []
        for number, line in enumerate(lines, start=1):
            try:
                rows.append(Row(**json.loads(line)))
            except (ValueError, TypeError) as error:
                raise FlexlinkError(
                    f"{file}, line {number}: not a row of this version ({error}); remove the folder to start anew"
                ) from None
        return rows

    def series(self, case: str) -> dict[str, Series]:
        """The series of one case by name."""
        found = {}
        for file in sorted((self.path / "series").glob(f"{case}.*.npz")):
            with np.load(file, allow_pickle=False) as archive:
                meta = json.loads(str(archive["meta"]))
                names = meta.pop("columns")
                columns = {name: archive[f"c{k}"] for k, name in enumerate(names)}
            found[meta["name"]] = Series(columns=columns, **meta)
        return found

    def environment(self) -> dict[str, Any]:
        """Versions, processor, system, commit and date of the run; empty if none was stored."""
        file = self.path / "environment.json"
        return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}

    def finished(self) -> dict[str, str]:
        """Case → key of its last complete run."""
        file = self.path / "finished.json"
        return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}

    def prepare(self, known: Collection[str]) -> None:
        """Make the folder, and forget cases that are not `known` any more.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        try:
            (self.path / "series").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        for case in {row.case for row in self.rows()} - set(known):
            self.forget(case)

    def note_environment(self, environment: Mapping[str, Any]) -> None:
        """Store on what the rows to come are measured."""
        write_text(self.path / "environment.json", _json(environment))

    def forget(self, case: str) -> None:
        """Drop every trace of a case."""
        done = self.finished()
        done.pop(case, None)
        write_text(self.path / "finished.json", _json(done))
        kept = [row for row in self.rows() if row.case != case]
        write_text(self.path / "rows.jsonl", "".join(_line(row) for row in kept))
        for file in (self.path / "series").glob(f"{case}.*.npz"):
            file.unlink()

    def append(self, row: Row) -> None:
        """Add a row; it is on disk when this returns.

        Raises
        ------
        OutputError
            It cannot be written.
        """
        path = self.path / "rows.jsonl"
        try:
            with path.open("a", encoding="utf-8") as file:
                file.write(_line(row))
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None

    def add_series(self, case: str, series: Series) -> None:
        """Store a series, replacing one of the same case and name."""
        meta = {f.name: getattr(series, f.name) for f in dataclasses.fields(series)}
        meta["columns"] = list(series.columns)
        arrays: dict[str, Any] = {f"c{k}": column for k, column in enumerate(series.columns.values())}

        def write(path: Path) -> None:
            with path.open("wb") as file:
                np.savez_compressed(file, meta=np.array(json.dumps(meta, ensure_ascii=False)), **arrays)

        write_whole(self.path / "series" / f"{case}.{series.name}.npz", write)

    def finish(self, case: str, key: str) -> None:
        """Note that every row and series of `case` is stored."""
        write_text(self.path / "finished.json", _json(self.finished() | {case: key}))


def table(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """The columns of a `Series` from its rows."""
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def finite(value: float) -> float | None:
    """`value` as JSON can hold it: None for nan and infinity."""
    return float(value) if math.isfinite(value) else None


def _line(row: Row) -> str:
    return json.dumps(dataclasses.asdict(row), ensure_ascii=False, allow_nan=False) + "\n"


def _json(value: Mapping[str, Any]) -> str:
    return json.dumps(value, ensure_ascii=False, indent=1) + "\n"
