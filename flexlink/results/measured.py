"""What was measured: a CSV of times and columns of a trajectory, in its units or in those of instruments."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.files import read_regular
from flexlink.common.types import Array
from flexlink.describe.spec import short_list

TIME = "t [s]"
UNITS = {
    "[deg]": ("[rad]", math.pi / 180), "[deg/s]": ("[rad/s]", math.pi / 180), "[mm]": ("[m]", 1e-3),
    "[µm]": ("[m]", 1e-6), "[um]": ("[m]", 1e-6), "[ms]": ("[s]", 1e-3),
}  # fmt: skip
"""Units of instruments, each with the one of `Trajectory.columns` and its size in it."""


class Measured(NamedTuple):
    """Times [s], shape (samples,), and what was measured at them in SI units, nan where nothing was."""

    t: Array
    columns: dict[str, Array]


def read_measured(path: Path, known: Mapping[str, object], only: Sequence[str] = ()) -> Measured:
    """Read a CSV whose heads are "t [s]" and names of columns of a trajectory.

    Parameters
    ----------
    path
        The file.
    known
        What may be there, by the names of `Trajectory.columns`.
    only
        Heads of the columns that are wanted; others may then be anything. Default: all.

    Raises
    ------
    DataFileError
        The file cannot be read; a head that is not known, or twice, or not there; a cell that is no number; times that
        do not increase, or nothing measured.
    """
    try:
        text = read_regular(path, largest=100_000_000, error=DataFileError).decode("utf-8-sig")
        heads, *lines = [line for line in csv.reader(io.StringIO(text)) if any(cell.strip() for cell in line)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataFileError(f"{path}: is not CSV: {error}") from None
    except ValueError:
        raise DataFileError(f"{path}: is empty; expected a header line with a column {TIME!r}") from None
    heads = [head.strip() for head in heads]
    for number, line in enumerate(lines, 2):
        if len(line) != len(heads):
            raise DataFileError(f"{path}: line {number}: {len(line)} cells; the header line has {len(heads)}")
    wanted = [k for k, head in enumerate(heads) if not only or head in only or _is_time(head)]
    rows = [_numbers(path, number, [line[k] for k in wanted], [heads[k] for k in wanted])
            for number, line in enumerate(lines, 2)]  # fmt: skip
    values = np.array(rows).reshape(len(rows), len(wanted))
    return measured_from(str(path), dict(zip([heads[k] for k in wanted], values.T, strict=True)), known, only, heads)


def measured_from(
    where: str, columns: Mapping[str, Array], known: Mapping[str, object], only: Sequence[str] = (),
    heads: Sequence[str] = (),
) -> Measured:  # fmt: skip
    """What was measured, from its columns by head; `heads` are all of a file. Errors as in `read_measured`."""
    heads = heads or list(columns)
    absent = [name for name in only if name not in columns]
    if absent:
        raise DataFileError(f"{where}: no column {absent[0]!r}; columns: {short_list(list(heads))}")
    counted = [head for head in heads if head in columns]
    names = [named(where, head, known) for head in counted]
    twice = [name for name in names if names.count(name) > 1]
    if TIME not in names or twice:
        wrong = f"column {twice[0]!r} appears twice" if twice else f"no column {TIME!r}"
        raise DataFileError(f"{where}: {wrong}; columns: {short_list(list(heads))}")
    found = {
        name: np.asarray(columns[head], float) * size_of(head, known) for name, head in zip(names, counted, strict=True)
    }
    t = found.pop(TIME)
    if len(t) < 2 or not (np.diff(t) > 0).all():
        raise DataFileError(f"{where}: {TIME}: expected two or more times, each later than the one before")
    if not any(np.isfinite(column).any() for column in found.values()):
        raise DataFileError(f"{where}: no measured values; expected columns such as 'tip x [m]'")
    return Measured(t, found)


def size_of(head: str, known: Mapping[str, object]) -> float:
    """The unit of a head in that of the column of a run which it names."""
    return 1.0 if head in known else UNITS[head[head.rindex("[") :]][1]


def _is_time(head: str) -> bool:
    return head.rpartition(" ")[0] == "t"


def named(path: str, head: str, known: Mapping[str, object]) -> str:
    """The name of the column of a run that a head of a file names. Errors as in `read_measured`."""
    if head in known:
        return head
    quantity, _, unit = head.rpartition(" ")
    if unit in UNITS and f"{quantity} {UNITS[unit][0]}" in known:
        return f"{quantity} {UNITS[unit][0]}"
    raise DataFileError(
        f"{path}: column {head!r}: not known; expected {short_list(list(known))}, or in deg, mm, µm, ms"
    )


def _numbers(path: Path, number: int, line: list[str], heads: list[str]) -> list[float]:
    found = []
    for cell, head in zip(line, heads, strict=True):
        try:
            found.append(float(cell) if cell.strip() else math.nan)
        except ValueError:
            raise DataFileError(f"{path}: line {number}, {head}: {cell!r} is not a number") from None
        if math.isinf(found[-1]):
            raise DataFileError(f"{path}: line {number}, {head}: {cell!r} is not finite")
    return found
