"""Cold and warm start, import time, and growth of memory with the length of a run.

Every measurement is a separate process; the cold start has an empty cache folder.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator

from validation.case import Case, Measured
from validation.sources import ROOT

PEAK_SCRIPT = """
import sys, flexlink
from validation.memory import peak_megabytes
scene = flexlink.load_scene(sys.argv[1])
def peak(steps):
    h = scene.run.fixed_step
    flexlink.simulate(scene, duration=steps * h, sample=steps / 100 * h)
    return peak_megabytes()
short, long = peak(int(sys.argv[2])), peak(int(sys.argv[3]))
print(long - short)
"""


TIMED = True
LONG = True


def run(case: Case, repeats: int, steps: tuple[int, int]) -> Iterator[Measured]:
    """Yield CPU times of the command, cold and warm, and of the import; and a long run's additional peak memory.

    `steps` are the numbers of steps of a short and a long run, both with 101 samples.
    """
    for scene, path in zip(case.load_scenes(), case.scene_files, strict=True):
        with tempfile.TemporaryDirectory() as folder:
            environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"} | {"XDG_CACHE_HOME": folder}
            command = [sys.executable, "-m", "flexlink", "simulate", str(path)]
            seconds, output = _timed(command, environment)
            yield Measured("cold start", seconds, scene.name, timed=True)
            yield Measured("cold start says that it compiles", float("compil" in output.lower()), scene.name)
            warm = min(_timed(command, environment)[0] for _ in range(repeats))
            yield Measured("warm start", warm, scene.name, timed=True)
            importing = [sys.executable, "-c", "import flexlink"]
            again = (_timed(importing, environment)[0] for _ in range(repeats))
            yield Measured("import", min(again), timed=True)
        short, long = steps
        growth = _timed([sys.executable, "-c", PEAK_SCRIPT, str(path), str(short), str(long)], dict(os.environ))[1]
        note = f"Against {short:,} steps; 101 samples both."
        yield Measured("growth of memory", float(growth.split()[-1]), scene.name, varied={"steps": long}, note=note)


def _timed(command: list[str], environment: dict[str, str]) -> tuple[float, str]:
    """CPU time of a process from start to end, and its output."""
    start = os.times()
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    end = os.times()
    seconds = end.children_user - start.children_user + end.children_system - start.children_system
    return seconds, done.stderr + done.stdout
