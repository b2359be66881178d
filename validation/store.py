"""Store of a study's results: plain files that can be read without engines or terminal libraries.

    plan.json               case → required key of its results, title and kind: all cases of the study's last run
    rows.jsonl              one JSON object per line, with the fields of `Row`
    series/CASE.NAME.npz    arrays c0, c1, … (columns of equal length) and `meta`, a JSON string: the fields of `Series`
    environment.json        versions, processor, commit, date, hashes of the sources
    finished.json           case → `Finished`: key, date and machine of its last complete run
    failed.json             case → error of its last run, or `STOPPED`
    sources/CASE.json       path → digest of every file that the case depends on, at its last run

A row is on disk as soon as it is measured. A case counts as done only if it is in `finished.json`; its results belong
to the study only if its key is the one in `plan.json`.
"""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import FlexlinkError, OutputError
from flexlink.common.output import write_text, write_whole
from validation.facts import Facts, in_words

Scale = Literal["linear", "log"]
Bound = Literal["at most", "at least"]
T = TypeVar("T")

OURS = "native"
"""Engine of flexlink's results."""
STOPPED = "stopped in the middle"
START_ANEW = "remove the folder to start anew"
ERRORS_OF_READING = (ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, msgspec.MsgspecError)

BUSY_LOAD = 0.1  # fraction of the cores; above it, other processes slow down the timed one
BUSY_SPREAD = 0.3  # mean over shortest time of a calibration loop, minus 1; 0.03 to 0.2 on idle virtual machines


@dataclasses.dataclass(frozen=True)
class Row:
    """One measured number and its verdict."""

    case: str
    kind: str
    title: str
    scene: str  # "" if the case has none
    engine: str  # measured engine: "native", "pinocchio", …
    varied: Facts  # varied conditions: name → value, names of `validation.facts`
    quantity: str
    metric: str
    value: float | None  # None if the measurement is not a finite number
    unit: str
    tolerance: float | None  # the limit; None: for information, no verdict
    bound: Bound  # the side of the limit on which a value passes
    passed: bool | None
    timed: bool  # measures speed: depends on the machine and is excluded from verdicts on correctness
    reason: str  # justification of the limit
    note: str  # computed remark on this value
    given_up: str  # why an earlier limit was abandoned; "" if there was none
    seconds: float
    key: str  # hash of everything in the project that the row depends on
    widened: str = ""  # why the limit is wider than the published one

    @property
    def where(self) -> str:
        """Scene, engine (unless it is flexlink) and varied conditions in one line."""
        engine = "" if self.engine == OURS else self.engine
        return ", ".join(part for part in (self.scene, engine, in_words(self.varied)) if part)


@dataclasses.dataclass(frozen=True, eq=False)
class Series:
    """A table for a figure: columns of equal length against the column `x`, one curve per column, or per `group`."""

    what: str  # contents, such as "sweep"; figures select by it
    title: str
    columns: Mapping[str, NDArray[Any]]
    x: str  # the column on the horizontal axis
    x_label: str
    y_label: str
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    group: str | None = None  # a text column; one curve per value
    panel: str | None = None  # a text column; one pair of axes per value
    scene: str = ""
    part: str = ""  # distinguishes several series of one kind, such as "mode 1"
    engine: str = ""  # "" for flexlink
    legend: Mapping[str, str] = dataclasses.field(default_factory=dict)  # column → entry, if columns share an entry

    @property
    def name(self) -> str:
        """Name, unique within its case."""
        return ".".join(part for part in (self.scene, self.what, self.part, self.engine) if part).replace(" ", "_")


@dataclasses.dataclass(frozen=True)
class Conditions:
    """Load of the machine while a case was timed."""

    load: float | None  # cores used by other processes, mean over the case; None if unknown
    spread: float  # mean over shortest time of a calibration loop before and after the case, minus 1
    cores: int

    @property
    def busy(self) -> bool:
        """Whether other processes make the measured times unreliable."""
        return (self.load or 0.0) > BUSY_LOAD * self.cores or self.spread > BUSY_SPREAD


@dataclasses.dataclass(frozen=True)
class Environment:
    """Software and hardware of a study; entries that are unknown are empty."""

    date: datetime.datetime | None = None  # start of the study
    commit: str = ""  # commit of the sources, with "+" if they have changed since
    python: str = ""
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    processor: str = ""
    cores: int = 0
    system: str = ""
    sources: Mapping[str, str] = dataclasses.field(default_factory=dict)  # path → digest, from `validation.sources`


@dataclasses.dataclass(frozen=True)
class Finished:
    """A complete run of a case."""

    key: str
    date: datetime.datetime  # end of the run
    machine: str
    conditions: Conditions | None  # None: nothing was timed
    versions: Mapping[str, str] = dataclasses.field(default_factory=dict)  # of Python and packages

    @property
    def busy(self) -> bool:
        """Whether something was timed on a busy machine."""
        return self.conditions is not None and self.conditions.busy


@dataclasses.dataclass(frozen=True)
class Planned:
    """A case of the study; its key is the hash of everything in the project that it depends on now."""

    key: str
    kind: str
    title: str
    about: str = ""


