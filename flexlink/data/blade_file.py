"""Sections and centre line of a blade from files of BeamDyn, the beam solver of OpenFAST; lines also from CSV files."""

import re
from pathlib import Path

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.common.wording import plural, truncated
from flexlink.data.csv_table import read_csv
from flexlink.data.documents import read_regular


def read_blade(path: Path) -> tuple[Array, Array, Array, list[float]] | None:
    """Read x from 0 to 1 (stations,), K and M (stations, 6, 6), and loss times [s]; None from another kind of file.

    Axes are BeamDyn's, z along the blade. The file is a blade file, or a primary file, which names it. Forces come
    before moments. Loss times are those of damping proportional to K, one per direction; [0] without it.
    """
    lines, named = _read(path)
    if "bldfile" in named:
        path = path.parent / named["bldfile"][1]
        lines, named = _read(path)
        if "station_total" not in named:
            raise DataFileError(f"{path}: no station_total; expected a blade file of BeamDyn", id="blade-file")
    if "station_total" not in named:
        return None
    places = [named.get(key, (len(lines), ""))[0] for key in ("station_total", "damp_type")]
    count, damped = (int(_numbers(path, lines, at, 1)[0]) for at in places)
    start = next((k for k, line in enumerate(lines) if "distributed properties" in line.casefold()), len(lines))
    kept = [k for k in range(start + 1, len(lines)) if lines[k].strip()]
    size = 13  # lines of a station: its place, and two matrices
    if not 0 < size * count <= len(kept):
        raise DataFileError(f"{path}: {len(kept) // size} stations; station_total = {count}", id="blade-file")
    x, matrices = np.empty(count), np.empty((count, 12, 6))
    for k, at in enumerate(kept[: size * count]):
        if k % size:
            matrices[k // size, k % size - 1] = _numbers(path, lines, at, 6)
        else:
            x[k // size] = _numbers(path, lines, at, 1)[0]
    by_stiffness = 1
    if damped not in {0, by_stiffness}:
        text = f"{path}: damp_type = {damped}: damping by modes is not read; set it to 0, and give loss_time"
        raise DataFileError(text, id="blade-file")
    after_units = 3  # the line "mu1 …", its units, the numbers
    loss = _numbers(path, lines, places[1] + 1 + after_units, 6) if damped else [0.0]
    return x, matrices[:, :6], matrices[:, 6:], loss


def read_centre_line(path: Path, *, twisted: bool = False) -> Array:
    """Read points of a beam's axis, x along it [m], (k, 3) from a CSV file; from a primary input file, (k, 4).

    The last column is then the angle of the sections about x [rad], which BeamDyn counts about −z. `twisted` files need
    it. The last key point of a member is the first of the next.
    """
    lines, named = _read(path)
    if "kp_total" not in named:
        if twisted:
            raise DataFileError(f"{path}: no kp_total; expected a primary input file of BeamDyn", id="blade-file")
        table = read_csv(path)
        return np.column_stack([table.column(axis, "m") for axis in "xyz"])
    places = [named.get(key, (len(lines), ""))[0] for key in ("member_total", "kp_total")]
    members, count = (int(_numbers(path, lines, at, 1)[0]) for at in places)
    first = places[1] + 1  # lines of members follow, two headers, and lines of key points
    of_members = sum(int(_numbers(path, lines, first + k, 2)[1]) for k in range(members)) - members + 1
    if count != of_members:
        raise DataFileError(f"{path}: kp_total = {count}; its members have {of_members}", id="blade-file")
    keys = [_numbers(path, lines, first + members + 2 + k, 4) for k in range(count)]
    return np.reshape(keys, (-1, 4))[:, [2, 0, 1, 3]] * [1.0, 1.0, 1.0, -np.pi / 180]


def _read(path: Path) -> tuple[list[str], dict[str, tuple[int, str]]]:
    """Lines of a file, and the place and value of those that begin with a value and its name, by this name."""
    lines = read_regular(path, largest=100_000_000, error=DataFileError).decode("utf-8", "replace").splitlines()
    found = (re.match(r"""\s*("[^"]*"|'[^']*'|\S+)\s+(\S+)""", line) for line in lines)
    return lines, {line[2].casefold(): (k, line[1].strip("\"'")) for k, line in enumerate(found) if line is not None}


def _numbers(path: Path, lines: list[str], at: int, count: int) -> list[float]:
    """The first numbers of a line; Fortran also writes 1.0D3."""
    words = lines[at].replace(",", " ").split()[:count] if at < len(lines) else []
    try:
        found = [float(word.upper().replace("D", "E")) for word in words]
    except ValueError:
        found = []
    if len(found) < count or not np.isfinite(found).all():
        shown = truncated(lines[at].strip()) if at < len(lines) else "the end"
        raise DataFileError(f"{path}: line {at + 1}: {shown}: expected {plural(count, 'number')}", id="blade-file")
    return found
