"""Statements of the paper about cost: methods for M, redundant operations, number of segments."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import msgspec
import numpy as np

import flexlink as fl
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.dynamics import rounding
from flexlink.pages.numbers import number
from flexlink.results.tip_motion import largest_distance
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.runs import stable_step_at_start
from validation.speed import compiled_loops, races, uniform_newton_euler
from validation.speed.families import States, of_steps, timed_states
from validation.speed.races import Jobs, Race, Races, processor_time
from validation.store import Series
from validation.trade.error_parts import Fine, Setup, Type

Loop = Callable[[Any, Array, int], Any]
METHODS: Mapping[str, Loop] = {
    "1, columns": compiled_loops.mass_columns_loop,
    "2, lower triangle": compiled_loops.mass_lower_loop,
    "3, upper triangle": compiled_loops.mass_upper_loop,
    "composite, inertial axes": compiled_loops.mass_loop,
}
FIRST, SECOND, THIRD, LATER = METHODS


@kind(timed=True, beside=True, rehearsal=races.REHEARSAL)
def paper_mass(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """M by methods 1, 2 and 3 of Walker and Orin, which the paper adopts, and by composite bodies in inertial axes.

    Yield times against n, differences between the methods, and the verdict on the claim for the longest chains.
    """
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        chain = lump(family.scene(case, segments))
        q = timed_states(chain).q
        found += settings.run(name, chain.n, {m: {"M": partial(loop, chain.arrays, q)} for m, loop in METHODS.items()})
        for m, loop in METHODS.items():
            facts: Facts = {"chain": name, "n": chain.n, "method": m}
            yield Measured("time", 1e6 * found[-1].seconds[m], varied=facts, timed=True)
            yield Measured("apart", _mass_apart(chain, q, loop), varied=facts)
    for name in settings.chain:
        yield from _exponents([one for one in found if one.chain == name])
    longest = max((one for one in found if one.chain == found[0].chain), key=lambda one: one.n)
    facts = {"chain": longest.chain, "n": longest.n}
    yield Measured(
        "claim", longest.times_less(THIRD, FIRST), varied=facts, note=_mass_verdict(found, longest), timed=True
    )
    yield races.series(found, "masses", "Time of one M by method", "method")


def _mass_apart(chain: Chain, q: Array, loop: Loop) -> float:
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


def _mass_verdict(found: Sequence[Race], longest: Race) -> str:
    """Verdict on whether each method is faster than the one before on every chain; notes composite bodies' gain."""
    tie = 0.9  # ratio of two times above which their order may be reversed on another machine
    pairs = ((SECOND, FIRST), (THIRD, SECOND))
    dear = [f"{m} on {t.chain} with n = {t.n}" for t in found for m, before in pairs if t.times_less(m, before) < tie]
    less = number(longest.times_less(LATER, THIRD), 2)
    later = f"at n = {longest.n} composite bodies in inertial axes take {less} times less time than method 3"
    if dear:
        return f"does not hold for method {'; '.join(dear)}; {later}"
    return f"holds; {later}"


ALL, REMOVED = "all operations", "redundant ones removed"
BIAS, MASS_JOB = "T_GC", "M by method 1"


@kind(timed=True, beside=True, rehearsal=races.REHEARSAL)
def paper_redundant(case: Case, settings: Races) -> Iterator[Measured]:
    """Gain by removing redundant operations: compare the same recursion with and without products by 0 and 1.

    For T_GC and M, yield the times of both forms, the difference of their results, and the smallest gain.
    """
    gains: dict[str, list[float]] = {BIAS: [], MASS_JOB: []}
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
            yield Measured("apart", _forms_apart(chain, states, one.job), varied=facts)
            gains[one.job].append(one.times_less(REMOVED, ALL))
            yield Measured("gain", gains[one.job][-1], varied=facts, timed=True)
    least = {job: min(found) for job, found in gains.items()}
    yield Measured("claim", min(least.values()), note=_redundant_verdict(least), timed=True)


def _forms(chain: Chain, states: States) -> dict[str, Jobs]:
    q, qd, rest, rows = states.q, states.qd, np.zeros_like(states.q), uniform_newton_euler.rows_of(chain)
    return {
        ALL: {
            BIAS: lambda calls: uniform_newton_euler.bias_loop(rows, q, qd, calls),
            MASS_JOB: lambda calls: uniform_newton_euler.mass_loop(rows, q, calls),
        },
        REMOVED: {
            BIAS: lambda calls: compiled_loops.rne_loop(chain.arrays, q, qd, rest, calls),
            MASS_JOB: lambda calls: compiled_loops.mass_columns_loop(chain.arrays, q, calls),
        },
    }


