"""Time of one evaluation against n: q̈, RNE, M and T_GC; ours in a compiled loop and by public call, engines by call."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from flexlink.chain import Chain
from flexlink.spec import Spec
from validation.case import Case, Measured
from validation.store import Series, table
from validation.timing import contestants
from validation.timing.contestants import FORWARD, RNE
from validation.timing.families import Family, random_states
from validation.timing.stopwatch import race

PLAIN = "revolute joints, local"  # what `pin.aba` does by default with a chain read from a file
LONG_JOBS = (FORWARD, RNE)  # the ones that are O(n), timed at any length
FIRST_OF_FIT = 100  # n from which the exponent is fitted


class Settings(Spec, frozen=True):
    """Families by name, and how often and how long [s] each contestant runs."""

    chain: dict[str, Family]
    turns: int = 6
    turn: float = 0.0015


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
            chain = family.scene(case, segments).chain()
            for job, times in _times(chain, segments, family, settings):
                yield from _rows(name, job, times, segments == family.segments[0])
                own.setdefault(job, []).extend(times.values())
        for job, measured in own.items():
            yield from exponents(f"{name} {job}", measured)
            found.setdefault(job, []).extend((name, time) for time in measured)
    for job, entries in found.items():
        yield series(job, entries)


def _times(chain: Chain, segments: int, family: Family, settings: Settings) -> Iterator[tuple[str, dict[str, Time]]]:
    """Job by job, the times of all who take part: native, public, pinocchio, its fastest form, mujoco."""
    states = random_states(chain)
    parties = {"native": contestants.native(chain, states), "public": contestants.public(chain, states)}
    forms = contestants.pinocchio(chain, states) if segments <= family.pinocchio else {}
    if segments <= family.mujoco:
        parties["mujoco"] = contestants.mujoco_calls(chain, states)
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
    ours = times["native"]
    for name, time in times.items():
        setting = f"n = {time.n}" + (f", {time.form}" if time.form else "")
        if name not in ("native", "public"):
            ratio = time.seconds / ours.seconds
            yield Measured(f"{family} {job}: {name} / native", ratio, engine=name, setting=setting)
    if first:
        public = 1e6 * times["public"].seconds
        yield Measured(f"{family} {job}: public call", public, engine="native", setting=f"n = {ours.n}")


def exponents(label: str, times: list[Time]) -> Iterator[Measured]:
    """p of cost ∝ n^p by least squares on logarithms, of every engine with two chains that are long enough."""
    for engine in dict.fromkeys(time.engine for time in times):
        long = [(t.n, t.seconds) for t in times if t.engine == engine and t.n >= FIRST_OF_FIT]
        if len(long) > 1:
            n, seconds = np.log(np.array(long).T)
            slope = float(np.polyfit(n, seconds, 1)[0])
            setting = f"n = {long[0][0]} … {long[-1][0]}"
            quantity = f"{label}: exponent" if engine == "native" else "exponent of others"
            yield Measured(quantity, slope, label, engine, setting)


def series(job: str, entries: list[tuple[str, Time]]) -> Series:
    """Cost against n, a curve a family and engine, called "T1 | native"."""
    rows = [(f"{family} | {t.engine}", t.n, 1e6 * t.seconds) for family, t in entries]
    columns = table(("curve", "n", "time [µs]"), rows)
    labels = "n", "degrees of freedom n", "time [µs]"
    return Series(f"cost.{job}", f"Cost of {job}", columns, *labels, x_scale="log", y_scale="log", group="curve")
