"""Measured data, from a CSV file with times and columns of a trajectory, in SI or instrument units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, short_list
from flexlink.data.csv_table import TIME, conversion, head_of, in_si, read_csv, units_like


class Measured(NamedTuple):
    """Times [s], shape (samples,), and measured columns at these times in SI units; nan where nothing was measured."""

    t: Array
    columns: dict[str, Array]


def read_measured(path: Path, known: Mapping[str, object], only: Sequence[str] = ()) -> Measured:
    """Read a CSV whose headers are "t [s]" and `known` column names of a trajectory; `only`: these columns."""
    _, heads, values = read_csv(path)
    return measured_from(str(path), heads, values, known, only)


def read_together(paths: Sequence[Path], known: Mapping[str, object], only: Sequence[str] = ()) -> Measured:
    """Read several files of one record, each with its own times; columns are nan at the times of other files."""
    tables = [read_csv(path) for path in paths]
    _require(", ".join(map(str, paths)), only, [head for table in tables for head in table.heads])
    parts: dict[Path, Measured] = {}
    for path, heads, values in tables:
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
