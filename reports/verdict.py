"""The verdict: which cases pass, how close to their bars, and the bottom line in words with computed numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from fnmatch import fnmatchcase

from reports.numbers import amount, plural
from reports.reasons import split_reasons
from reports.results import Results, used
from reports.tables import bar, share
from validation.store import Row


@dataclasses.dataclass(frozen=True)
class CaseVerdict:
    """One line of the verdict table."""

    case: str
    title: str
    passed: int
    judged: int  # rows with a bar
    informing: int  # rows without
    worst: Row | None  # the row that uses most of its bar
    seconds: float

    @property
    def state(self) -> str:
        """'FAIL', 'pass', or 'info' for a case without a bar."""
        if self.passed < self.judged:
            return "FAIL"
        return "pass" if self.judged else "info"

    @property
    def used(self) -> str:
        """How much of its bar the worst row uses."""
        return share(used(self.worst)) if self.worst else "–"


def judge(results: Results) -> list[CaseVerdict]:
    """All cases, failing ones first, otherwise in the order of the study."""
    verdicts = [_judge(case, rows) for case, rows in results.cases.items()]
    return sorted(verdicts, key=lambda verdict: verdict.state != "FAIL")


def _judge(case: str, rows: tuple[Row, ...]) -> CaseVerdict:
    judged = [row for row in rows if row.passed is not None]
    worst = max(judged, key=_hardness, default=None)
    return CaseVerdict(
        case=case,
        title=rows[0].title,
        passed=sum(row.passed is True for row in judged),
        judged=len(judged),
        informing=len(rows) - len(judged),
        worst=worst,
        seconds=sum(row.seconds or 0.0 for row in rows),
    )


def _hardness(row: Row) -> tuple[bool, float]:
    return row.passed is False, used(row) or 0.0


def describe(row: Row) -> str:
    """Where a row comes from: quantity, scene, engine, setting."""
    return ", ".join(part for part in (row.quantity, row.scene, row.engine, row.setting) if part)


def bottom_line(results: Results) -> str:
    """The outcome in one or two sentences, every number taken from the rows."""
    judged = [row for row in results.rows if row.passed is not None]
    failed = [row for row in judged if row.passed is False]
    cases = plural(len(results.cases), "case")
    given_up = [where for where, _ in informing_against_a_bar(results)]
    rest = (
        f" Not judged, though a bar was set for it: {'; '.join(given_up)} (see known limitations)." if given_up else ""
    )
    if failed:
        return f"{len(failed)} of {plural(len(judged), 'check')} FAIL ({cases}); they stand right below.{rest}"
    if not judged:
        return f"Nothing was judged: {plural(len(results.rows), 'row')} of information, none with a bar.{rest}"
    worst = max(judged, key=_hardness)
    return (
        f"All {len(judged)} checks pass ({cases}). The one closest to its bar uses {share(used(worst))} of it: "
        f"{describe(worst)}, {amount(worst.value, worst.unit)}, and the bar is {bar(worst)}.{rest}"
    )


def headlines(results: Results, wanted: Iterable[Mapping[str, str]]) -> list[str]:
    """A sentence for each wanted quantity that the study holds: its worst value, and where that is.

    Each of `wanted` has `kind`, `quantity` (a pattern), optionally `scene` and `setting`, and `text`, which
    may name {value}, {quantity} and {where}.
    """
    found = []
    for want in wanted:
        rows = [
            row
            for row in results.rows
            if row.kind == want["kind"]
            and fnmatchcase(row.quantity, want["quantity"])
            and row.scene == want.get("scene", row.scene)
            and row.setting == want.get("setting", row.setting)
            and row.value is not None
        ]
        if rows:
            pick = min if rows[0].bound == "at least" else max
            worst = pick(rows, key=lambda row: row.value or 0.0)
            where = ", ".join(part for part in (worst.scene, worst.engine) if part)
            value = amount(worst.value, worst.unit)
            found.append(want["text"].format(value=value, quantity=worst.quantity, where=where))
    return found


def informing_against_a_bar(results: Results) -> list[tuple[str, str]]:
    """(where, why) of quantities without a bar whose reason speaks of one: a bar was wanted, and is not kept."""
    found = {}
    for case, rows in results.cases.items():
        parts = split_reasons(rows)
        for row in rows:
            reason = parts[id(row)][0]
            if row.passed is None and "bar" in reason.split():
                found[f"{case}, {row.quantity}"] = reason
    return list(found.items())
