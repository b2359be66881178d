"""Time of one evaluation against n: q̈, RNE, M and T_GC; ours in a compiled loop and by public call, engines by call."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from validation.case import Case, Measured
from validation.facts import Fact
from validation.speed import evaluations, growth
from validation.speed.evaluations import FORWARD, RNE
from validation.speed.families import Family, timed_states
from validation.speed.growth import Races, Time
from validation.speed.stopwatch import race
from validation.store import Series

OURS = ("native", "public")  # in a compiled loop, by a checked call from Python
PLAIN = "revolute joints, local"  # what `pin.aba` does by default with a chain read from a file

TIMED = True

Settings = Races
rehearsal = growth.rehearsal


def run(case: Case, settings: Races) -> Iterator[Measured | Series]:
    """Times, ratios to ours, exponents, and for every job a series to draw."""
    found: list[Time] = []
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = lump(family.scene(case, segments))
            for times in _times(name, chain, segments, family, settings):
                yield from _rows(times, segments == family.segments[0])
                found += times.values()
    yield from growth.growth(found)


def _times(name: str, chain: Chain, segments: int, family: Family, settings: Races) -> Iterator[dict[str, Time]]:
    """Times of all contestants, job by job: native, public, pinocchio, its fastest form, mujoco."""
    states = timed_states(chain)
    parties = {"native": evaluations.native(chain, states), "public": evaluations.public(chain, states)}
    forms = evaluations.pinocchio(chain, states) if segments <= family.pinocchio else {}
    if segments <= family.mujoco:
        parties["mujoco"] = evaluations.mujoco_calls(chain, states)
    for job in parties["native"] if forms else (FORWARD, RNE):  # these are O(n), and timed at any length
        works = {party: jobs[job] for party, jobs in (parties | forms).items() if job in jobs}
        laps = race(works, settings.turns, settings.turn)
        contestants = {party: (party, "") for party in parties}
        if forms:
            fastest = min((form for form in works if form in forms), key=lambda form: laps[form].seconds)
            contestants |= {"pinocchio": (PLAIN, PLAIN), "pinocchio, fastest": (fastest, fastest)}
        yield {
            engine: Time(name, job, engine, chain.n, laps[work].seconds, form)
            for engine, (work, form) in contestants.items()
        }


def _rows(times: Mapping[str, Time], first: bool) -> Iterator[Measured]:
    for name, time in times.items():
        job = f"{time.chain} {time.job}"
        facts: dict[str, Fact] = {"chain": time.chain, "job": time.job, "n": time.n}
        if name not in OURS:
            facts |= {"form": time.form} if time.form else {}
            for our in OURS:
                ratio = time.seconds / times[our].seconds
                yield Measured(f"{job}: {name} / {our}", ratio, "", name, facts, timed=True)
        elif first and name == "public":
            yield Measured(f"{job}: public call", 1e6 * time.seconds, varied=facts, timed=True)
