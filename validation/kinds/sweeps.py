"""Sweeps: what survives a kill, throughput, and limits of millions of members."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import flexlink as fl
from flexlink.common.errors import EngineError, FlexlinkError
from flexlink.sweeps.plan import Plan, Sweep
from validation import sweep_processes
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.speed.races import processor_time, race
from validation.speed.steps import mujoco_sweep
from validation.sweep_processes import ENVIRONMENT, cluster, shortened

LOST_AFTER, LAST_KILL = 0.1, 0.9
"""Share of stored members at which a cluster's worker is killed; largest share at which a sweep is killed."""


@kind
def sweeps(
    case: Case, sweep: str, members: int, workers: int = 2, kills: int = 0, seed: int = 0, cluster: int = 0
) -> Iterator[Measured]:
    """A sweep that is killed or loses a worker must end with one row per member, and the rows of an undisturbed sweep.

    Yield the numbers of kills, of members without exactly one row, and of rows that differ.

    The sweep is one of validation/sweeps. It is killed at random row counts, or runs on `cluster` Dask workers, one of
    which is killed.
    """
    facts: Facts = {"members": members}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        file, out = sweep_processes.shortened(sweep, members, folder), folder / "disturbed.db"
        if cluster:
            killed = _with_a_worker_lost(file, out, cluster, members)
        else:
            last = int(LAST_KILL * members)  # last row count to kill at; later, all remaining tasks may end at once
            counts = sorted(np.random.default_rng(seed).integers(last, size=kills).tolist())
            killed = sweep_processes.killed_at(counts, file, out, "--workers", str(workers))
        rows = sweep_processes.rows(out)
        whole = fl.sweep(file, workers=workers).rows
    yield Measured("kills", float(killed), varied=facts)
    times = Counter(row[0] for row in rows)
    yield Measured("not once", float(sum(times[k] != 1 for k in range(members))), varied=facts)
    different = sum(row != other for row, other in zip(rows, whole, strict=False)) + abs(len(rows) - len(whole))
    yield Measured("rows that differ", float(different), varied=facts)
    yield Measured("failed", float(sum(row[1] != "done" for row in whole)), varied=facts)


def _with_a_worker_lost(sweep: Path, out: Path, cluster: int, members: int) -> int:
    """Kill one worker of a cluster during a sweep; return 1 if the sweep was still running, 0 if not."""
    with (
        sweep_processes.cluster(out.parent, cluster) as (address, workers),
        sweep_processes.started(sweep, out, "--dask", address) as process,
    ):
        sweep_processes.until(lambda: sweep_processes.counted(out) >= LOST_AFTER * members, process)
        at_work = process.poll() is None
        workers[0].kill()
        sweep_processes.finish(process)
    return int(at_work)


@kind(timed=True, rehearsal={"members": 64, "workers": 1, "turns": 1, "beside": 1, "turn": 0.0})
def speed_sweep(
    case: Case, sweep: str, members: int, workers: int = 2, turns: int = 3, beside: int = 100, turn: float = 1.0
) -> Iterator[Measured]:
    """Throughput of a sweep with several workers and its database, and of one process that calls MuJoCo.

    Yield members per second of a sweep, MuJoCo's time per member in three ways, their ratios, and CPU times.

    The sweep is one of validation/sweeps. The programs take turns, and the fastest turns count: flexlink runs all
    members on all workers, MuJoCo runs `beside` members for at least `turn` [s].
    """
    facts: Facts = {"members": members}
    with tempfile.TemporaryDirectory() as folder:
        file = shortened(sweep, members, Path(folder))
        plan = Plan(Sweep.load(file))
        works = mujoco_sweep([plan.member(k)[0] for k in range(min(beside, members))])
        theirs, ours = dict.fromkeys(works, math.inf), math.inf
        for number in range(turns):
            ours = min(ours, _seconds(file, members, workers, Path(folder) / f"{number}.db"))
            for name, seconds in race(works, 1, turn).items():
                theirs[name] = min(theirs[name], seconds)
        own = processor_time(lambda: fl.sweep(file, out=Path(folder) / "own.db")) / members
        cost = {name: processor_time(lambda w=w: w(beside)) / beside for name, w in works.items()}  # type: ignore[misc]
    yield Measured("members a second", 1 / ours, varied=facts, timed=True)
    yield Measured("CPU time of a member", 1e3 * own, varied=facts, timed=True)
    for name, seconds in theirs.items():
        yield Measured(f"time of a member: {name}", 1e3 * seconds, "", "mujoco", timed=True)
        yield Measured(f"{name}: mujoco / native", seconds / ours, "", "mujoco", facts, timed=True)
        by_cost = workers * cost[name] / own
        yield Measured(f"{name}: mujoco / native, of CPU time", by_cost, "", "mujoco", facts, timed=True)


def _seconds(sweep: Path, members: int, workers: int, out: Path) -> float:
    """Seconds per member with all workers, without the start of the workers, which does not depend on the size."""
    marks: list[tuple[float, float]] = []
    fl.sweep(sweep, out=out, workers=workers, progress=lambda part: marks.append((part, time.perf_counter())))
    marks = [mark for mark in marks if mark[0] > 0]
    if len(marks) < 2:
        raise FlexlinkError(f"members = {members}: too few to measure the throughput")
    (first, begun), (last, ended) = marks[0], marks[-1]
    return (ended - begun) / ((last - first) * members)


@kind(timed=True, rehearsal={"sizes": [1000], "members": 64, "durations": lambda every: every[:1]})
def sweep_limits(
    case: Case, sweep: str, sizes: list[int], members: int, durations: list[float], workers: int = 2
) -> Iterator[Measured]:
    """Limits of sweeps of millions of members: memory and time of planning, running and storing a slice.

    Plan a sweep of each size, run a slice of the largest on processes and on Dask, and extrapolate by a model.

    The model is: members per second = min(workers / time of a member, 1 / the parent's time per row). The sweep is one
    of validation/sweeps, with Sobol points.
    """
    with tempfile.TemporaryDirectory() as name:
        files = {}
        for size in sizes:
            (folder := Path(name) / str(size)).mkdir()
            files[size] = shortened(sweep, size, folder, "sobol")
            found = _measured_slice(files[size])["planned"]
            yield Measured("memory of a plan", found["megabytes"], varied={"members": size})
            yield Measured("time of a plan", found["seconds"], varied={"members": size}, timed=True)
        largest = files[max(sizes)]
        times = _measured_slice(largest, "--durations", *map(str, durations))["member"]
        for duration, seconds in zip(durations, times, strict=True):
            steps = f"{round(duration / STEP):,} steps"
            yield Measured(f"CPU time of a member, {steps}", 1e3 * seconds, timed=True)
        found = _measured_slice(largest, "--slice", str(members), "--workers", str(workers))
        yield from _of_slice("processes", found, times[-1], workers)
        with cluster(Path(name), workers) as (address, _):
            found = _measured_slice(largest, "--slice", str(members), "--dask", address)
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


def _measured_slice(file: Path, *options: str) -> dict[str, Any]:
    """Results of `validation.sweep_slice` in a separate process."""
    command = [sys.executable, "-m", "validation.sweep_slice", str(file), *options]
    done = subprocess.run(command, env=ENVIRONMENT, text=True, capture_output=True, check=False)
    if done.returncode:
        raise EngineError(f"validation.sweep_slice ended with {done.returncode}: {done.stderr.strip()[-200:]}")
    found: dict[str, Any] = json.loads(done.stdout)
    return found
