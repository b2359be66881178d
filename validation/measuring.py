"""Measure one case: its rows, each compared with its limit, and its series."""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from flexlink.common.errors import DataFileError, SceneError
from flexlink.describe.spec import decode
from validation.case import CLAIM, Case, Measured
from validation.kinds import KINDS, Kind
from validation.store import OURS, Row, Series


def measure(case: Case, key: str) -> Iterator[Row | Series]:
    """Checked rows and series of a case, as they are measured.

    Raises
    ------
    FlexlinkError
        The case cannot be run, or does not measure all of its quantities.
    """
    kind, settings = kind_of(case)
    missing = {quantity for quantity in case.quantity if case.demands(quantity)}
    rows: list[Row] = []
    start = time.perf_counter()
    for result in kind.measurements(case, settings):
        if isinstance(result, Series):
            yield result
        elif result.quantity in case.quantity:  # a case may use only some quantities of its kind
            rows.append(judged(case, result, time.perf_counter() - start, key))
            yield rows[-1]
            missing.discard(result.quantity)
            start = time.perf_counter()
    if missing:  # a limit that was not measured must not appear to be met
        raise DataFileError(
            f"{case.path}: quantity.{min(missing)}: kind {case.kind!r} does not measure it here", id="unknown-quantity"
        )
    yield from wrong_counts(case, rows)


def kind_of(case: Case) -> tuple[Kind, Any]:
    """The kind of a case, and its settings."""
    kind = KINDS.get(case.kind)
    if kind is None:
        raise DataFileError(
            f"{case.path}: kind = {case.kind!r}: unknown; allowed are {', '.join(sorted(KINDS))}", id="unknown-name"
        )
    try:
        return kind, decode(case.settings, kind.settings, "settings")
    except SceneError as error:
        raise DataFileError(f"{case.path}: {error}") from None


def judged(case: Case, measured: Measured, seconds: float, key: str) -> Row:
    """Make the row of a number, which passes if it is on the right side of the case's tolerance; nan never passes."""
    quantity = case.quantity[measured.quantity]
    tolerance = None if quantity.tolerance is None else quantity.tolerance * measured.scale
    value = float(measured.value) if math.isfinite(measured.value) else None  # JSON has no nan
    passed = None
    if tolerance is not None:
        passed = measured.value <= tolerance if quantity.bound == "at most" else measured.value >= tolerance
    claim = {CLAIM: case.claim} if case.claim and measured.quantity == CLAIM else {}
    return Row(
        case=case.name, kind=case.kind, title=case.title, scene=measured.scene, engine=measured.engine,
        varied={**claim, **measured.varied}, quantity=measured.quantity, metric=quantity.metric,
        value=value, unit=quantity.unit, tolerance=tolerance, bound=quantity.bound,
        passed=None if passed is None else bool(passed), timed=measured.timed, reason=quantity.reason,
        note=measured.note, given_up=quantity.given_up, seconds=round(seconds, 3), key=key,
        widened=quantity.widened,
    )  # fmt: skip


ROWS_OF = "rows of "


def wrong_counts(case: Case, rows: Sequence[Row]) -> Iterator[Row]:
    """Yield a failed check for every quantity whose number of measurements differs from the number in the case."""
    for name in dict.fromkeys(row.quantity for row in rows):
        own, stated = [row for row in rows if row.quantity == name], case.quantity[name].rows
        if stated == "by machine" or own[0].timed:
            continue
        if len(own) != stated:
            yield _wrong_count(own[0], len(own), stated, f"The case states {stated}; measured: {_where(own)}.")
        twice = [measured for measured, times in Counter(_measured(row) for row in own).items() if times > 1]
        if twice:
            yield _wrong_count(own[0], len(own), len(own) - len(twice), f"Measured twice: {twice[0]}.")


def _measured(row: Row) -> str:
    """Scene, engine and varied conditions of a row."""
    return ", ".join([row.scene, row.engine, *(f"{name} {value}" for name, value in row.varied.items())])


def _where(rows: Sequence[Row]) -> str:
    """Number of rows for each scene and engine."""
    counts = Counter(" ".join(part for part in (row.scene, row.engine) if part) for row in rows)
    return ", ".join(f"{count} {where}" for where, count in counts.items())


def _wrong_count(row: Row, found: int, stated: int, note: str) -> Row:
    return dataclasses.replace(
        row, scene="", engine=OURS, varied={}, quantity=f"{ROWS_OF}{row.quantity}", metric="rows measured", unit="rows",
        value=float(found), tolerance=float(stated), bound="at least" if found < stated else "at most", passed=False,
        reason="No measurement is skipped silently: the case states how often each quantity is measured.", note=note,
        given_up="", seconds=0.0,
    )  # fmt: skip
