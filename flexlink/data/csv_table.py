"""Strict reading and unit conversion of CSV files whose headers are quantities with units, such as "q upper [deg]"."""

import csv
import difflib
import io
import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, plural, short_list, truncated
from flexlink.data.documents import read_text, read_toml

TIME = "t [s]"
PER = {"": "", "/s": "/s", "/s²": "/s²", "/s^2": "/s²"}  # suffixes that may follow a unit, and their SI form


@cache
def units() -> dict[str, tuple[str, float]]:
    """Units allowed in headers, with their SI unit and conversion factor."""
    rows = read_toml(Path(__file__).with_name("units.toml"))
    return {name: (si, size) for si, sizes in rows.items() for name, size in sizes.items()}


class CsvTable(NamedTuple):
    """Headers and numbers of a file; an empty cell is nan."""

    path: Path
    heads: tuple[str, ...]
    values: Array  # (rows, heads)
    lines: Sequence[int]  # of the file, in which the rows are

    @property
    def quantities(self) -> set[str]:
        """Quantities in the headers, without units."""
        return {head_of(head)[0] for head in self.heads}

    def column(self, quantity: str, unit: str) -> Array:
        """Return the column of a quantity, converted to `unit`; every cell must be a number."""
        found = [k for k, head in enumerate(self.heads) if head_of(head)[0] == quantity]
        wanted = f"{quantity} [{unit}]"
        if not found:
            zeros = "; for a joint without torque, add a column of zeros" if quantity.startswith("tau ") else ""
            text = f"{self.path}: no column {wanted!r}; columns: {short_list(self.heads)}"
            text += self._misspelt(quantity, unit) or zeros
            raise DataFileError(text, id="no-such-column")
        if len(found) > 1:
            why = f"{self.path}: column {quantity!r} appears twice: {short_list(self.heads)}"
            raise DataFileError(why, id="column-twice")
        given, column = head_of(self.heads[found[0]])[1], self.values[:, found[0]]
        if not given:
            why = f"{self.path}: column {quantity!r}: without a unit; expected one, as in {wanted!r}"
            raise DataFileError(why, id="unit-missing")
        factor = conversion(given, unit)
        if factor is None:
            fitting = ", ".join(units_like(unit))
            why = f"{self.path}: column {self.heads[found[0]]!r}: unit must be one of {fitting}"
            raise DataFileError(why, id="unit-unknown")
        if np.isnan(column).any():
            line = self.lines[int(np.argmax(np.isnan(column)))]
            why = f"{self.path}: line {line}, {self.heads[found[0]]}: empty; expected a number"
            raise DataFileError(why, id="csv-cell")
        return column * factor

    def _misspelt(self, quantity: str, unit: str) -> str:
        """Remedy if a header is this quantity in other letters, or names its joint; empty for those of other joints."""
        heads = [head for head in self.heads if conversion(head_of(head)[1] or unit, unit)]
        joint = rf"(?<![^\W_]){re.escape(quantity.partition(' ')[2])}(?![^\W_])" if " " in quantity else ""
        own = [head for head in heads if re.search(joint, head_of(head)[0])]
        if len(own) != 1:
            names = {head_of(head)[0].casefold(): head for head in heads}
            own = [names[near] for near in difflib.get_close_matches(quantity.casefold(), names, n=1, cutoff=0.85)]
        return "".join(f"; if {head!r} is meant, name it '{quantity} [{head_of(head)[1] or unit}]'" for head in own)

    @property
    def times(self) -> Array:
        """Strictly increasing times [s]."""
        t = self.column("t", "s")
        late = np.flatnonzero(np.diff(t) <= 0)
        if len(late):
            line = self.lines[late[0] + 1]
            text = f"t = {float(t[late[0] + 1])!r} s: must be later than the one before, {float(t[late[0]])!r} s"
            raise DataFileError(f"{self.path}: line {line}: {text}", id="times-not-increasing")
        return t


def head_of(head: str) -> tuple[str, str]:
    """Quantity and unit of a header; the unit is "" if there are no brackets."""
    found = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]", head.strip())
    return (found[1], found[2].strip()) if found else (head.strip(), "")


