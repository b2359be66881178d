"""Time of one evaluation against n: q̈, RNE, M and T_GC; ours in a compiled loop and by public call, engines by call."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.facts import Fact, Facts
from validation.speed import evaluations
from validation.speed.evaluations import FORWARD, RNE
from validation.speed.families import Family, timed_states
from validation.speed.stopwatch import race
from validation.store import Series, table

OURS = ("native", "public")  # in a compiled loop, by a checked call from Python
PLAIN = "revolute joints, local"  # what `pin.aba` does by default with a chain read from a file
LONG_JOBS = (FORWARD, RNE)  # the ones that are O(n), timed at any length
FIRST_OF_FIT = 100  # n from which the exponent is fitted


TIMED = True


class Settings(Spec, frozen=True):
    """Families by name, and how often and how long [s] each contestant runs."""

    chain: dict[str, Family]
    turns: int = 6
    turn: float = 0.0015


def rehearsal(settings: Settings) -> Settings:
    """The shortest chain of every family, once."""
    shortest = {name: replace(family, segments=family.segments[:1]) for name, family in settings.chain.items()}
    return replace(settings, chain=shortest, turns=1, turn=0.0)


class Time(NamedTuple):
    """Seconds a call of an engine."""

    engine: str
    n: int
    seconds: float
    form: str = ""


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Times, ratios to ours, exponents, and for every job a series to draw."""
    found: dict[str, list[tuple[str, Time]]] = {}
    for name, family in settings.chain.items():
        own: dict[str, list[Time]] = {}
        for segments in family.segments:
            chain = lump(family.scene(case, segments))
            for job, times in _times(chain, segments, family, settings):
                yield from _rows(name, job, times, segments == family.segments[0])
                own.setdefault(job, []).extend(times.values())
        for job, measured in own.items():
            yield from exponents(name, job, measured)
            found.setdefault(job, []).extend((name, time) for time in measured)
    for job, entries in found.items():
        yield series(job, entries)


def _times(chain: Chain, segments: int, family: Family, settings: Settings) -> Iterator[tuple[str, dict[str, Time]]]:
    """Job by job, the times of all who take part: native, public, pinocchio, its fastest form, mujoco."""
    states = timed_states(chain)
    parties = {"native": evaluations.native(chain, states), "public": evaluations.public(chain, states)}
    forms = evaluations.pinocchio(chain, states) if segments <= family.pinocchio else {}
    if segments <= family.mujoco:
        parties["mujoco"] = evaluations.mujoco_calls(chain, states)
    for job in parties["native"] if forms else LONG_JOBS:
        works = {name: jobs[job] for name, jobs in (parties | forms).items() if job in jobs}
        laps = race(works, settings.turns, settings.turn)
        times = {name: Time(name, chain.n, laps[name].seconds) for name in parties}
        if forms:
            best = min((name for name in works if name in forms), key=lambda name: laps[name].seconds)
            times["pinocchio"] = Time("pinocchio", chain.n, laps[PLAIN].seconds, PLAIN)
            times["pinocchio, fastest"] = Time("pinocchio, fastest", chain.n, laps[best].seconds, best)
        yield job, times


def _rows(family: str, job: str, times: Mapping[str, Time], first: bool) -> Iterator[Measured]:
    for name, time in times.items():
        facts: dict[str, Fact] = {"chain": family, "job": job, "n": time.n}
        if name not in OURS:
            facts |= {"form": time.form} if time.form else {}
            for our in OURS:
                ratio = time.seconds / times[our].seconds
                yield Measured(f"{family} {job}: {name} / {our}", ratio, "", name, facts, timed=True)
        elif first and name == "public":
            yield Measured(f"{family} {job}: public call", 1e6 * time.seconds, varied=facts, timed=True)


def exponents(family: str, job: str, times: list[Time]) -> Iterator[Measured]:
    """p of cost ∝ n^p by least squares on logarithms, of every engine with two chains that are long enough."""
    for engine in dict.fromkeys(time.engine for time in times):
        long = [(t.n, t.seconds) for t in times if t.engine == engine and t.n >= FIRST_OF_FIT]
        if len(long) > 1:
            n, seconds = np.log(np.array(long).T)
            slope = float(np.polyfit(n, seconds, 1)[0])
            facts: Facts = {"chain": family, "job": job, "n": long[0][0], "to n": long[-1][0]}
            quantity = f"{family} {job}: exponent" if engine == "native" else "exponent of others"
            yield Measured(quantity, slope, "", engine, facts, timed=True)


def series(job: str, entries: list[tuple[str, Time]]) -> Series:
    """Cost against n: a panel a family, a curve an engine."""
    rows = [(family, t.engine, t.n, 1e6 * t.seconds) for family, t in entries]
    columns = table(("chain", "engine", "n", "time [µs]"), rows)
    labels = "n", "degrees of freedom n", "time [µs]"
    title = f"Time of one {job}"
    return Series("cost", title, columns, *labels, "log", "log", group="engine", panel="chain", part=job)
