"""Time of calls on long chains: a run with a tolerance, static equilibrium, the slowest modes, a linear model."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from msgspec.structs import replace

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.dynamics.equilibrium import solve_static
from flexlink.dynamics.vibration.linear import linearize
from flexlink.dynamics.vibration.modal import modes
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.speed.families import Family
from validation.speed.races import processor_time

TIMED = True


def rehearsal(settings: Any) -> Any:
    """Settings for a rehearsal: the shortest chain of every family, once."""
    chain = {name: replace(family, segments=family.segments[:1]) for name, family in settings.chain.items()}
    return replace(settings, chain=chain, turns=1)


def run(case: Case, chain: dict[str, Family], tolerance: Positive, count: int, turns: int = 5) -> Iterator[Measured]:
    """Yield the CPU time of each call, the fastest of up to `turns`, and the exponent between two lengths.

    `tolerance` [m] is the tolerance of the run, `count` the number of modes.
    """
    for name, family in chain.items():
        before: dict[str, tuple[int, float]] = {}
        for segments in family.segments:
            scene = family.scene(case, segments)
            n = lump(scene).n
            for job, call in _calls(scene, tolerance, count).items():
                seconds = _least_cpu(call, turns)
                yield Measured(f"{name} {job}, n = {n}", 1e3 * seconds, scene.name, varied={"n": n}, timed=True)
                if job in before:
                    first, least = before[job]
                    p = math.log(seconds / least) / math.log(n / first)
                    yield Measured(f"{name} {job}: exponent", p, scene.name, varied={"n": n}, timed=True)
                before[job] = n, seconds


def _calls(scene: Scene, tolerance: float, count: int) -> dict[str, Callable[[], object]]:
    chain = lump(scene)
    driven = chain.active.tolist()
    return {
        "simulate": lambda: simulate(scene, tolerance=tolerance),
        "static": lambda: solve_static(chain, locked=driven),
        "modes": lambda: modes(chain, locked=driven, count=count),
        "linear model": lambda: linearize(chain, chain.rest),
    }


def _least_cpu(call: Callable[[], object], turns: int, enough: float = 1.0) -> float:
    """Least CPU time of up to `turns` calls [s]; stops once `enough` seconds are spent."""
    taken: list[float] = []
    while len(taken) < turns and sum(taken) < enough:
        taken.append(processor_time(call))
    return min(taken)
