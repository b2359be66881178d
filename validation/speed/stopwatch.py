"""Timing: contestants run in turns after a warm-up; the fastest turn of each counts."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

Work = Callable[[int], object]
"""Does its job that many times."""

Jobs = dict[str, Work]
"""Works of one contestant by job."""

Name = TypeVar("Name")


def race(works: Mapping[Name, Work], turns: int, turn: float) -> dict[Name, float]:
    """Seconds a call, in the fastest turn of each contestant.

    They take turns, so that a slow spell of the machine meets all of them; what disturbs a turn only makes it longer,
    so that the shortest is the best estimate.

    Parameters
    ----------
    works
        The contestants; each is warmed up, machine code included, while the number of calls in a turn is found.
    turns
        Number of turns of each.
    turn
        Shortest length of a turn [s].
    """
    calls = {name: _calls_in(work, turn) for name, work in works.items()}
    best = dict.fromkeys(works, math.inf)
    for _ in range(turns):
        for name, work in works.items():
            best[name] = min(best[name], clock(work, calls[name]) / calls[name])
    return best


def clock(work: Work, calls: int) -> float:
    """Seconds of so many calls."""
    start = time.perf_counter()
    work(calls)
    return time.perf_counter() - start


def _calls_in(work: Work, turn: float) -> int:
    work(1)
    calls = 1
    while (seconds := clock(work, calls)) < turn:
        calls = max(2 * calls, math.ceil(calls * min(turn / seconds, 100.0)))
    return calls
