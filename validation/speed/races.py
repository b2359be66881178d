"""Timing comparisons of programs, job by job, on families of chains: times, and how they grow with n joints.

After a warm-up, the programs run in turns; the fastest turn of each counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from msgspec.structs import replace

from flexlink.describe.spec import NonNegative, Spec
from validation.case import Measured
from validation.facts import Fact
from validation.speed.families import Family
from validation.store import Series, table

Work = Callable[[int], object]
"""A call that repeats its job a given number of times."""

Jobs = dict[str, Work]
"""Jobs of one program by name."""

Name = TypeVar("Name")


def race(works: Mapping[Name, Work], turns: int, turn: float) -> dict[Name, float]:
    """Seconds per call, in the fastest turn of each program.

    Programs take turns, so a slow period of the machine affects all of them. Disturbances only lengthen a turn, so the
    shortest is the best estimate.

    Parameters
    ----------
    works
        The timed programs. Each is warmed up, including compilation, to find the number of calls in a turn.
    turns
        Number of turns of each program.
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
    """CPU time of `calls` calls [s]."""
    return processor_time(lambda: work(calls))


def processor_time(work: Callable[[], object]) -> float:
    """CPU time of this process for a call [s], which depends little on other processes."""
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _calls_in(work: Work, turn: float) -> int:
    work(1)
    calls = 1
    while (seconds := clock(work, calls)) < turn:
        calls = max(2 * calls, math.ceil(calls * turn / max(seconds, turn / 100.0)))
    return calls


class Race(NamedTuple):
    """Seconds per call of each program for one job on a chain of n joints."""

    chain: str
    job: str
    n: int
    seconds: Mapping[str, float]

    @property
    def facts(self) -> dict[str, Fact]:
        """Varied conditions of the timed job, as facts of a measurement."""
        return {"chain": self.chain, "job": self.job, "n": self.n}

    def times_less(self, one: str, other: str) -> float:
        """Time of `other` over time of `one`."""
        return self.seconds[other] / self.seconds[one]


class Races(Spec, frozen=True):
    """Families of chains by name, number of turns of each program, and length of a turn [s]."""

    chain: dict[str, Family]
    turns: int
    turn: NonNegative

    def sizes(self) -> Iterator[tuple[str, Family, int]]:
        """Yield each family with its name and each number of segments."""
        for name, family in self.chain.items():
            yield from ((name, family, segments) for segments in family.segments)

    def run(self, chain: str, n: int, contestants: Mapping[str, Jobs]) -> Iterator[Race]:
        """Time every job of the first program in all programs that can do it."""
        for job in next(iter(contestants.values())):
            works = {name: jobs[job] for name, jobs in contestants.items() if job in jobs}
            yield Race(chain, job, n, race(works, self.turns, self.turn))


def shortest(chain: Mapping[str, Family]) -> dict[str, Family]:
    """Families with their shortest chains only."""
    return {name: replace(family, segments=family.segments[:1]) for name, family in chain.items()}


REHEARSAL: Mapping[str, Any] = {"chain": shortest, "turns": 1, "turn": 0.0}
"""Changes of settings for a rehearsal: the shortest chain of every family, once."""


def growth(races: Sequence[Race]) -> Iterator[Measured | Series]:
    """Yield growth exponents of every family, job and engine, and a series for each job."""
    for chain, job, engine in dict.fromkeys((one.chain, one.job, engine) for one in races for engine in one.seconds):
        yield from exponent([one for one in races if (one.chain, one.job) == (chain, job)], engine)
    for job in dict.fromkeys(one.job for one in races):
        yield series([one for one in races if one.job == job], "cost", f"Time of one {job}", "engine", part=job)


def exponent(races: Sequence[Race], engine: str) -> Iterator[Measured]:
    """Yield the exponent p of an engine's cost ∝ n^p by a fit of logarithms, if at least two chains are long enough."""
    shortest = 100  # joints; for shorter chains, constant overhead is significant
    long = [one for one in races if one.n >= shortest and engine in one.seconds]
    if len(long) > 1:
        first, last = long[0], long[-1]
        n, seconds = np.log([(one.n, one.seconds[engine]) for one in long]).T
        quantity = f"{first.chain} {first.job}: exponent" if engine == "native" else "exponent of others"
        slope = float(np.polyfit(n, seconds, 1)[0])
        yield Measured(quantity, slope, "", engine, first.facts | {"to n": last.n}, timed=True)


def series(races: Sequence[Race], what: str, title: str, group: str, part: str = "") -> Series:
    """Cost of one job against n, with a panel per family and a curve per program, named in the column `group`."""
    rows = [(one.chain, name, one.n, 1e6 * seconds) for one in races for name, seconds in one.seconds.items()]
    columns = table(("chain", group, "n", "time [µs]"), rows)
    labels = "n", "degrees of freedom n", "time [µs]"
    return Series(what, title, columns, *labels, "log", "log", group=group, panel="chain", part=part)