def conversion(given: str, wanted: str) -> float | None:
    """Factor from one unit to another; None if they measure different quantities or one is unknown."""
    one, other = _split(given), _split(wanted)
    if one is None or other is None or one[0] != other[0]:
        return None
    return 1.0 if given == wanted else one[1] / other[1]


def _split(unit: str) -> tuple[str, float] | None:
    """SI unit for a given unit, and the conversion factor; None if the unit is unknown."""
    for per, written in PER.items():
        base, size = units().get(unit.removesuffix(per) if per else unit, ("", 0.0))
        if base and (not per or (unit.endswith(per) and base in {"rad", "m"})):
            return base + written, size
    return None


def units_like(unit: str) -> list[str]:
    """All header units that can be converted to a unit."""
    known = [f"{base}{per}" for per in dict.fromkeys(PER.values()) for base in units()]
    return [name for name in known if conversion(name, unit) is not None]


def in_si(head: str) -> tuple[str, float] | None:
    """The same header in SI units, and the factor from its unit to SI; None if the unit is unknown."""
    quantity, unit = head_of(head)
    split = _split(unit)
    return None if split is None else (f"{quantity} [{split[0]}]", split[1])


def read_csv(path: Path) -> CsvTable:
    """Read comma-separated numbers below one header line; blank lines are skipped."""
    text = read_text(path, largest=100_000_000, error=DataFileError)
    try:
        every = csv.reader(io.StringIO(text, newline=None))
        (_, heads), *lines = [(every.line_num, line) for line in every if any(cell.strip() for cell in line)]
    except csv.Error as error:
        raise DataFileError(f"{path}: is not CSV: {error}", id="not-csv") from None
    except ValueError:
        why = f"{path}: is empty; expected a header line with a column {TIME!r}"
        raise DataFileError(why, id="file-empty") from None
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(heads) == 1 and sign in heads[0]:
            why = f"{path}: cells are separated by {name}; expected commas, and decimal points"
            raise DataFileError(why, id="not-csv")
    heads = [head.strip() for head in heads]
    if not any(head_of(head)[1] for head in heads):  # may be another kind of file, so do not quote its content
        why = f"{path}: no name with its unit in the first line; expected names such as {TIME!r} and 'tip z [m]'"
        raise DataFileError(why, id="not-csv")
    rows = np.array([_numbers(path, number, line, heads) for number, line in lines], dtype=np.float64)
    return CsvTable(path, tuple(heads), rows.reshape(len(lines), len(heads)), [number for number, _ in lines])


def _numbers(path: Path, number: int, line: list[str], heads: list[str]) -> list[float]:
    if len(line) != len(heads):
        text = f"{path}: line {number}: {plural(len(line), 'cell')}; the header line has {len(heads)}"
        raise DataFileError(text, id="csv-cell")
    found = []
    for cell, head in zip(line, heads, strict=True):
        try:
            found.append(float(cell) if cell.strip() else math.nan)
        except ValueError:
            found.append(math.inf)
        # Python's float also accepts 1_000 and digits of other scripts
        if "_" in cell or not cell.isascii() or (cell.strip() and not math.isfinite(found[-1])):
            raise DataFileError(f"{path}: line {number}, {head}: {truncated(cell)} is no finite number", id="csv-cell")
    return found


# Measured data, from CSV files with times and columns of a trajectory, in SI or instrument units.


class Measured(NamedTuple):
    """Times [s], shape (samples,), and measured columns at these times in SI units; nan where nothing was measured."""

    t: Array
    columns: dict[str, Array]


