"""What measurements say of the model, a line a group of quantities: the table of the first screen."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from validation.measured.uncertainty import VERDICTS
from validation.store import Series

WHAT = "measured"  # series of the kind `measured`
HEADS = ("measured", "quantities", "error E / D", "uncertainty u_val / D", *VERDICTS)
WORDS = (
    "E = S − D is the error of the model S against the measurement D. u_val² = u_num² + u_input² + u_D²: hinges (grid "
    "convergence index), tolerances of what is stated about the specimen, and the measurement itself. Nothing is "
    "fitted, but of the laboratory's arm two roots, a damping, the tilt of its axes, the second axis' place, and "
    "gains and zeros of the strains. Validated to u_val: |E| ≤ 2 u_val. Not validated: the model, or what is known "
    "of the specimen, is wrong by more than that. Cannot be told: 2 u_val "
    "is more than the accuracy that is asked for."
)


class Group(NamedTuple):
    """Quantities of one case that are judged together."""

    case: str
    title: str
    name: str
    columns: dict[str, NDArray[Any]]

    @property
    def error(self) -> Array:
        """E / D [%]."""
        found: Array = 100 * self.columns["E"] / self.columns["D"]
        return found

    @property
    def u_val(self) -> Array:
        """u_val / |D| [%]."""
        found: Array = 100 * self.columns["u_val"] / np.abs(self.columns["D"])
        return found


def groups(results: Results) -> Iterator[Group]:
    """All that the study holds."""
    for case, series in results.showing(WHAT):
        yield from groups_of(case, results.cases[case][0].title, series)


def groups_of(case: str, title: str, series: Series) -> Iterator[Group]:
    """The groups of a case, in the order in which it has them."""
    of = series.columns["group"]
    for name in dict.fromkeys(of.tolist()):
        yield Group(case, title.partition(":")[0], name, {key: c[of == name] for key, c in series.columns.items()})


def table(results: Results) -> Table | None:
    """A line a group; None where the study holds none."""
    lines = tuple(_line(group) for group in groups(results))
    return Table("measurements", "Prediction errors and uncertainty", HEADS, lines, (WORDS,)) if lines else None


def _line(group: Group) -> tuple[str | float, ...]:
    verdicts = group.columns["verdict"].tolist()
    counts = (float(verdicts.count(verdict)) for verdict in VERDICTS)
    return (f"{group.title}: {group.name}", float(len(verdicts)), span(group.error), span(group.u_val), *counts)


def span(percent: Array) -> str:
    """Smallest to largest."""
    low, high = (f"{number(float(each), 2)} %" for each in (percent.min(), percent.max()))
    return low if low == high else f"{low} … {high}"
