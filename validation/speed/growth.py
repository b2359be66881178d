"""Races on families of chains: how the contestants' times grow with the number of joints n."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from msgspec.structs import replace

from flexlink.describe.spec import NonNegative, Spec
from validation.case import Measured
from validation.facts import Facts
from validation.speed.families import Family
from validation.store import Series, table


class Races(Spec, frozen=True):
    """Families by name, and how often and how long [s] each contestant runs."""

    chain: dict[str, Family]
    turns: int
    turn: NonNegative


class Time(NamedTuple):
    """Seconds a call of an engine."""

    chain: str
    job: str
    engine: str
    n: int
    seconds: float
    form: str = ""


Some = TypeVar("Some", bound=Races)


def rehearsal(settings: Some) -> Some:
    """The shortest chain of every family, once."""
    shortest = {name: replace(family, segments=family.segments[:1]) for name, family in settings.chain.items()}
    return replace(settings, chain=shortest, turns=1, turn=0.0)


def growth(times: Sequence[Time]) -> Iterator[Measured | Series]:
    """Exponents of every family, job and engine, and for every job a series to draw."""
    for chain, job, engine in dict.fromkeys(time[:3] for time in times):
        yield from exponent([time for time in times if time[:3] == (chain, job, engine)])
    for job in dict.fromkeys(time.job for time in times):
        yield series([time for time in times if time.job == job])


def exponent(times: Sequence[Time]) -> Iterator[Measured]:
    """p of cost ∝ n^p by least squares on logarithms, if at least two chains are long enough."""
    shortest = 100  # joints; below, what does not grow with n is a part of the time
    long = [time for time in times if time.n >= shortest]
    if len(long) > 1:
        first, last = long[0], long[-1]
        n, seconds = np.log([(time.n, time.seconds) for time in long]).T
        facts: Facts = {"chain": first.chain, "job": first.job, "n": first.n, "to n": last.n}
        quantity = f"{first.chain} {first.job}: exponent" if first.engine == "native" else "exponent of others"
        yield Measured(quantity, float(np.polyfit(n, seconds, 1)[0]), "", first.engine, facts, timed=True)


def series(times: Sequence[Time]) -> Series:
    """Cost of one job against n: a panel a family, a curve an engine."""
    job = times[0].job
    columns = table(("chain", "engine", "n", "time [µs]"), [(t.chain, t.engine, t.n, 1e6 * t.seconds) for t in times])
    labels = "n", "degrees of freedom n", "time [µs]"
    title = f"Time of one {job}"
    return Series("cost", title, columns, *labels, "log", "log", group="engine", panel="chain", part=job)
