"""Speed of a whole simulation: warmed up, alone on the machine, the fastest of repeats."""

from __future__ import annotations

import functools
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from flexlink import engines
from flexlink.scene import Scene
from flexlink.spec import Spec
from validation.case import Case, Measured
from validation.kinds.motion import with_run

ROOT = Path(__file__).parent.parent.parent
FIRST = "import sys, flexlink; flexlink.simulate(flexlink.load_scene(sys.argv[1]))"


class Settings(Spec, frozen=True):
    """Repeats of a run, our ways of solving for q̈, and engines timed beside ours."""

    repeats: int
    dynamics: tuple[str, ...]
    engines: tuple[str, ...] = ()


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Simulated seconds per second, time of a step, and time from the start of Python to the end of a first run."""
    for scene, path in zip(case.load_scenes(), case.scene_files, strict=True):
        label = f"{scene.run.method} h={scene.run.step:g} s"
        for solver in settings.dynamics:
            yield from _timed("native", with_run(scene, dynamics=solver), f"{label}, {solver}", settings.repeats)
        for name in settings.engines:
            yield from _timed(name, scene, label, settings.repeats)
        command = [sys.executable, "-c", FIRST, str(path)]
        first = _fastest(functools.partial(subprocess.run, command, check=True, cwd=ROOT), settings.repeats)
        yield Measured("first run, warm cache", first, scene.name, setting=label)


def _timed(name: str, scene: Scene, setting: str, repeats: int) -> Iterator[Measured]:
    work = functools.partial(engines.load(name, scene.chain()).integrate, scene)
    work()  # compile, warm up
    seconds = _fastest(work, repeats)
    quantity = "real-time factor" if name == "native" else "real-time factor of another engine"
    yield Measured(quantity, scene.run.duration / seconds, scene.name, name, setting)
    step = 1e6 * seconds * scene.run.step / scene.run.duration
    yield Measured("time of a step", step, scene.name, name, setting)


def _fastest(work: Callable[[], object], repeats: int) -> float:
    """Shortest time of `repeats` calls [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)
