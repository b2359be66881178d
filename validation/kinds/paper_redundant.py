"""Gain by removing redundant operations: the same recursion with and without products by 0 and 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import compiled_loops, growth, uniform_newton_euler
from validation.speed.families import States, timed_states
from validation.speed.growth import Races
from validation.speed.stopwatch import Work, race

TIMED = True

Settings = Races
rehearsal = growth.rehearsal

ALL, REMOVED = "all operations", "redundant ones removed"
BIAS, MASS = "T_GC", "M by method 1"


def run(case: Case, settings: Races) -> Iterator[Measured]:
    """Times of both forms of T_GC and of M, how far apart their numbers are, and the smallest gain of each."""
    gains: dict[str, list[float]] = {BIAS: [], MASS: []}
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = lump(family.scene(case, segments))
            states = timed_states(chain)
            works = _works(chain, states)
            laps = race(works, settings.turns, settings.turn)
            for (job, form), lap in laps.items():
                facts: Facts = {"chain": name, "n": chain.n, "job": job, "form": form}
                yield Measured("time", 1e6 * lap.seconds, varied=facts, timed=True)
            for job, found in gains.items():
                facts = {"chain": name, "n": chain.n, "job": job}
                yield Measured("apart", _apart(chain, states, job), varied=facts)
                found.append(laps[job, ALL].seconds / laps[job, REMOVED].seconds)
                yield Measured("gain", found[-1], varied=facts, timed=True)
    least = {job: min(found) for job, found in gains.items()}
    yield Measured("claim", min(least.values()), note=_verdict(least), timed=True)


def _works(chain: Chain, states: States) -> dict[tuple[str, str], Work]:
    q, qd, rest, rows = states.q, states.qd, np.zeros_like(states.q), uniform_newton_euler.rows_of(chain)
    return {
        (BIAS, ALL): lambda calls: uniform_newton_euler.bias_loop(rows, q, qd, calls),
        (BIAS, REMOVED): lambda calls: compiled_loops.rne_loop(chain.arrays, q, qd, rest, calls),
        (MASS, ALL): lambda calls: uniform_newton_euler.mass_loop(rows, q, calls),
        (MASS, REMOVED): lambda calls: compiled_loops.mass_columns_loop(chain.arrays, q, calls),
    }


def _apart(chain: Chain, states: States, job: str) -> float:
    """Difference of both forms in the first state, over what rounding explains."""
    works = _works(chain, States(*(part[:1] for part in states)))
    difference = np.abs(np.asarray(works[job, ALL](1)) - np.asarray(works[job, REMOVED](1))).max()
    q, qd = states.q[0], states.qd[0]
    explained = rounding.of_mass_matrix(chain, q) if job == MASS else rounding.of_bias_torque(chain, q, qd)
    return float(difference / explained)


def _verdict(least: Mapping[str, float]) -> str:
    said = ", ".join(f"{job} takes at least {number(gain, 2)} times less" for job, gain in least.items())
    return f"holds: {said}" if min(least.values()) > 1.0 else f"does not hold: {said}"