def _forms_apart(chain: Chain, states: States, job: str) -> float:
    """Difference between the results of both forms in the first state, relative to the rounding bound."""
    one, other = (np.asarray(jobs[job](1)) for jobs in _forms(chain, States(*(s[:1] for s in states))).values())
    difference = np.abs(one - other).max()
    q, qd = states.q[0], states.qd[0]
    explained = rounding.of_mass_matrix(chain, q) if job == MASS_JOB else rounding.of_bias_torque(chain, q, qd)
    return float(difference / explained)


def _redundant_verdict(least: Mapping[str, float]) -> str:
    gains = ", ".join(f"{job} takes at least {number(gain, 2)} times less time" for job, gain in least.items())
    return f"holds: {gains}" if min(least.values()) > 1.0 else f"does not hold: {gains}"


class Arm(Spec, frozen=True):
    """Type and increasing numbers of segments per link; settings that converge in the number of hinges, and in time."""

    segments: tuple[int, ...]
    flex: Type
    fine: Fine
    in_time: Fine
    change: dict[str, Any] = msgspec.field(default_factory=dict)


class Price(NamedTuple):
    """Error and cost of a chain with this number of segments per link."""

    scene: str
    segments: int
    error: float  # error of the tip with exact time integration [m]
    cost: float  # CPU seconds per second of motion


@kind(timed=True, beside=True)
def paper_segments(case: Case, scene: dict[str, Arm]) -> Iterator[Measured]:
    """Precision and cost against the number of segments per link, in the paper's layout, by RK4 at its stability limit.

    Yield error and cost of every chain of the scenes by name, and the verdict on the claim.
    """
    found: list[Price] = []
    for name, arm in scene.items():
        base = case.varied_scene(name, arm.change)
        limit = arm.fine.limit(base, arm.flex)
        for segments in arm.segments:
            setup = Setup(flex=arm.flex, hinges=segments - 1, method="RK4")
            path = arm.in_time.in_time(base, setup)
            found.append(Price(name, segments, largest_distance(path.tip, limit.tip), _cost(setup.scene(base))))
            facts: Facts = {"cells": segments}
            yield Measured("error", found[-1].error, name, varied=facts)
            yield Measured("own error / error", (path.own + limit.own) / found[-1].error, name, varied=facts)
            yield Measured("cost", 1e3 * found[-1].cost, name, varied=facts, timed=True)
    gains = {name: _gain([price for price in found if price.scene == name]) for name in scene}
    yield Measured("claim", max(cost for _, cost in gains.values()), note=_segments_verdict(found, gains), timed=True)


def _cost(scene: Scene) -> float:
    """CPU seconds per second of motion, by RK4 near its largest stable step, without the set-up of a run."""
    stable = stable_step_at_start(scene, "RK4")
    timed = 0.01 * stable  # step of the timed runs, stable in every configuration
    numbers = 500, 3500
    runs = [functools.partial(fl.simulate, of_steps(scene, n, timed)) for n in numbers]
    few, many = (min(processor_time(run) for _ in range(5)) for run in runs)
    return (many - few) / (numbers[1] - numbers[0]) / (0.9 * stable)  # at RK4's largest usable step


def _gain(prices: Sequence[Price]) -> tuple[float, float]:
    """Decrease of the error and increase of the cost from the fewest segments to the most, as ratios."""
    first, last = prices[0], prices[-1]
    return first.error / last.error, last.cost / first.cost


def _segments_verdict(found: Sequence[Price], gains: Mapping[str, tuple[float, float]]) -> str:
    spans = {name: [price.segments for price in found if price.scene == name] for name in gains}
    gained = "; ".join(
        f"{name}, {spans[name][0]} to {spans[name][-1]} segments: error ÷ {number(error, 2)}, cost × {number(cost, 2)}"
        for name, (error, cost) in gains.items()
    )
    worse = [
        f"{b.segments} segments on {a.scene}, which are less precise than {a.segments}"
        for a, b in itertools.pairwise(found)
        if a.scene == b.scene and b.error > a.error
    ]
    return f"holds except for {', '.join(worse)}; {gained}" if worse else f"holds; {gained}"
