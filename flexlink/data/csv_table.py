"""A CSV file whose heads are quantities with their units, "q upper [deg]": read strictly, converted by name."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.files import read_regular
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list, truncated

TIME = "t [s]"
UNITS = {
    "rad": ("rad", 1.0), "deg": ("rad", math.pi / 180), "mrad": ("rad", 1e-3),
    "m": ("m", 1.0), "mm": ("m", 1e-3), "µm": ("m", 1e-6), "um": ("m", 1e-6),
    "s": ("s", 1.0), "ms": ("s", 1e-3),
    "N m": ("N m", 1.0), "N mm": ("N m", 1e-3), "kN m": ("N m", 1e3), "N": ("N", 1.0), "kN": ("N", 1e3),
    "N m²": ("N m²", 1.0), "N m^2": ("N m²", 1.0), "kN m²": ("N m²", 1e3), "kN m^2": ("N m²", 1e3),
    "N mm²": ("N m²", 1e-6), "N mm^2": ("N m²", 1e-6), "kg/m": ("kg/m", 1.0), "g/m": ("kg/m", 1e-3),
    "kg m": ("kg m", 1.0),
}  # fmt: skip
"""Units of heads, each with the one in SI and its size in it; "/s" and "/s²" may follow those of angles and lengths."""
WITH_RATES = {"rad", "m"}
PER = {"": "", "/s": "/s", "/s²": "/s²", "/s^2": "/s²"}
"""What may follow a unit, and how it is written in SI."""


class CsvTable(NamedTuple):
    """Heads and numbers of a file; nan where a cell is empty."""

    path: Path
    heads: tuple[str, ...]
    values: Array  # (rows, heads)

    @property
    def quantities(self) -> set[str]:
        """What the heads say, without their units."""
        return {head_of(head)[0] for head in self.heads}

    def column(self, quantity: str, unit: str) -> Array:
        """The column of a quantity in a unit, every cell of it a number.

        Raises
        ------
        DataFileError
            There is none, or two; its head has no unit, or one that does not fit; a cell is empty.
        """
        found = [k for k, head in enumerate(self.heads) if head_of(head)[0] == quantity]
        wanted = f"{quantity} [{unit}]"
        if not found:
            raise DataFileError(
                f"{self.path}: no column {wanted!r}; columns: {short_list(self.heads)}"
                f"{did_you_mean(wanted, [head for head in self.heads if head != TIME])}",
                id="no-such-column",
            )
        if len(found) > 1:
            raise DataFileError(
                f"{self.path}: column {quantity!r} appears twice: {short_list(self.heads)}", id="column-twice"
            )
        given, column = head_of(self.heads[found[0]])[1], self.values[:, found[0]]
        if not given:
            raise DataFileError(
                f"{self.path}: column {quantity!r}: without a unit; expected one, as {wanted!r} has", id="unit-missing"
            )
        factor = conversion(given, unit)
        if factor is None:
            fitting = ", ".join(units_like(unit))
            raise DataFileError(
                f"{self.path}: column {self.heads[found[0]]!r}: unit must be one of {fitting}", id="unit-unknown"
            )
        if np.isnan(column).any():
            line = int(np.argmax(np.isnan(column))) + 2
            raise DataFileError(
                f"{self.path}: line {line}, {self.heads[found[0]]}: empty; expected a number", id="csv-cell"
            )
        return column * factor

    @property
    def times(self) -> Array:
        """Times [s], which increase.

        Raises
        ------
        DataFileError
            They do not, or as in `column`.
        """
        t = self.column("t", "s")
        late = np.flatnonzero(np.diff(t) <= 0)
        if len(late):
            line = int(late[0]) + 3
            raise DataFileError(
                f"{self.path}: line {line}: t = {float(t[late[0] + 1])!r} s: must be later than the one before, "
                f"{float(t[late[0]])!r} s",
                id="times-not-increasing",
            )
        return t


def head_of(head: str) -> tuple[str, str]:
    """What stands in the column of a head, and the unit in brackets without blanks around it, "" without one."""
    found = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", head.strip())
    return (found[1], found[2].strip()) if found else (head.strip(), "")


def conversion(given: str, wanted: str) -> float | None:
    """What one unit is in another one; None where they measure different things, or one is not known."""
    one, other = _split(given), _split(wanted)
    if one is None or other is None or one[0] != other[0]:
        return None
    return 1.0 if given == wanted else one[1] / other[1]


def _split(unit: str) -> tuple[str, float] | None:
    """The unit in SI, and its size in it."""
    for per, written in PER.items():
        base, size = UNITS.get(unit.removesuffix(per) if per else unit, ("", 0.0))
        if base and (not per or (unit.endswith(per) and base in WITH_RATES)):
            return base + written, size
    return None


def units_like(unit: str) -> list[str]:
    """All units that heads can have in place of one."""
    return [name for name in every_unit() if conversion(name, unit) is not None]


def every_unit() -> list[str]:
    """All units that heads can have."""
    return [
        f"{unit}{per}"
        for per in dict.fromkeys(PER.values())
        for unit, (base, _) in UNITS.items()
        if not per or base in WITH_RATES
    ]


def in_si(head: str) -> tuple[str, float] | None:
    """A head's quantity with its unit in SI, and the size of the head's own; None where that is not known."""
    quantity, unit = head_of(head)
    split = _split(unit)
    return None if split is None else (f"{quantity} [{split[0]}]", split[1])


def read_csv(path: Path) -> CsvTable:
    """Read a file of comma-separated numbers below one line of heads; blank lines do not count.

    Raises
    ------
    DataFileError
        The file cannot be read, or is empty; no head has a unit; a line has more or fewer cells than the heads; a cell
        is no finite number, of digits 0 to 9.
    """
    data = read_regular(path, largest=100_000_000, error=DataFileError)
    try:
        text = data.decode("utf-8-sig")
        heads, *lines = [
            line for line in csv.reader(io.StringIO(text, newline=None)) if any(cell.strip() for cell in line)
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataFileError(f"{path}: is not CSV: {error}", id="not-csv") from None
    except ValueError:
        raise DataFileError(
            f"{path}: is empty; expected a header line with a column {TIME!r}", id="file-empty"
        ) from None
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(heads) == 1 and sign in heads[0]:
            raise DataFileError(
                f"{path}: cells are separated by {name}; expected commas, and points in decimals", id="not-csv"
            )
    heads = [head.strip() for head in heads]
    if not any(head_of(head)[1] for head in heads):  # of another kind of file nothing is quoted
        raise DataFileError(
            f"{path}: its first line has no column with a unit, such as {TIME!r}; expected CSV", id="not-csv"
        )
    rows = [_numbers(path, number, line, heads) for number, line in enumerate(lines, 2)]
    return CsvTable(path, tuple(heads), np.array(rows, dtype=np.float64).reshape(len(rows), len(heads)))


def _numbers(path: Path, number: int, line: list[str], heads: list[str]) -> list[float]:
    if len(line) != len(heads):
        raise DataFileError(
            f"{path}: line {number}: {len(line)} cells; the header line has {len(heads)}", id="csv-cell"
        )
    found = []
    for cell, head in zip(line, heads, strict=True):
        try:
            if "_" in cell or not cell.isascii():  # which Python reads as numbers
                raise ValueError
            found.append(float(cell) if cell.strip() else math.nan)
        except ValueError:
            raise DataFileError(
                f"{path}: line {number}, {head}: {truncated(cell)} is not a number", id="csv-cell"
            ) from None
        if not math.isfinite(found[-1]) and cell.strip():
            raise DataFileError(f"{path}: line {number}, {head}: {truncated(cell)} is not finite", id="csv-cell")
    return found
