"""Two independent verdicts on stored rows: correctness, and speed on this machine."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

from flexlink.common.wording import plural
from validation.store import Conditions, Finished, Row

SHOWN = 5  # most cases named in a sentence
State = Literal["FAIL", "missed", "not measured", "met", "pass", "info"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JudgedRow(Row):
    """A row with its verdict, and with the machine's load while its case was timed.

    Attributes
    ----------
    state
        pass or FAIL for a check of correctness; met, missed or not measured (on a busy machine) for a time limit; info
        without a limit.
    conditions
        None if nothing was timed or the case is not finished.
    """

    state: State
    conditions: Conditions | None

    @property
    def busy(self) -> bool:
        """Whether the row was timed on a busy machine."""
        return self.timed and self.conditions is not None and self.conditions.busy


class Correctness(NamedTuple):
    """Number of checks of correctness, and the rows of those that fail."""

    judged: int
    failed: tuple[Row, ...]


def passing(passed: int, checks: int) -> str:
    """State the number of passed checks, as in '1 of 1 check passes', '1 of 9 checks passes', '2 of 9 checks pass'."""
    return f"{passed} of {plural(checks, 'check')} {'passes' if passed == 1 else 'pass'}"


class Speed(NamedTuple):
    """Rows with a time limit, by outcome."""

    met: tuple[Row, ...]
    missed: tuple[Row, ...]
    unmeasured: tuple[Row, ...]
    worst: Conditions | None  # load of the busiest machine used for timing

    def brief(self) -> str:
        """The verdict in brief, "3 met, 1 missed"; empty without a time limit."""
        named = ((self.met, "met"), (self.missed, "missed"), (self.unmeasured, "not measured"))
        return ", ".join(f"{len(rows)} {word}" for rows, word in named if rows)

    def sentence(self) -> str:
        """The verdict in one line."""
        parts = [f"{len(rows)} {word}" for rows, word in ((self.met, "met"), (self.missed, "missed")) if rows]
        if parts:
            parts[-1] += " on this machine"
        if self.unmeasured:
            load = f" ({crowd(self.worst)})" if self.worst else ""
            parts.append(f"{len(self.unmeasured)} not measured because the machine was busy{load}")
        return ", ".join(parts) or "no time limit was checked"


def crowd(conditions: Conditions) -> str:
    """Describe the other load on a machine."""
    spread = f"fixed loop {100 * conditions.spread:.0f} % slower than its best"
    if conditions.load is None:
        return spread
    return f"other processes used {conditions.load:.2g} of {conditions.cores} cores, {spread}"


def quiet(finished: Mapping[str, Finished]) -> str:
    """Number of cases timed alone, and those of them during which the machine was busy."""
    timed = [done for done in finished.values() if done.conditions is not None]
    busy = [case for case, done in finished.items() if done.busy]
    if not busy:
        return f"Cases timed alone: {len(timed)}, all on a quiet machine."
    named = f"{', '.join(busy[:SHOWN])}, …" if len(busy) > SHOWN else ", ".join(busy)
    return f"Cases timed alone: {len(timed)}, of these {len(busy)} on a busy machine ({named})."


def judged_rows(rows: Iterable[Row], finished: Mapping[str, Finished]) -> tuple[JudgedRow, ...]:
    """Rows with their verdicts; a time limit counts as not measured on a busy machine or in an unfinished case."""
    return tuple(_judged(row, finished.get(row.case)) for row in rows)


def _judged(row: Row, case: Finished | None) -> JudgedRow:
    state: State
    if row.passed is None:
        state = "info"
    elif not row.timed:
        state = "pass" if row.passed else "FAIL"
    elif case is None or case.busy:
        state = "not measured"
    else:
        state = "met" if row.passed else "missed"
    return JudgedRow(**vars(row), state=state, conditions=case.conditions if case else None)


def correctness(rows: Sequence[Row]) -> Correctness:
    """The verdict on everything except time."""
    judged = [row for row in rows if row.passed is not None and not row.timed]
    return Correctness(len(judged), tuple(row for row in judged if not row.passed))


def speed(rows: Sequence[JudgedRow]) -> Speed:
    """The verdict on time limits; limits timed on a busy machine are neither met nor missed."""
    met, missed, unmeasured = (
        tuple(row for row in rows if row.state == state) for state in ("met", "missed", "not measured")
    )
    busy = [row.conditions for row in unmeasured if row.conditions is not None]
    return Speed(met, missed, unmeasured, max(busy, key=lambda c: ((c.load or 0.0) / c.cores, c.spread), default=None))
