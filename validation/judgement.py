"""Two verdicts on stored rows: what is right, and how fast it is on this machine. The first never asks the second."""

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
    """Limits of time by what became of them."""

    met: tuple[Row, ...]
    missed: tuple[Row, ...]
    unmeasured: tuple[Row, ...]
    worst: Conditions | None  # on the busiest machine that something was timed on

    def brief(self) -> str:
        """The verdict in a few words, "3 met, 1 missed"; empty without a limit of time."""
        named = ((self.met, "met"), (self.missed, "missed"), (self.unmeasured, "not measured"))
        return ", ".join(f"{len(rows)} {word}" for rows, word in named if rows)

    def said(self) -> str:
        """The verdict in a line."""
        parts = [f"{len(rows)} {word}" for rows, word in ((self.met, "met"), (self.missed, "missed")) if rows]
        if parts:
            parts[-1] += " on this machine"
        if self.unmeasured:
            parts.append(f"{len(self.unmeasured)} {BUSY}{f' ({crowd(self.worst)})' if self.worst else ''}")
        return ", ".join(parts) or "nothing was timed against a limit"


def crowd(conditions: Conditions) -> str:
    """What a machine did besides, in words."""
    spread = f"a fixed loop took {100 * conditions.spread:.0f} % longer than at its best"
    if conditions.load is None:
        return spread
    return f"other processes kept {conditions.load:.2g} of {conditions.cores} cores busy, {spread}"


def correctness(rows: Sequence[Row]) -> Correctness:
    """The verdict on everything that does not depend on time."""
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
    """What became of a limit of time; "" of a row that has none."""
    if not row.timed or row.passed is None:
        return ""
    if row.case not in finished or finished[row.case].busy:
        return BUSY
    return MET if row.passed else MISSED
