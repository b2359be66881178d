"""Speed of a whole simulation: warmed up, alone on the machine, the fastest of repeats."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink import engines
from flexlink.scene import Scene
from flexlink.spec import Spec
from validation.case import Case, Measured
from validation.kinds.motion import with_run
from validation.timing.stopwatch import Work, race


class Settings(Spec, frozen=True):
    """Repeats of a run, our ways of solving for q̈, and engines timed beside ours."""

    repeats: int
    dynamics: tuple[str, ...]
    engines: tuple[str, ...] = ()


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Simulated seconds per second, and time of a step."""
    for scene in case.load_scenes():
        label = f"{scene.run.method} h={scene.run.step:g} s"
        works = {
            ("native", f"{label}, {solver}"): _runs("native", with_run(scene, dynamics=solver))
            for solver in settings.dynamics
        }
        works |= {(name, label): _runs(name, scene) for name in settings.engines}
        for (name, setting), lap in race(works, settings.repeats, 0.0).items():
            quantity = "real-time factor" if name == "native" else "real-time factor of another engine"
            yield Measured(quantity, scene.run.duration / lap.seconds, scene.name, name, setting)
            step = 1e6 * lap.seconds * scene.run.step / scene.run.duration
            yield Measured("time of a step", step, scene.name, name, setting)


def _runs(name: str, scene: Scene) -> Work:
    engine = engines.load(name, scene.chain())
    return lambda calls: [engine.integrate(scene) for _ in range(calls)]
