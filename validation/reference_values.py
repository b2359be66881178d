"""Published and computed reference values; numbers are strings of all known digits.

Values of the benchmark package `validation/bench` are stored there only; all others in `validation/reference`.
"""

from __future__ import annotations

import datetime
import functools
import json
from pathlib import Path
from typing import Any

import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.common.output import write_text
from flexlink.common.types import Array

REFERENCE_FOLDER = Path(__file__).parent / "reference"
BENCH_FOLDER = Path(__file__).parent / "bench" / "flexarm_bench" / "references"
FOLDERS = (REFERENCE_FOLDER, BENCH_FOLDER)


def reference_file(name: str) -> Path:
    """The file of a reference, in the benchmark package if that has it."""
    shared = BENCH_FOLDER / f"{name}.json"
    return shared if shared.is_file() else REFERENCE_FOLDER / f"{name}.json"


@functools.cache
def _file(name: str) -> Any:
    return json.loads(reference_file(name).read_text(encoding="utf-8"))["reference"]


def look_up(name: str, *keys: str) -> Any:
    """Entry at `keys` in the `reference` part of a file.

    Raises
    ------
    DataFileError
        The file or a key does not exist.
    """
    if not reference_file(name).is_file():
        known = ", ".join(sorted(path.stem for folder in FOLDERS for path in folder.glob("*.json")))
        raise DataFileError(f"reference = {name!r}: no such file; available: {known}")
    found = _file(name)
    for key in keys:
        if key not in found:
            raise DataFileError(f"reference {name}: key {key!r} is missing; available: {', '.join(found)}")
        found = found[key]
    return found


def store_reference(name: str, about: str, source: str, seconds: float, **rest: Any) -> None:
    """Write a file of values that the program `source` has computed in `seconds` of CPU time."""
    document = {
        "about": about, "source": source, "date": datetime.date.today().isoformat(), "cpu_seconds": round(seconds, 1),
    }  # fmt: skip
    path = reference_file(name)
    path.parent.mkdir(exist_ok=True)
    write_text(path, json.dumps(document | rest, indent=1, ensure_ascii=False) + "\n")


def reference_array(name: str, *keys: str) -> Array:
    """A number or list of numbers of a reference file, rounded to float64."""
    return np.array(look_up(name, *keys), dtype=np.float64)
