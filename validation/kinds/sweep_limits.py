"""Limits of sweeps of millions of members: memory and time of planning, running and storing a slice."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from msgspec.structs import replace

from flexlink.common.errors import EngineError
from validation.case import Case, Measured
from validation.sweep_processes import ENVIRONMENT, cluster, shortened

TIMED = True


def rehearsal(settings: Any) -> Any:
    """Settings with few members, whose time is mostly compilation."""
    return replace(settings, sizes=[1000], members=64, durations=settings.durations[:1])


def run(
    case: Case, sweep: str, sizes: list[int], members: int, durations: list[float], workers: int = 2
) -> Iterator[Measured]:
    """Plan a sweep of each size, run a slice of the largest on processes and on Dask, and extrapolate by a model.

    The model is: members per second = min(workers / time of a member, 1 / the parent's time per row). The sweep is one
    of validation/sweeps, with Sobol points.
    """
    with tempfile.TemporaryDirectory() as name:
        files = {}
        for size in sizes:
            (folder := Path(name) / str(size)).mkdir()
            files[size] = shortened(sweep, size, folder, "sobol")
            found = _measured(files[size])["planned"]
            yield Measured("memory of a plan", found["megabytes"], varied={"members": size})
            yield Measured("time of a plan", found["seconds"], varied={"members": size}, timed=True)
        largest = files[max(sizes)]
        times = _measured(largest, "--durations", *map(str, durations))["member"]
        for duration, seconds in zip(durations, times, strict=True):
            steps = f"{round(duration / STEP):,} steps"
            yield Measured(f"CPU time of a member, {steps}", 1e3 * seconds, timed=True)
        found = _measured(largest, "--slice", str(members), "--workers", str(workers))
        yield from _of_slice("processes", found, times[-1], workers)
        with cluster(Path(name), workers) as (address, _):
            found = _measured(largest, "--slice", str(members), "--dask", address)
            yield from _of_slice("Dask", found, times[-1], workers)


STEP = 1e-4
"""Time step of the runs [s]."""


def _of_slice(pool: str, found: dict[str, Any], member: float, workers: int) -> Iterator[Measured]:
    """Yield results of a slice; `member` is the CPU time of one member [s]."""
    part = found["slice"]
    most = min(workers / member, 1 / part["row"])
    yield Measured(f"{pool}: parent's time of a row", 1e6 * part["row"], timed=True)
    yield Measured(f"{pool}: memory of the parent", part["parent"])
    yield Measured(f"{pool}: memory of a worker", part["worker"])
    yield Measured(f"{pool}: bytes of a row", part["bytes"])
    yield Measured(f"{pool}: members a second", part["rate"], timed=True)
    yield Measured(f"{pool}: model, members a second", most, timed=True)
    yield Measured(f"{pool}: measured / model", part["rate"] / most, timed=True)
    yield Measured(f"{pool}: workers that one parent keeps busy", member / part["row"], timed=True)
    for size in (1e6, 1e7, 1e8):
        yield Measured(f"{pool}: model, hours of {size:.0e} members", size / most / 3600, timed=True)
    yield Measured(f"{pool}: model, hours of 1e+08 members at most", 1e8 * part["row"] / 3600, timed=True)


def _measured(file: Path, *options: str) -> dict[str, Any]:
    """Results of `validation.sweep_slice` in a separate process."""
    command = [sys.executable, "-m", "validation.sweep_slice", str(file), *options]
    done = subprocess.run(command, env=ENVIRONMENT, text=True, capture_output=True, check=False)
    if done.returncode:
        raise EngineError(f"validation.sweep_slice ended with {done.returncode}: {done.stderr.strip()[-200:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found
