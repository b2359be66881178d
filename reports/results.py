"""Stored results of a study, as the report reads them: complete cases of the same sources, and missing cases."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path

from flexlink.common.errors import FlexlinkError
from validation.judgement import JudgedRow, judged_rows
from validation.store import STOPPED, Environment, Finished, Planned, Row, Series, Store

HOW = "make results with: python -m validation"
NEVER, OLDER = "not measured", "measured with other sources"
ERROR = "could not be run"


@dataclasses.dataclass(frozen=True)
class Missing:
    """A case of the study without results, with incomplete results, or with results of other sources."""

    case: str
    title: str
    why: str


@dataclasses.dataclass(frozen=True)
class Results:
    """A stored study, the only input of chapters and figures.

    Attributes
    ----------
    rows
        Rows of complete cases, measured with the sources and versions of the study's last run.
    finished
        Key, date and machine of the complete cases.
    missing
        All other cases of the study.
    """

    rows: tuple[JudgedRow, ...]
    environment: Environment
    store: Store
    finished: Mapping[str, Finished] = dataclasses.field(default_factory=dict)
    plan: Mapping[str, Planned] = dataclasses.field(default_factory=dict)
    missing: tuple[Missing, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Results:
        """Read a result folder.

        Raises
        ------
        FlexlinkError
            There are no results, or they are invalid.
        """
        for name in ("plan.json", "environment.json"):
            if not (path / name).is_file():
                raise FlexlinkError(f"{path}: no stored results ({name} is missing); {HOW}")
        store = Store(path)
        plan, stored, finished = store.plan(), store.rows(), store.finished()
        whole = {case: done for case, done in finished.items() if case in plan and done.key == plan[case].key}
        begun = {row.case for row in stored if row.case in plan and row.key == plan[row.case].key}
        older = {row.case for row in stored} - begun
        errors = {case: why if why == STOPPED else f"{ERROR}: {why}" for case, why in store.failed().items()}
        missing = [
            Missing(
                case,
                planned.title,
                errors.get(case) or (STOPPED if case in begun else OLDER if case in older else NEVER),
            )
            for case, planned in plan.items()
            if case not in whole
        ]
        place = {case: number for number, case in enumerate(plan)}
        rows = [row for row in stored if row.case in whole and row.key == whole[row.case].key]
        rows.sort(key=lambda row: place[row.case])
        return cls(judged_rows(rows, whole), store.environment(), store, whole, plan, tuple(missing))

    @cached_property
    def cases(self) -> dict[str, tuple[JudgedRow, ...]]:
        """Rows by case, in the order of the study."""
        found: dict[str, list[JudgedRow]] = {}
        for row in self.rows:
            found.setdefault(row.case, []).append(row)
        return {case: tuple(rows) for case, rows in found.items()}

    def of_kind(self, *kinds: str) -> Iterator[tuple[str, tuple[JudgedRow, ...]]]:
        """The cases of these kinds."""
        for case, rows in self.cases.items():
            if rows[0].kind in kinds:
                yield case, rows

    @cached_property
    def series(self) -> dict[str, tuple[Series, ...]]:
        """Every series by case."""
        return {case: tuple(self.store.series(case).values()) for case in self.cases}

    def showing(self, *what: str) -> Iterator[tuple[str, Series]]:
        """(case, series) of all series whose `what` is one of these."""
        for case, found in self.series.items():
            for series in found:
                if series.what in what:
                    yield case, series


def used(row: Row) -> float | None:
    """Fraction of its limit that a row uses, at most 1 if and only if the row passes; None without a limit.

    The fraction is value / tolerance for an upper limit, and tolerance / value for a lower one.
    """
    if row.tolerance is None:
        return None
    if row.value is None:
        return float("inf")
    over, under = (row.tolerance, row.value) if row.bound == "at least" else (row.value, row.tolerance)
    if over <= 0.0:
        return 0.0
    return over / under if under > 0.0 else float("inf")
