"""What a study left behind, as the report reads it. Nothing is measured here again."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

from flexlink.errors import FlexlinkError
from validation.store import Row, Series, Store

HOW = "make results with: python -m validation"


@dataclasses.dataclass(frozen=True)
class Results:
    """A stored study: the only thing that chapters and figures look at."""

    rows: tuple[Row, ...]
    environment: dict[str, Any]
    store: Store

    @classmethod
    def read(cls, path: Path) -> Results:
        """Read a result folder.

        Raises
        ------
        FlexlinkError
            There is none, it holds no row, or it cannot be understood.
        """
        if not (path / "rows.jsonl").is_file():
            raise FlexlinkError(f"{path}: no stored results (rows.jsonl is missing); {HOW}")
        store = Store(path)
        try:
            rows, environment = tuple(store.rows()), store.environment()
        except (TypeError, ValueError, OSError) as error:
            raise FlexlinkError(f"{path}: stored results that cannot be read: {error}; {HOW} --force") from None
        if not rows:
            raise FlexlinkError(f"{path}/rows.jsonl: holds no row; {HOW} --force")
        return cls(rows, environment, store)

    @cached_property
    def cases(self) -> dict[str, tuple[Row, ...]]:
        """Rows by case, in the order in which the study ran."""
        found: dict[str, list[Row]] = {}
        for row in self.rows:
            found.setdefault(row.case, []).append(row)
        return {case: tuple(rows) for case, rows in found.items()}

    def of_kind(self, *kinds: str) -> Iterator[tuple[str, tuple[Row, ...]]]:
        """The cases of these kinds."""
        for case, rows in self.cases.items():
            if rows[0].kind in kinds:
                yield case, rows

    @cached_property
    def series(self) -> dict[str, dict[str, Series]]:
        """Every series: case → name → series."""
        try:
            return {case: self.store.series(case) for case in self.cases}
        except (TypeError, ValueError, KeyError, OSError) as error:
            raise FlexlinkError(f"{self.store.path}/series: cannot be read: {error}; {HOW} --force") from None

    def series_named(self, name: str) -> Iterator[tuple[str, Series]]:
        """(case, series) wherever a case has a series of this name."""
        for case, found in self.series.items():
            if name in found:
                yield case, found[name]


def used(row: Row) -> float | None:
    """Share of the bar that a row uses up: at most 1 exactly when it passes; None without a bar.

    value / tolerance for an upper bar, tolerance / value for a lower one.
    """
    if row.tolerance is None:
        return None
    if row.value is None:
        return float("inf")
    over, under = (row.tolerance, row.value) if row.bound == "at least" else (row.value, row.tolerance)
    if over <= 0.0:
        return 0.0
    return over / under if under > 0.0 else float("inf")
