"""Races of contestants by name, job after job, on families of chains: times, and how they grow with the joints n.

Contestants run in turns after a warm-up; the fastest turn of each counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from msgspec.structs import replace

from flexlink.describe.spec import NonNegative, Spec
from validation.case import Measured
from validation.facts import Fact
from validation.speed.families import Family
from validation.store import Series, table

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
    """CPU time of so many calls [s]."""
    return processor_time(lambda: work(calls))


def processor_time(work: Callable[[], object]) -> float:
    """CPU time of this process [s], which depends little on other processes."""
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
    """Seconds that each contestant took for one job on a chain of n joints."""

    chain: str
    job: str
    n: int
    seconds: Mapping[str, float]

    @property
    def facts(self) -> dict[str, Fact]:
        """What was timed."""
        return {"chain": self.chain, "job": self.job, "n": self.n}

    def times_less(self, one: str, other: str) -> float:
        """Time of `other` over time of `one`."""
        return self.seconds[other] / self.seconds[one]


class Races(Spec, frozen=True):
    """Families by name, and how often and how long [s] each contestant runs."""

    chain: dict[str, Family]
    turns: int
    turn: NonNegative

    def sizes(self) -> Iterator[tuple[str, Family, int]]:
        """Every family with its name and each of its numbers of segments."""
        for name, family in self.chain.items():
            yield from ((name, family, segments) for segments in family.segments)

    def run(self, chain: str, n: int, contestants: Mapping[str, Jobs]) -> Iterator[Race]:
        """Every job of the first contestant, raced by all that can do it."""
        for job in next(iter(contestants.values())):
            works = {name: jobs[job] for name, jobs in contestants.items() if job in jobs}
            yield Race(chain, job, n, race(works, self.turns, self.turn))


Some = TypeVar("Some", bound=Races)


def rehearsal(settings: Some) -> Some:
    """The shortest chain of every family, once."""
    shortest = {name: replace(family, segments=family.segments[:1]) for name, family in settings.chain.items()}
    return replace(settings, chain=shortest, turns=1, turn=0.0)


def growth(races: Sequence[Race]) -> Iterator[Measured | Series]:
    """Exponents of every family, job and engine, and for every job a series to draw."""
    for chain, job, engine in dict.fromkeys((one.chain, one.job, engine) for one in races for engine in one.seconds):
        yield from exponent([one for one in races if (one.chain, one.job) == (chain, job)], engine)
    for job in dict.fromkeys(one.job for one in races):
        yield series([one for one in races if one.job == job], "cost", f"Time of one {job}", "engine", part=job)


def exponent(races: Sequence[Race], engine: str) -> Iterator[Measured]:
    """p of an engine's cost ∝ n^p by least squares on logarithms, if at least two chains are long enough."""
    shortest = 100  # joints; below, what does not grow with n is a part of the time
    long = [one for one in races if one.n >= shortest and engine in one.seconds]
    if len(long) > 1:
        first, last = long[0], long[-1]
        n, seconds = np.log([(one.n, one.seconds[engine]) for one in long]).T
        quantity = f"{first.chain} {first.job}: exponent" if engine == "native" else "exponent of others"
        slope = float(np.polyfit(n, seconds, 1)[0])
        yield Measured(quantity, slope, "", engine, first.facts | {"to n": last.n}, timed=True)


def series(races: Sequence[Race], what: str, title: str, group: str, part: str = "") -> Series:
    """Cost of one job against n: a panel a family, a curve a contestant, which the column `group` names."""
    rows = [(one.chain, name, one.n, 1e6 * seconds) for one in races for name, seconds in one.seconds.items()]
    columns = table(("chain", group, "n", "time [µs]"), rows)
    labels = "n", "degrees of freedom n", "time [µs]"
    return Series(what, title, columns, *labels, "log", "log", group=group, panel="chain", part=part)
