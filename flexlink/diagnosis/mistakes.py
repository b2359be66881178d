"""Table of mistakes in `data/mistakes.toml`: which field differs and how, the likely mistake, and the remedy."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array, Indices
from flexlink.data.documents import read_toml
from flexlink.diagnosis import patterns
from flexlink.diagnosis.patterns import Shape, moments


class Field(NamedTuple):
    """A field of the record: id of a difference, label, unit, and name in each format."""

    id: str
    label: str
    unit: str
    mjcf: str
    urdf: str
    sdf: str


class Mistake(NamedTuple):
    """The likely mistake and its remedy if `field` differs in this `shape` while `setting` is active."""

    field: str
    shape: Shape
    likely: str
    remedy: str
    setting: str = ""


class Table(NamedTuple):
    """Contents of the file: names of fields, units, settings of engines, likely mistakes."""

    fields: dict[str, Field]
    sliding_units: dict[str, str]
    length_units: dict[float, str]  # by the factor of a file's numbers
    settings: dict[str, tuple[str, str, str, bool]]  # id, text, remedy, whether it counts
    misplaced: dict[str, tuple[str, Field, str, str]]  # id, field to correct, likely mistake, remedy
    mistakes: list[Mistake]


@cache
def table() -> Table:
    """Return the table, which is read once."""
    raw = read_toml(Path(__file__).parent / "data" / "mistakes.toml")
    fields = {name: Field(**words) for name, words in raw["fields"].items()}
    every = fields | {name: Field(**words) for name, words in raw["misplaced_fields"].items()}
    mistakes = list[Mistake]()
    for row in raw["mistake"]:
        shape = getattr(patterns, row["shape"])  # or a function that returns one for the row's factors
        shape = shape(*row["factors"]) if "factors" in row else shape
        mistakes += [Mistake(f, shape, row["likely"], row["remedy"], row.get("setting", "")) for f in row["fields"]]
    placed = {k: (row["id"], every[row["field"]], row["likely"], row["remedy"]) for k, row in raw["misplaced"].items()}
    settings = {name: tuple(row.values()) for name, row in raw["settings"].items()}
    units = {factor: unit for unit, factor in raw["length_units"].items()}
    return Table(fields, raw["sliding_units"], units, settings, placed, mistakes)


def _where(names: Sequence[str], rows: Indices) -> str:
    """Text that names the joints for the entries of a field; pairs of joints for fields between two joints."""
    if rows.ndim == 1:
        return _names([names[k] for k in rows])
    shown = "; ".join(f"{names[i]!r} and {names[j]!r}" for i, j in rows[:3]) + " …" * (len(rows) > 3)
    return f"joints {shown}" if len(rows) == 1 else f"{len(rows)} pairs of joints ({shown})"


def _names(names: Sequence[str]) -> str:
    first = ", ".join(map(repr, names[:3]))
    return f"joint {first}" if len(names) == 1 else f"{len(names)} joints ({first}{' …' * (len(names) > 3)})"


def _short(value: Array) -> str:
    """Format a number, a vector, or the principal moments of an inertia."""
    numbers = moments(value) if np.ndim(value) == 2 else np.atleast_1d(value)
    text = ", ".join(f"{x + 0.0:.6g}" for x in numbers)
    return f"({text})" if len(numbers) > 1 else text
