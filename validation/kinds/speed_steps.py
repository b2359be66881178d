"""Time of a Runge-Kutta step of whole simulations against n, beside `mj_step` and a loop over Pinocchio's `aba`.

Every run stays stable, or it is an error: step and state are checked at its end.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from flexlink.chain.lumping import lump
from flexlink.describe.spec import Spec
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds.speed_calls import Time, exponents, series
from validation.speed import steps
from validation.speed.families import Family, of_steps
from validation.speed.stopwatch import race
from validation.store import Series

TIMED = True


class Settings(Spec, frozen=True):
    """Families by name, segments of the longest chains and their steps, and how often and how long [s] each runs."""

    chain: dict[str, Family]
    longest: dict[str, int]
    longest_steps: int
    turns: int = 6
    turn: float = 0.006


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Times of a step, ratios, exponents, a series to draw, and the longest chains."""
    entries: list[tuple[str, Time]] = []
    for name, family in settings.chain.items():
        times: list[Time] = []
        for segments in family.segments:
            found = _race(case, family, segments, settings)
            yield from _rows(name, found)
            times += found
        yield from exponents(name, "RK4 step", times)
        entries += [(name, each) for each in times]
    yield series("RK4 step", entries)
    for name, segments in settings.longest.items():
        scene = of_steps(settings.chain[name].released(case, segments), settings.longest_steps)
        start = time.perf_counter()
        end = simulate(scene)  # an error if it leaves the finite numbers
        seconds = time.perf_counter() - start
        facts: Facts = {"chain": name, "n": end.chain.n}
        yield Measured("steps of the longest chain", float(end.t[-1] / scene.run.step), varied=facts)
        yield Measured("run of the longest chain", seconds, varied=facts, timed=True)


def _race(case: Case, family: Family, segments: int, settings: Settings) -> list[Time]:
    scene = family.released(case, segments)
    works = {"native": steps.native(scene)}
    if segments <= family.mujoco:
        works["mujoco"] = steps.by_mujoco(scene)
    if segments <= family.pinocchio:
        works["pinocchio"] = steps.by_pinocchio(scene)
    laps = race(works, settings.turns, settings.turn)
    return [Time(name, lump(scene).n, lap.seconds) for name, lap in laps.items()]


def _rows(family: str, times: list[Time]) -> Iterator[Measured]:
    ours = times[0]
    for each in times:
        if each is not ours:
            ratio = each.seconds / ours.seconds
            facts: Facts = {"chain": family, "n": each.n}
            yield Measured(f"{family}, n = {each.n}: {each.engine} / native", ratio, "", each.engine, facts, timed=True)
