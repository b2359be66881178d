"""M by methods 1, 2 and 3 of Walker and Orin, which the paper adopts, and by composite bodies in inertial axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import compiled_loops, races
from validation.speed.families import timed_states
from validation.speed.races import Race, Races
from validation.store import Series

TIMED = True
BESIDE = True

Settings = Races
rehearsal = races.rehearsal

Loop = Callable[[Any, Array, int], Any]
METHODS: Mapping[str, Loop] = {
    "1, columns": compiled_loops.mass_columns_loop,
    "2, lower triangle": compiled_loops.mass_lower_loop,
    "3, upper triangle": compiled_loops.mass_upper_loop,
    "composite, inertial axes": compiled_loops.mass_loop,
}
FIRST, SECOND, THIRD, LATER = METHODS


def run(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """Yield times against n, differences between the methods, and the verdict on the claim for the longest chains."""
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        q = timed_states(chain).q
        found += settings.run(name, chain.n, {m: {"M": partial(loop, chain.arrays, q)} for m, loop in METHODS.items()})
        for m, loop in METHODS.items():
            facts: Facts = {"chain": name, "n": chain.n, "method": m}
            yield Measured("time", 1e6 * found[-1].seconds[m], varied=facts, timed=True)
            yield Measured("apart", _apart(chain, q, loop), varied=facts)
    for name in settings.chain:
        yield from _exponents([one for one in found if one.chain == name])
    longest = max((one for one in found if one.chain == found[0].chain), key=lambda one: one.n)
    facts = {"chain": longest.chain, "n": longest.n}
    yield Measured("claim", longest.times_less(THIRD, FIRST), varied=facts, note=_verdict(found, longest), timed=True)
    yield races.series(found, "masses", "Time of one M by method", "method")


def _apart(chain: Chain, q: Array, loop: Loop) -> float:
    """Largest difference of a method's M from the M by composite bodies, relative to the rounding bound."""
    last = q[:1]
    difference = np.abs(loop(chain.arrays, last, 1) - METHODS[LATER](chain.arrays, last, 1)).max()
    return float(difference / rounding.of_mass_matrix(chain, last[0]))


def _exponents(found: Sequence[Race]) -> Iterator[Measured]:
    """Yield each method's exponent p in cost ∝ n^p between the two longest chains of a family."""
    if len(found) < 2:
        return
    shorter, longer = found[-2:]
    for m in METHODS:
        p = math.log(longer.seconds[m] / shorter.seconds[m]) / math.log(longer.n / shorter.n)
        facts: Facts = {"chain": longer.chain, "n": shorter.n, "to n": longer.n, "method": m}
        yield Measured("exponent", p, varied=facts, timed=True)


def _verdict(found: Sequence[Race], longest: Race) -> str:
    """Verdict on whether each method is faster than the one before on every chain; notes composite bodies' gain."""
    tie = 0.9  # ratio of two times above which their order may be reversed on another machine
    pairs = ((SECOND, FIRST), (THIRD, SECOND))
    dear = [f"{m} on {t.chain} with n = {t.n}" for t in found for m, before in pairs if t.times_less(m, before) < tie]
    less = number(longest.times_less(LATER, THIRD), 2)
    later = f"at n = {longest.n} composite bodies in inertial axes take {less} times less time than method 3"
    if dear:
        return f"does not hold for method {'; '.join(dear)}; {later}"
    return f"holds; {later}"
