"""What was measured: a CSV of times and columns of a trajectory, in its units or in those of instruments."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.describe.csv_table import TIME, in_si, read_csv
from flexlink.describe.spec import short_list


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
    _, heads, values = read_csv(path)
    names, sizes = zip(*(_named(path, head, known) for head in heads), strict=True)
    twice = [name for name in names if names.count(name) > 1]
    if TIME not in names or twice:
        wrong = f"column {twice[0]!r} appears twice" if twice else f"no column {TIME!r}"
        raise DataFileError(f"{path}: {wrong}; columns: {short_list(heads)}")
    columns = dict(zip(names, (values * sizes).T, strict=True))
    t = columns.pop(TIME)
    if len(t) < 2 or not (np.diff(t) > 0).all():
        raise DataFileError(f"{path}: {TIME}: expected two or more times, each later than the one before")
    if not any(np.isfinite(column).any() for column in columns.values()):
        raise DataFileError(f"{path}: no measured values; expected columns such as 'tip x [m]'")
    return Measured(t, columns)


def _named(path: Path, head: str, known: Mapping[str, object]) -> tuple[str, float]:
    """The column that a head means, and the size of its unit there."""
    if head in known:
        return head, 1.0
    found = in_si(head)
    if found is not None and found[0] in known:
        return found
    raise DataFileError(
        f"{path}: column {head!r}: not known; expected {short_list(list(known))}, or in deg, mm, µm, ms"
    )