def read_measured(paths: Sequence[Path], known: Mapping[str, object], only: Sequence[str] = ()) -> Measured:
    """Read CSV files of one record, each with its own times; columns are nan at the times of other files.

    Headers are "t [s]" and `known` column names of a trajectory; `only`: these columns.
    """
    tables = [read_csv(path) for path in paths]
    _require(", ".join(map(str, paths)), only, [head for table in tables for head in table.heads])
    parts: dict[Path, Measured] = {}
    for path, heads, values, _ in tables:
        own = [head for head in only if head in heads]
        if own or not only:
            parts[path] = measured_from(str(path), heads, values, known, own)
    t = np.unique(np.concatenate([part.t for part in parts.values()]))
    columns: dict[str, Array] = {}
    for path, part in parts.items():
        at = np.searchsorted(t, part.t)
        for name, column in part.columns.items():
            if name in columns:
                other = next(one for one, before in parts.items() if name in before.columns)
                text = f"{path}: column {name!r} is also in {other}; remove it from one file"
                raise DataFileError(text, id="column-twice")
            columns[name] = np.full(len(t), np.nan)
            columns[name][at] = column
    return Measured(t, columns)


def _require(where: str, wanted: Sequence[str], heads: Sequence[str]) -> None:
    """Refuse a wanted column that does not exist."""
    absent = [name for name in wanted if name not in heads]
    if absent:
        text = f"{where}: no column {absent[0]!r}{did_you_mean(absent[0], heads)}; columns: {short_list(list(heads))}"
        raise DataFileError(text, id="no-such-column")


def measured_from(
    where: str, heads: Sequence[str], values: Array, known: Mapping[str, object], only: Sequence[str] = ()
) -> Measured:
    """Return measured data from columns, shape (samples, heads), and their headers; see `read_measured`."""
    _require(where, only, heads)
    counted = [k for k, head in enumerate(heads) if not only or head in only or (in_si(head) or ("",))[0] == TIME]
    names, sizes = zip(*(named(where, heads[k], known) for k in counted), strict=True)
    twice = [name for name in names if names.count(name) > 1]
    if TIME not in names or twice:
        wrong = f"column {twice[0]!r} appears twice" if twice else f"no column {TIME!r}"
        raise DataFileError(f"{where}: {wrong}; columns: {short_list(list(heads))}", id="no-such-column")
    columns = dict(zip(names, (values[:, counted] * sizes).T, strict=True))
    t = columns.pop(TIME)
    if len(t) < 2 or not (np.diff(t) > 0).all():
        late = np.flatnonzero(np.diff(t) <= 0)
        first = f"; {float(t[late[0] + 1])!r} comes after {float(t[late[0]])!r}" if len(late) else ""
        text = f"{where}: {TIME}: expected two or more times, each later than the one before{first}"
        raise DataFileError(text, id="times-not-increasing")
    if not any(np.isfinite(column).any() for column in columns.values()):
        raise DataFileError(f"{where}: no measured values; expected columns such as 'tip x [m]'", id="no-such-column")
    return Measured(t, columns)


def named(where: str, head: str, known: Mapping[str, object]) -> tuple[str, float]:
    """Name of the trajectory column for a header, and the factor from the header's unit to the column's unit."""
    if head in known:
        return head, 1.0
    found = in_si(head)
    if found is not None and found[0] in known:
        return found
    raise DataFileError(f"{where}: column {head!r}: {_why_unknown(head, known)}", id="no-such-column")


def _why_unknown(head: str, known: Mapping[str, object]) -> str:
    """Explain why a header is unknown (quantity or unit), and suggest which column was meant."""
    quantity, unit = head_of(head)
    same = next((name for name in known if head_of(name)[0] == quantity), None)
    if same is not None:
        fitting = ", ".join(units_like(head_of(same)[1]))
        return f"{'without a unit' if not unit else 'not known with this unit'}; expected {same!r} (units: {fitting})"
    alike = [name for name in known if conversion(unit, head_of(name)[1]) is not None and name != TIME]
    alike = [name.replace(f"[{head_of(name)[1]}]", f"[{unit}]") for name in alike]
    others = f"columns in {unit} are {short_list(alike)}" if alike else ""
    expected = others or f"expected {short_list(list(known))}, or in deg, mm, µm, ms"
    return (
        f"not known; {expected}; remove the column if it is not needed (in a fit: list the needed ones in compare)"
        f"{did_you_mean(head, alike or known)}"
    )
