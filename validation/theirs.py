"""Compare another code's CSV files, one per case, with the same references as flexlink.

FOLDER/CASE.csv contains values by name, with the header `quantity,value [UNIT]`. For measurements the header is
`quantity,unit,value,u_num`, with u_num optional. A motion has the columns `time [s]` and the quantity with its unit, at
the times of the reference.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.common.errors import ArgumentError, DataFileError, OutputError
from flexlink.common.output import write_text
from flexlink.common.wording import plural
from flexlink.pages.numbers import JOIN, number
from validation.case import Case, Sheet
from validation.measured.uncertainty import Comparison, Convergence
from validation.store import Series

MEASURED, PUBLISHED, MOTION = "measured", "published", "motion"  # names of the series with references
NAME, UNIT, VALUE, U_NUM, REFERENCE = "quantity", "unit", "value", "u_num", "reference"
SAME_TIME = 1e-9  # largest difference of two times that count as equal [s]
MEASURED_HEADS = (NAME, UNIT, VALUE, U_NUM)
HEADS = ("case", "quantity", "theirs", "reference", "error", "accepted", "verdict")


class Judged(NamedTuple):
    """A value of another code with its verdict; `passed` is None if no value is given or no verdict is possible."""

    case: str
    quantity: str
    theirs: float | None
    reference: float
    error: float | None
    accepted: float
    verdict: str
    passed: bool | None

    def cells(self) -> tuple[str, ...]:
        """The cells of a table row."""
        numbers = (self.theirs, self.reference, self.error, self.accepted)
        return (self.case, self.quantity, *map(number, numbers), self.verdict)


def cases_of(folder: Path, known: Sequence[Case]) -> list[Case]:
    """The cases for which a folder has files.

    Raises
    ------
    ArgumentError
        The folder or its files are missing, or a file belongs to no case that is open to other codes.
    """
    if not folder.is_dir():
        raise ArgumentError(
            f"--theirs {folder}: no such folder; --blank {folder} creates it, with one file per case to fill in"
        )
    files = sorted(folder.glob("*.csv"))
    if not files:
        raise ArgumentError(f"--theirs {folder}: no CSV file; --blank {folder} writes one file per case to fill in")
    by_name = {case.name: case for case in open_to_others(known)}
    return [require_one_of(f"{file}: case", file.stem, by_name) for file in files]


def open_to_others(known: Sequence[Case]) -> list[Case]:
    """The cases with references independent of flexlink: all measured ones, and those with a data sheet."""
    return [case for case in known if case.kind == MEASURED or case.sheet is not None]


def judge(file: Path, case: Case, stored: Mapping[str, Series]) -> Iterator[Judged]:
    """Compare every quantity of a case with its reference, including quantities without a value.

    Raises
    ------
    DataFileError
        The file cannot be read, or contains an unknown quantity or an invalid number.
    """
    references = {series.what: series for series in stored.values()}
    heads, rows = _table(file)
    if MEASURED in references:
        series = references[MEASURED]
        units = dict(zip(*(series.columns[head].tolist() for head in (NAME, UNIT)), strict=True))
        yield from _measured(case, series, _by_name(file, MEASURED_HEADS, heads, rows, units))
    elif heads[0] == NAME:
        series = references[PUBLISHED]
        given = _by_name(file, _heads(case), heads, rows, dict.fromkeys(series.columns["what"].tolist(), ""))
        yield from _published(case, series, given)
    else:
        if MOTION not in references:
            raise DataFileError(f"{file}: heads {','.join(heads)}; expected {','.join(_heads(case))}")
        yield _motion(file, case, references[MOTION], heads, rows)


def write_blank(folder: Path, case: Case, stored: Mapping[str, Series]) -> Path:
    """Write a blank file of a case with its quantities, or its times; OutputError if it cannot be written."""
    references = {series.what: series for series in stored.values()}
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    if MEASURED in references:
        columns = (references[MEASURED].columns[head].tolist() for head in (NAME, UNIT))
        writer.writerows([MEASURED_HEADS, *((*pair, "", "") for pair in zip(*columns, strict=True))])
    elif MOTION in references:
        series = references[MOTION]
        writer.writerows([(series.x, series.y_label), *((float(t), "") for t in series.columns[series.x])])
    else:
        writer.writerows([_heads(case), *((name, "") for name in references[PUBLISHED].columns["what"])])
    path = folder / f"{case.name}.csv"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot create this folder: {error.strerror or error}") from None
    write_text(path, text.getvalue())
    return path


def _table(file: Path) -> tuple[list[str], list[list[str]]]:
    try:
        text = file.read_text(encoding="utf-8-sig")
        lines = [[cell.strip() for cell in line] for line in csv.reader(io.StringIO(text)) if any(line)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataFileError(f"{file}: cannot be read: {error}") from None
    if not lines or len(lines[0]) < 2:
        raise DataFileError(f"{file}: no header; --blank writes one")
    for row, line in enumerate(lines, 1):
        if len(line) != len(lines[0]):
            raise DataFileError(f"{file}: line {row}: {len(line)} cells; the header line has {len(lines[0])}")
    return lines[0], lines[1:]


def _heads(case: Case) -> tuple[str, str]:
    return NAME, f"{VALUE} [{_sheet(case).unit}]"


def _by_name(
    file: Path, expected: Sequence[str], heads: list[str], rows: list[list[str]], units: Mapping[str, str]
) -> dict[str, dict[str, float]]:
    """Read quantity → its value, and its u_num if given; lines without a value are skipped."""
    if heads != list(expected):
        raise DataFileError(f"{file}: heads {','.join(heads)}; expected {','.join(expected)}")
    found: dict[str, dict[str, float]] = {}
    for row, line in enumerate(rows, 2):
        cells = dict(zip((head.partition(" ")[0] for head in heads), line, strict=True))
        name, unit = cells.pop(NAME), cells.pop(UNIT, "")
        known = require_one_of(f"{file}: line {row}: {NAME}", name, units)
        if unit != known:
            raise DataFileError(f"{file}: line {row}: {name}: unit = {unit!r}: expected {known!r}")
        if name in found:
            raise DataFileError(f"{file}: line {row}: {name!r} is listed twice")
        if cells[VALUE]:
            found[name] = {head: _number(file, row, head, cell) for head, cell in cells.items() if cell}
    return found


def _number(file: Path, line: int, head: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DataFileError(f"{file}: line {line}: {head} = {cell!r}: expected a finite number")
    return value


def _measured(case: Case, series: Series, given: Mapping[str, Mapping[str, float]]) -> Iterator[Judged]:
    """Compare by E and u_val; u_input is taken from flexlink, since it is due to the specimen, not to the code."""
    c = series.columns
    names = c[NAME].tolist()
    for k, name in enumerate(names):
        D, wanted = float(c["D"][k]), float(c["wanted"][k])
        if name not in given:
            yield Judged(case.name, name, None, D, None, wanted, "not given", None)
            continue
        grid = Convergence.stated(given[name].get(U_NUM, 0.0))
        found = Comparison(given[name][VALUE], D, grid, float(c["u_input"][k]), float(c["u_D"][k]), wanted)
        passed = {"validated to u_val": True, "cannot be told": None}.get(found.verdict, abs(found.error) <= wanted)
        words = f"{found.verdict}, u_val = {found.u_val:.2g}".replace(" = ", f"{JOIN}={JOIN}")
        yield Judged(case.name, name, found.simulated, D, found.error, wanted, words, passed)


def _published(case: Case, series: Series, given: Mapping[str, Mapping[str, float]]) -> Iterator[Judged]:
    """Compare by the relative error that the case's data sheet accepts."""
    names, exact = (series.columns[head].tolist() for head in ("what", "published"))
    accepted = _sheet(case).accepted
    for name, value in zip(names, exact, strict=True):
        if name not in given:
            yield Judged(case.name, name, None, value, None, accepted, "not given", None)
            continue
        theirs = given[name][VALUE]
        error = abs(theirs / value - 1)
        yield Judged(case.name, name, theirs, value, error, accepted, *_verdict(error, accepted))


