"""Sections of a blade from a file of BeamDyn, the beam solver of OpenFAST, in its axes: z along the blade."""

from pathlib import Path

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.data.documents import read_regular


def read_blade(path: Path) -> tuple[Array, Array, Array, list[float]] | None:
    """Read x from 0 to 1 (stations,), K and M (stations, 6, 6), and loss times [s]; None from another kind of file.

    Forces come before moments. Loss times are those of damping proportional to K, one per direction; [0] without it.
    """
    lines = read_regular(path, largest=100_000_000, error=DataFileError).decode("utf-8", "replace").splitlines()
    named = {words[1].casefold(): k for k, words in enumerate(map(str.split, lines)) if len(words) > 1}
    if "station_total" not in named:
        return None
    places = [named.get(key, len(lines)) for key in ("station_total", "damp_type")]
    count, damped = (int(_numbers(path, lines, at, 1)[0]) for at in places)
    start = next((k for k, line in enumerate(lines) if "distributed properties" in line.casefold()), len(lines))
    kept = [k for k in range(start + 1, len(lines)) if lines[k].strip()]
    size = 13  # lines of a station: its place, and two matrices
    if not 0 < size * count <= len(kept):
        text = f"{path}: {len(kept) // size} stations; station_total = {count}"
        raise DataFileError(text, id="blade-file")
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


def _numbers(path: Path, lines: list[str], at: int, count: int) -> list[float]:
    """The first numbers of a line; Fortran also writes 1.0D3."""
    words = lines[at].replace(",", " ").split()[:count] if at < len(lines) else []
    try:
        found = [float(word.upper().replace("D", "E")) for word in words]
    except ValueError:
        found = []
    if len(found) < count or not np.isfinite(found).all():
        shown = truncated(lines[at].strip()) if at < len(lines) else "the end"
        raise DataFileError(f"{path}: line {at + 1}: {shown}: expected {count} numbers", id="blade-file")
    return found
