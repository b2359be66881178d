"""Validation: the model compared with measurements, one line per group of quantities, for the first screen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from reports.wording import displayed
from validation.measured.uncertainty import VERDICTS
from validation.store import Series

WHAT = "measured"  # `what` of the series of measured cases
HEADS = ("measured", "quantities", "error E / D", "uncertainty u_val / D", *map(displayed, VERDICTS))
WORDS = (
    "E = S − D is the error of the simulation S against the measurement D. The validation uncertainty is "
    "u_val² = u_num² + u_input² + u_D²: discretization (grid convergence index), tolerances of the specimen, and the "
    "measurement. Nothing was fitted for these verdicts, except for the laboratory arm: two root stiffnesses, a "
    "damping ratio, the tilt of its axes, the position of the second axis, and gains and offsets of the strain gauges; "
    "its u_input is the covariance of that fit. Validated: |E| ≤ 2 u_val. This shows an accuracy of ± 2 u_val, however "
    "small E is. Not validated: |E| > 2 u_val, so the error of the model or of the specimen data exceeds the "
    "uncertainty. Cannot be decided: 2 u_val is larger than the required accuracy."
)


class Group(NamedTuple):
    """Quantities of a case that share a line of the table."""

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


class Counts(NamedTuple):
    """Numbers of measured quantities that are validated, not validated, and undecided."""

    validated: int
    not_validated: int
    undecided: int

    @property
    def all(self) -> int:
        """Number of quantities."""
        return sum(self)

    @property
    def all_validated(self) -> bool:
        """Whether all counted quantities are validated."""
        return self.validated == self.all

    @property
    def brief(self) -> str:
        """The counts in a few words."""
        return f"{self.validated} of {self.all} validated"

    @property
    def sentence(self) -> str:
        """The counts in a sentence."""
        return (
            f"{self.validated} of {self.all} measured quantities agree with the model within the uncertainty, "
            f"{self.not_validated} do not, and {self.undecided} cannot be decided: their "
            "uncertainty exceeds the required accuracy."
        )


def counts_of(verdicts: Iterable[str]) -> Counts | None:
    """How often each verdict of `VERDICTS` occurs; None without verdicts."""
    found = list(verdicts)
    return Counts(*(found.count(verdict) for verdict in VERDICTS)) if found else None


def total(results: Results) -> Counts | None:
    """Counts over all measured cases; None without measured cases."""
    return counts_of(verdict for group in groups(results) for verdict in group.columns["verdict"].tolist())


def by_case(results: Results) -> dict[str, Counts]:
    """Counts by case."""
    verdicts: dict[str, list[str]] = {}
    for group in groups(results):
        verdicts.setdefault(group.case, []).extend(group.columns["verdict"].tolist())
    return {case: counts for case, found in verdicts.items() if (counts := counts_of(found))}


def groups(results: Results) -> Iterator[Group]:
    """All groups of the study."""
    for case, series in results.showing(WHAT):
        yield from groups_of(case, results.cases[case][0].title, series)


def groups_of(case: str, title: str, series: Series) -> Iterator[Group]:
    """The groups of a case, in order."""
    of = series.columns["group"]
    for name in dict.fromkeys(of.tolist()):
        yield Group(case, title.partition(":")[0], name, {key: c[of == name] for key, c in series.columns.items()})


def table(results: Results) -> Table | None:
    """One line per group; None if the study has no measured case."""
    lines = tuple(_line(group) for group in groups(results))
    return Table("measurements", "Validation: comparison with measurements", HEADS, lines, (WORDS,)) if lines else None


def _line(group: Group) -> tuple[str | float, ...]:
    verdicts = group.columns["verdict"].tolist()
    counts = (float(verdicts.count(verdict)) for verdict in VERDICTS)
    return (f"{group.title}: {group.name}", float(len(verdicts)), span(group.error), span(group.u_val), *counts)


def span(percent: Array) -> str:
    """Range of percentages, "smallest … largest"."""
    low, high = (f"{number(float(each), 2)} %" for each in (percent.min(), percent.max()))
    return low if low == high else f"{low} … {high}"