class Store:
    """A study's folder of results."""

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)

    def rows(self) -> list[Row]:
        """All rows in the order of measurement; an incomplete last line of a killed run is dropped.

        Raises
        ------
        FlexlinkError
            Any other line is invalid.
        """
        file = self.path / "rows.jsonl"
        if not file.exists():
            return []
        lines = _read(file, Path.read_bytes).split(b"\n")[:-1]  # a complete line ends in a newline
        rows = []
        for number, line in enumerate(lines, start=1):
            try:
                rows.append(msgspec.json.decode(line, type=Row))
            except (ValueError, msgspec.MsgspecError) as error:
                raise FlexlinkError(
                    f"{file}, line {number}: not a row of this version ({error}); {START_ANEW}", id="file-content"
                ) from None
        return rows

    def series(self, case: str) -> dict[str, Series]:
        """The series of one case by name.

        Raises
        ------
        FlexlinkError
            A file is damaged, or not a series of this version.
        """
        files = sorted((self.path / "series").glob(f"{case}.*.npz"))
        return {series.name: series for series in (_read(file, _series) for file in files)}

    def environment(self) -> Environment:
        """Software and hardware of the last run."""
        return self._decoded("environment.json", Environment)

    def plan(self) -> dict[str, Planned]:
        """All cases of the study at the last run, with the required keys of their results."""
        return self._decoded("plan.json", dict[str, Planned])

    def finished(self) -> dict[str, Finished]:
        """Case → its last complete run."""
        return self._decoded("finished.json", dict[str, Finished])

    def failed(self) -> dict[str, str]:
        """Case → the error of its last run."""
        return self._decoded("failed.json", dict[str, str])

    def sources(self, case: str) -> dict[str, str]:
        """Path → digest of the files that a case depended on at its last run; empty if unknown."""
        return self._decoded(f"sources/{case}.json", dict[str, str])

    def _decoded(self, name: str, kind: type[T]) -> T:
        """Contents of a JSON file; empty if there is no file.

        Raises
        ------
        FlexlinkError
            The file is damaged, or not of this version.
        """
        file = self.path / name
        return _read(file, lambda path: msgspec.json.decode(path.read_bytes(), type=kind)) if file.exists() else kind()

    def prepare(self, known: Collection[str]) -> None:
        """Make the folder, and drop the results of cases that are no longer `known`.

        Raises
        ------
        OutputError
            The folder cannot be written.
        """
        try:
            for folder in ("series", "sources"):
                (self.path / folder).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be written: {error.strerror or error}") from None
        for case in {row.case for row in self.rows()} - set(known):
            self.forget(case)

    def note_environment(self, environment: Environment) -> None:
        """Store the software and hardware of the rows that follow."""
        self._write("environment.json", environment)

    def note_plan(self, plan: Mapping[str, Planned]) -> None:
        """Store the cases of the complete study and the required keys of their results."""
        self._write("plan.json", plan)

    def reopen(self, cases: Collection[str]) -> None:
        """Mark cases as not finished; their results remain until they are measured again."""
        self._write("finished.json", {name: done for name, done in self.finished().items() if name not in cases})

    def begin(self, case: str, sources: Mapping[str, str]) -> None:
        """Remove the results of a case, and store that it began, with the files that it depends on."""
        self.forget(case)
        self._write(f"sources/{case}.json", sources)
        self.fail(case, STOPPED)

    def forget(self, case: str) -> None:
        """Remove all results of a case."""
        self.reopen({case})
        self._write("failed.json", {name: why for name, why in self.failed().items() if name != case})
        kept = [row for row in self.rows() if row.case != case]
        write_text(self.path / "rows.jsonl", "".join(_line(row) for row in kept))
        for file in (*(self.path / "series").glob(f"{case}.*.npz"), *(self.path / "sources").glob(f"{case}.json")):
            file.unlink()

    def append(self, row: Row) -> None:
        """Append a row; it is on disk when this returns.

        Raises
        ------
        OutputError
            The row cannot be written.
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
        meta = {f.name: getattr(series, f.name) for f in dataclasses.fields(series)} | {"columns": list(series.columns)}
        arrays: dict[str, Any] = {f"c{k}": column for k, column in enumerate(series.columns.values())}

        def write(path: Path) -> None:
            with path.open("wb") as file:
                np.savez_compressed(file, meta=np.array(json.dumps(meta, ensure_ascii=False)), **arrays)

        write_whole(self.path / "series" / f"{case}.{series.name}.npz", write)

    def finish(self, case: str, finished: Finished) -> None:
        """Mark `case` as finished: its rows and series are complete."""
        self._write("failed.json", {name: why for name, why in self.failed().items() if name != case})
        self._write("finished.json", self.finished() | {case: finished})

    def fail(self, case: str, why: str) -> None:
        """Store why `case` could not be run."""
        self._write("failed.json", self.failed() | {case: why})

    def _write(self, name: str, value: Environment | Mapping[str, Planned | Finished | str]) -> None:
        write_text(self.path / name, msgspec.json.format(msgspec.json.encode(value), indent=1).decode() + "\n")


def table(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> dict[str, NDArray[Any]]:
    """Make the columns of a `Series` from its rows."""
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def _line(row: Row) -> str:
    return msgspec.json.encode(row).decode() + "\n"


def _read(file: Path, read: Callable[[Path], T]) -> T:
    """Read a file with `read`; raise a one-line FlexlinkError if it is damaged or was written by another version."""
    try:
        return read(file)
    except (*ERRORS_OF_READING, OSError) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise FlexlinkError(f"{file}: cannot be read ({why}); {START_ANEW}", id="cannot-read") from None


def _series(file: Path) -> Series:
    with np.load(file, allow_pickle=False) as archive:
        meta = json.loads(str(archive["meta"]))
        names = meta.pop("columns")
        return Series(columns={name: archive[f"c{k}"] for k, name in enumerate(names)}, **meta)
