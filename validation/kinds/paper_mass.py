"""M by methods 1, 2 and 3 of Walker and Orin, which the paper takes over, and by composite bodies in inertial axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import compiled_loops, growth
from validation.speed.families import timed_states
from validation.speed.growth import Races
from validation.speed.stopwatch import Work, race
from validation.store import Series, table

TIMED = True

Settings = Races
rehearsal = growth.rehearsal

Loop = Callable[[Any, Array, int], Any]
METHODS: Mapping[str, Loop] = {
    "1, columns": compiled_loops.mass_columns_loop,
    "2, lower triangle": compiled_loops.mass_lower_loop,
    "3, upper triangle": compiled_loops.mass_upper_loop,
    "composite, inertial axes": compiled_loops.mass_loop,
}
FIRST, SECOND, THIRD, LATER = METHODS


class Time(NamedTuple):
    """Times of one M [µs] by method."""

    chain: str
    n: int
    times: Mapping[str, float]

    def times_less(self, one: str, other: str) -> float:
        """Time of `other` over time of `one`."""
        return self.times[other] / self.times[one]


def run(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """Times against n, how far apart the methods are, and what becomes of the claim at the longest chains."""
    found = []
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = lump(family.scene(case, segments))
            q = timed_states(chain).q
            laps = race({m: _bound(loop, chain, q) for m, loop in METHODS.items()}, settings.turns, settings.turn)
            found.append(Time(name, chain.n, {m: 1e6 * lap.seconds for m, lap in laps.items()}))
            for m, loop in METHODS.items():
                facts: Facts = {"chain": name, "n": chain.n, "method": m}
                yield Measured("time", found[-1].times[m], varied=facts, timed=True)
                yield Measured("apart", _apart(chain, q, loop), varied=facts)
    for name in settings.chain:
        yield from _exponents([time for time in found if time.chain == name])
    longest = max((time for time in found if time.chain == found[0].chain), key=lambda time: time.n)
    facts = {"chain": longest.chain, "n": longest.n}
    yield Measured("claim", longest.times_less(THIRD, FIRST), varied=facts, note=_verdict(found, longest), timed=True)
    rows = [(time.chain, m, time.n, each) for time in found for m, each in time.times.items()]
    columns = table(("chain", "method", "n", "time [µs]"), rows)
    labels = "n", "degrees of freedom n", "time [µs]"
    yield Series("masses", "Time of one M by method", columns, *labels, "log", "log", group="method", panel="chain")


def _bound(loop: Loop, chain: Chain, q: Array) -> Work:
    return lambda calls: loop(chain.arrays, q, calls)


def _apart(chain: Chain, q: Array, loop: Loop) -> float:
    """Largest difference to composite bodies, over what rounding explains."""
    last = q[:1]
    difference = np.abs(loop(chain.arrays, last, 1) - METHODS[LATER](chain.arrays, last, 1)).max()
    return float(difference / rounding.of_mass_matrix(chain, last[0]))


def _exponents(found: Sequence[Time]) -> Iterator[Measured]:
    """p of cost ∝ n^p between the two longest chains of a family, by method."""
    if len(found) < 2:
        return
    shorter, longer = found[-2:]
    for m in METHODS:
        p = math.log(longer.times[m] / shorter.times[m]) / math.log(longer.n / shorter.n)
        facts: Facts = {"chain": longer.chain, "n": shorter.n, "to n": longer.n, "method": m}
        yield Measured("exponent", p, varied=facts, timed=True)


def _verdict(found: Sequence[Time], longest: Time) -> str:
    """Whether each method takes less time than the one before on every chain; and the time of composite bodies."""
    tie = 0.9  # of a time: what is nearer, a machine may turn round
    pairs = ((SECOND, FIRST), (THIRD, SECOND))
    dear = [f"{m} on {t.chain} of n = {t.n}" for t in found for m, before in pairs if t.times_less(m, before) < tie]
    less = number(longest.times_less(LATER, THIRD), 2)
    later = f"at n = {longest.n} composite bodies in inertial axes take {less} times less than method 3"
    if dear:
        return f"does not hold for method {'; '.join(dear)}; {later}"
    return f"holds; {later}"
