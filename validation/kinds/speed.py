"""Speed of a complete simulation after warm-up: the fastest of several runs."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink import engines
from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from validation.case import Case, Measured
from validation.facts import Facts
from validation.runs import run_facts
from validation.speed.races import Work, race

TIMED = True


def run(case: Case, repeats: int, solvers: tuple[str, ...], engines: tuple[str, ...] = ()) -> Iterator[Measured]:
    """Yield simulated seconds per second, and time per step; `solvers` are flexlink's solvers for q̈."""
    for scene in case.load_scenes():
        works = {("native", solver): _runs("native", scene.varied({"run.solver": solver})) for solver in solvers}
        works |= {(name, ""): _runs(name, scene) for name in engines}
        for (name, solver), seconds in race(works, repeats, 0.0).items():
            facts: Facts = run_facts(scene.run) | ({"solver": solver} if solver else {})
            quantity = "real-time factor" if name == "native" else "real-time factor of another engine"
            yield Measured(quantity, scene.run.duration / seconds, scene.name, name, facts, timed=True)
            step = 1e6 * seconds * scene.run.fixed_step / scene.run.duration
            yield Measured("time of a step", step, scene.name, name, facts, timed=True)


def _runs(name: str, scene: Scene) -> Work:
    engine = engines.load(name, lump(scene))
    return lambda calls: [engine.integrate(scene) for _ in range(calls)]
