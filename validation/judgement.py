"""Two independent verdicts on stored rows: correctness, and speed on this machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from validation.store import Conditions, Finished, Row

MET, MISSED, BUSY = "met on this machine", "missed", "not measured: the machine was busy"


class Correctness(NamedTuple):
    """How many checks of correctness were judged, and those that fail."""

    judged: int
    failed: tuple[Row, ...]


class Speed(NamedTuple):
    """Rows with a limit of time, by result."""

    met: tuple[Row, ...]
    missed: tuple[Row, ...]
    unmeasured: tuple[Row, ...]
    worst: Conditions | None  # on the busiest machine that something was timed on

    def brief(self) -> str:
        """The verdict in a few words, "3 met, 1 missed"; empty without a limit of time."""
        named = ((self.met, "met"), (self.missed, "missed"), (self.unmeasured, "not measured"))
        return ", ".join(f"{len(rows)} {word}" for rows, word in named if rows)

    def summary(self) -> str:
        """The verdict in a line."""
        parts = [f"{len(rows)} {word}" for rows, word in ((self.met, "met"), (self.missed, "missed")) if rows]
        if parts:
            parts[-1] += " on this machine"
        if self.unmeasured:
            parts.append(f"{len(self.unmeasured)} {BUSY}{f' ({load_in_words(self.worst)})' if self.worst else ''}")
        return ", ".join(parts) or "nothing was timed against a limit"


def load_in_words(conditions: Conditions) -> str:
    """Load of a machine during a timed case, in words."""
    spread = f"a fixed loop took {100 * conditions.spread:.0f} % longer than at its best"
    if conditions.load is None:
        return spread
    return f"other processes kept {conditions.load:.2g} of {conditions.cores} cores busy, {spread}"


def correctness(rows: Sequence[Row]) -> Correctness:
    """The verdict on all rows that are not timed."""
    judged = [row for row in rows if row.passed is not None and not row.timed]
    return Correctness(len(judged), tuple(row for row in judged if not row.passed))


def speed(rows: Sequence[Row], finished: Mapping[str, Finished]) -> Speed:
    """The verdict on limits of time; of a case that was timed on a busy machine none is met or missed."""
    found: dict[str, list[Row]] = {MET: [], MISSED: [], BUSY: []}
    for row in rows:
        state = speed_state(row, finished)
        if state:
            found[state].append(row)
    busy = [done.conditions for done in finished.values() if done.conditions and done.busy]
    worst = max(busy, key=lambda c: ((c.load or 0.0) / c.cores, c.spread), default=None)
    return Speed(tuple(found[MET]), tuple(found[MISSED]), tuple(found[BUSY]), worst)


def speed_state(row: Row, finished: Mapping[str, Finished]) -> str:
    """Result of a limit of time; "" for a row without one."""
    if not row.timed or row.passed is None:
        return ""
    if row.case not in finished or finished[row.case].busy:
        return BUSY
    return MET if row.passed else MISSED
