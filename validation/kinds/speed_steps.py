"""Time per Runge-Kutta step of complete simulations against n, compared with `mj_step` and a loop over `pin.aba`.

Every run must remain stable: the number of steps and the state are checked at its end.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

from flexlink.chain.lumping import lump
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import races, steps
from validation.speed.families import of_steps
from validation.speed.races import Race, Races
from validation.store import Series

TIMED = True


class Settings(Races, frozen=True):
    """The timing comparisons; segments of the longest chains, and their number of steps."""

    longest: dict[str, int]
    longest_steps: int


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield times per step, ratios, exponents, a series, and runs of the longest chains."""
    found: list[Race] = []
    for name, family, segments in settings.sizes():
        scene = family.released(case, segments)
        works = {"native": steps.native(scene)}
        if segments <= family.mujoco:
            works["mujoco"] = steps.by_mujoco(scene)
        if segments <= family.pinocchio:
            works["pinocchio"] = steps.by_pinocchio(scene)
        n = lump(scene).n
        found += settings.run(name, n, {engine: {"RK4 step": work} for engine, work in works.items()})
        facts: Facts = {"chain": name, "n": n}
        for other in list(works)[1:]:
            ratio = found[-1].times_less("native", other)
            yield Measured(f"{name}, n = {n}: {other} / native", ratio, "", other, facts, timed=True)
    yield from races.growth(found)
    for name, segments in settings.longest.items():
        scene = of_steps(settings.chain[name].released(case, segments), settings.longest_steps)
        start = time.perf_counter()
        end = simulate(scene)  # raises an error if it becomes non-finite
        seconds = time.perf_counter() - start
        facts = {"chain": name, "n": end.chain.n}
        yield Measured("steps of the longest chain", float(end.t[-1] / scene.run.fixed_step), varied=facts)
        yield Measured("run of the longest chain", seconds, varied=facts, timed=True)
