"""The reference run: timed results of an idle machine, checked in as small CSV files for comparison with later runs."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

from flexlink.common.errors import FlexlinkError
from flexlink.common.output import make_folder, write_text
from flexlink.pages.tables import table_csv
from reports.results import Results
from reports.verdict import PASS, measured, verification
from validation.facts import in_words
from validation.judgement import JudgedRow, correctness, crowd, speed
from validation.store import Row

FOLDER = Path(__file__).parent / "reference_run"
HEADS = ("case", "quantity", "setting", "engine", "form", "value", "unit", "side", "limit", "state")
FOUND = "form"  # setting that is an outcome: the fastest form of an engine
ANEW = "make one with: python -m reports --reference"
HOW = "run the complete study on an idle machine: python -m validation --force"


@dataclasses.dataclass(frozen=True)
class Reference:
    """Measured values of timed rows by `_key`, and the machine that measured them; empty without a reference run."""

    values: dict[tuple[str, str, str], float]
    machine: str

    def value(self, row: Row) -> float | None:
        """Value of the reference run for a row."""
        return self.values.get(_key(row))


def _key(row: Row) -> tuple[str, str, str]:
    """(case, quantity, setting) of a row; the setting omits which engine and which of its forms was the fastest."""
    set_ = in_words({name: value for name, value in row.varied.items() if name != FOUND})
    return row.case, row.quantity, ", ".join(part for part in (row.scene, set_) if part)


def save(results: Results, folder: Path = FOLDER) -> Path:
    """Make the reference run from a study: speed.csv, correctness.csv and machine.csv.

    Raises
    ------
    FlexlinkError
        The study is incomplete, has failures, or was timed on a busy machine; or the folder cannot be written.
    """
    verdict, fast = verification(results), speed(results.rows)
    if verdict.word != PASS:
        raise FlexlinkError(f"{results.store.path}: unusable as reference: {verdict.text}")
    if fast.unmeasured:
        raise FlexlinkError(f"{results.store.path}: unusable as reference: {fast.sentence()}; {HOW}")
    make_folder(folder)
    timed = [row for row in results.rows if row.timed]
    write_text(folder / "speed.csv", table_csv(HEADS, (_line(row) for row in timed)))
    cases = [(case, correctness(rows)) for case, rows in results.cases.items()]
    lines = ((case, found.judged, len(found.failed)) for case, found in cases)
    write_text(folder / "correctness.csv", table_csv(("case", "checks", "failed"), lines))
    quiet = [(case, crowd(done.conditions)) for case, done in results.finished.items() if done.conditions]
    write_text(folder / "machine.csv", table_csv(("what", "value"), [("measured", measured(results)), *quiet]))
    return folder


def _line(row: JudgedRow) -> tuple[object, ...]:
    side = row.bound if row.tolerance is not None else ""
    return *_key(row), row.engine, row.varied.get(FOUND), row.value, row.unit, side, row.tolerance, row.state


def read(folder: Path = FOLDER) -> Reference:
    """The checked-in reference run.

    Raises
    ------
    FlexlinkError
        Its files are invalid.
    """
    if not (folder / "speed.csv").is_file():
        return Reference({}, "")
    try:
        with (folder / "speed.csv").open(encoding="utf-8", newline="") as file:
            lines = [line for line in csv.DictReader(file) if line["value"] and line["limit"]]
        with (folder / "machine.csv").open(encoding="utf-8", newline="") as file:
            machine = {row["what"]: row["value"] for row in csv.DictReader(file)}
        values = {(line["case"], line["quantity"], line["setting"]): float(line["value"]) for line in lines}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise FlexlinkError(f"{folder}: not a reference run ({error}); {ANEW}") from None
    return Reference(values, machine.get("measured", ""))
