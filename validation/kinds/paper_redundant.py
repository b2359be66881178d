"""Gain by removing redundant operations: compare the same recursion with and without products by 0 and 1."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import compiled_loops, races, uniform_newton_euler
from validation.speed.families import States, timed_states
from validation.speed.races import Jobs, Races

TIMED = True
BESIDE = True

Settings = Races
rehearsal = races.rehearsal

ALL, REMOVED = "all operations", "redundant ones removed"
BIAS, MASS = "T_GC", "M by method 1"


def run(case: Case, settings: Races) -> Iterator[Measured]:
    """For T_GC and M, yield the times of both forms, the difference of their results, and the smallest gain."""
    gains: dict[str, list[float]] = {BIAS: [], MASS: []}
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        states = timed_states(chain)
        found = list(settings.run(name, chain.n, _forms(chain, states)))
        for one in found:
            for form, seconds in one.seconds.items():
                facts: Facts = {"chain": name, "n": chain.n, "job": one.job, "form": form}
                yield Measured("time", 1e6 * seconds, varied=facts, timed=True)
        for one in found:
            facts = {"chain": name, "n": chain.n, "job": one.job}
            yield Measured("apart", _apart(chain, states, one.job), varied=facts)
            gains[one.job].append(one.times_less(REMOVED, ALL))
            yield Measured("gain", gains[one.job][-1], varied=facts, timed=True)
    least = {job: min(found) for job, found in gains.items()}
    yield Measured("claim", min(least.values()), note=_verdict(least), timed=True)


def _forms(chain: Chain, states: States) -> dict[str, Jobs]:
    q, qd, rest, rows = states.q, states.qd, np.zeros_like(states.q), uniform_newton_euler.rows_of(chain)
    return {
        ALL: {
            BIAS: lambda calls: uniform_newton_euler.bias_loop(rows, q, qd, calls),
            MASS: lambda calls: uniform_newton_euler.mass_loop(rows, q, calls),
        },
        REMOVED: {
            BIAS: lambda calls: compiled_loops.rne_loop(chain.arrays, q, qd, rest, calls),
            MASS: lambda calls: compiled_loops.mass_columns_loop(chain.arrays, q, calls),
        },
    }


def _apart(chain: Chain, states: States, job: str) -> float:
    """Difference between the results of both forms in the first state, relative to the rounding bound."""
    one, other = (np.asarray(jobs[job](1)) for jobs in _forms(chain, States(*(s[:1] for s in states))).values())
    difference = np.abs(one - other).max()
    q, qd = states.q[0], states.qd[0]
    explained = rounding.of_mass_matrix(chain, q) if job == MASS else rounding.of_bias_torque(chain, q, qd)
    return float(difference / explained)


def _verdict(least: Mapping[str, float]) -> str:
    gains = ", ".join(f"{job} takes at least {number(gain, 2)} times less time" for job, gain in least.items())
    return f"holds: {gains}" if min(least.values()) > 1.0 else f"does not hold: {gains}"
