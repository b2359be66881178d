"""What was measured: a CSV of times and columns of a trajectory, in its units or in those of instruments."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping
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


def read_measured(path: Path, known: Mapping[str, object]) -> Measured:
    """Read a CSV whose heads are "t [s]" and names of columns of a trajectory.

    Parameters
    ----------
    path
        The file.
    known
        What may be there, by the names of `Trajectory.columns`.

    Raises
    ------
    DataFileError
        The file cannot be read; a head that is not known, or twice; a cell that is no number; times that do not
        increase, or nothing measured.
    """
    try:
        text = read_regular(path, largest=100_000_000, error=DataFileError).decode("utf-8-sig")
        heads, *lines = [line for line in csv.reader(io.StringIO(text)) if any(cell.strip() for cell in line)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataFileError(f"{path}: is not CSV: {error}") from None
    except ValueError:
        raise DataFileError(f"{path}: is empty; expected a header line with a column {TIME!r}") from None
    names = [_named(path, head.strip(), known) for head in heads]
    twice = [name for name in names if names.count(name) > 1]
    if TIME not in names or twice:
        wrong = f"column {twice[0]!r} appears twice" if twice else f"no column {TIME!r}"
        raise DataFileError(f"{path}: {wrong}; columns: {short_list(heads)}")
    scales = [1.0 if head.strip() in known else UNITS[head[head.rindex("[") :].strip()][1] for head in heads]
    rows = [_numbers(path, number, line, heads) for number, line in enumerate(lines, 2)]
    values = np.array(rows).reshape(len(rows), len(heads)) * scales
    columns = dict(zip(names, values.T, strict=True))
    t = columns.pop(TIME)
    if len(t) < 2 or not (np.diff(t) > 0).all():
        raise DataFileError(f"{path}: {TIME}: expected two or more times, each later than the one before")
    if not any(np.isfinite(column).any() for column in columns.values()):
        raise DataFileError(f"{path}: no measured values; expected columns such as 'tip x [m]'")
    return Measured(t, columns)


def _named(path: Path, head: str, known: Mapping[str, object]) -> str:
    if head in known:
        return head
    quantity, _, unit = head.rpartition(" ")
    if unit in UNITS and f"{quantity} {UNITS[unit][0]}" in known:
        return f"{quantity} {UNITS[unit][0]}"
    raise DataFileError(
        f"{path}: column {head!r}: not known; expected {short_list(list(known))}, or in deg, mm, µm, ms"
    )


def _numbers(path: Path, number: int, line: list[str], heads: list[str]) -> list[float]:
    if len(line) != len(heads):
        raise DataFileError(f"{path}: line {number}: {len(line)} cells; the header line has {len(heads)}")
    found = []
    for cell, head in zip(line, heads, strict=True):
        try:
            found.append(float(cell) if cell.strip() else math.nan)
        except ValueError:
            raise DataFileError(f"{path}: line {number}, {head}: {cell!r} is not a number") from None
        if math.isinf(found[-1]):
            raise DataFileError(f"{path}: line {number}, {head}: {cell!r} is not finite")
    return found
