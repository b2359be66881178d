"""Two verdicts on stored rows: what is right, and how fast it is on this machine. The first never asks the second."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, NamedTuple

from validation.store import Conditions, Finished, Row

State = Literal["FAIL", "missed", "not measured", "met", "pass", "info"]


@dataclasses.dataclass(frozen=True, kw_only=True)
class JudgedRow(Row):
    """A row with the verdict on it in a word, and with what else the machine did while its case was timed.

    Attributes
    ----------
    state
        pass or FAIL of a check of correctness; met, missed or not measured (on a busy machine) of a limit of time; info
        without a limit.
    conditions
        None where nothing was timed, or where the case is not finished.
    """

    state: State
    conditions: Conditions | None

    @property
    def busy(self) -> bool:
        """Whether it was timed on a busy machine."""
        return self.timed and self.conditions is not None and self.conditions.busy


class Correctness(NamedTuple):
    """How many checks of correctness were judged, and those that fail."""

    judged: int
    failed: tuple[Row, ...]


class Speed(NamedTuple):
    """Limits of time by what became of them."""

    met: tuple[Row, ...]
    missed: tuple[Row, ...]
    unmeasured: tuple[Row, ...]
    worst: Conditions | None  # on the busiest machine that something was timed on

    def brief(self) -> str:
        """The verdict in a few words, "3 met, 1 missed"; empty without a limit of time."""
        named = ((self.met, "met"), (self.missed, "missed"), (self.unmeasured, "not measured"))
        return ", ".join(f"{len(rows)} {word}" for rows, word in named if rows)

    def sentence(self) -> str:
        """The verdict in a line."""
        parts = [f"{len(rows)} {word}" for rows, word in ((self.met, "met"), (self.missed, "missed")) if rows]
        if parts:
            parts[-1] += " on this machine"
        if self.unmeasured:
            load = f" ({crowd(self.worst)})" if self.worst else ""
            parts.append(f"{len(self.unmeasured)} not measured because the machine was busy{load}")
        return ", ".join(parts) or "no time limit was measured"


def crowd(conditions: Conditions) -> str:
    """What a machine did besides, in words."""
    spread = f"fixed loop {100 * conditions.spread:.0f} % slower than its best"
    if conditions.load is None:
        return spread
    return f"other processes used {conditions.load:.2g} of {conditions.cores} cores, {spread}"


def judged_rows(rows: Iterable[Row], finished: Mapping[str, Finished]) -> tuple[JudgedRow, ...]:
    """Rows with their verdicts; a limit of time is not measured on a busy machine, or while its case goes on."""
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
    """The verdict on everything that does not depend on time."""
    judged = [row for row in rows if row.passed is not None and not row.timed]
    return Correctness(len(judged), tuple(row for row in judged if not row.passed))


def speed(rows: Sequence[JudgedRow]) -> Speed:
    """The verdict on limits of time; of a case that was timed on a busy machine none is met or missed."""
    met, missed, unmeasured = (
        tuple(row for row in rows if row.state == state) for state in ("met", "missed", "not measured")
    )
    busy = [row.conditions for row in unmeasured if row.conditions is not None]
    return Speed(met, missed, unmeasured, max(busy, key=lambda c: ((c.load or 0.0) / c.cores, c.spread), default=None))