def _motion(file: Path, case: Case, series: Series, heads: list[str], rows: list[list[str]]) -> Judged:
    """Compare by the largest difference at the reference's times."""
    if heads != [series.x, series.y_label]:
        raise DataFileError(f"{file}: heads {', '.join(heads)}; expected {series.x},{series.y_label}")
    table = np.array(
        [[_number(file, k, *pair) for pair in zip(heads, row, strict=True)] for k, row in enumerate(rows, 2)]
    )
    times, exact = series.columns[series.x], series.columns[REFERENCE]
    if len(table) != len(times) or np.abs(table[:, 0] - times).max() > SAME_TIME:
        raise DataFileError(
            f"{file}: {len(table)} times; expected the {len(times)} of the reference, {times[0]:g} to {times[-1]:g} s; "
            "--blank writes them"
        )
    worst = int(np.abs(table[:, 1] - exact).argmax())
    error = float(abs(table[worst, 1] - exact[worst]))
    name = f"{series.y_label}, worst at {times[worst]:g} s"
    accepted = _sheet(case).accepted
    return Judged(
        case.name, name, float(table[worst, 1]), float(exact[worst]), error, accepted, *_verdict(error, accepted)
    )


def _sheet(case: Case) -> Sheet:
    assert case.sheet is not None  # `open_to_others`
    return case.sheet


def _verdict(error: float, accepted: float) -> tuple[str, bool]:
    return ("accepted", True) if error <= accepted else ("not accepted", False)


def sentence(found: Sequence[Judged]) -> str:
    """Summarize all verdicts in one line."""
    given = [judged for judged in found if judged.theirs is not None]
    accepted, failed, open_ = (sum(judged.passed is state for judged in given) for state in (True, False, None))
    return (
        f"{plural(len(given), 'value')} given: {accepted} accepted, {failed} not accepted, {open_} cannot be told; "
        f"{len(found) - len(given)} not given"
    )
