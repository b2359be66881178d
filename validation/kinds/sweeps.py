"""Sweeps that are killed, or lose a worker, beside one that nothing disturbs: each member once, and the same rows."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import flexlink as fl
from flexlink.describe.spec import Spec
from validation import sweep_processes
from validation.case import Case, Measured
from validation.facts import Facts

LOST_AFTER, LAST_KILL = 0.1, 0.9
"""Parts of the members that have rows when a worker of a cluster is killed, and at most when a sweep is."""


class Settings(Spec, frozen=True):
    """A sweep of validation/sweeps and its members; kills at random counts of rows; or Dask workers, one killed."""

    sweep: str
    members: int
    workers: int = 2
    kills: int = 0
    seed: int = 0
    cluster: int = 0


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """How often it was killed, members without exactly one row, and rows that differ."""
    facts: Facts = {"members": settings.members}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sweep, out = sweep_processes.shortened(settings.sweep, settings.members, folder), folder / "sweep_processes.db"
        kills = _with_a_worker_lost(settings, sweep, out) if settings.cluster else _killed(settings, sweep, out)
        rows = sweep_processes.rows(out)
        whole = fl.sweep(sweep, workers=settings.workers).rows
    yield Measured("kills", float(kills), varied=facts)
    times = Counter(row[0] for row in rows)
    yield Measured("not once", float(sum(times[k] != 1 for k in range(settings.members))), varied=facts)
    different = sum(row != other for row, other in zip(rows, whole, strict=False)) + abs(len(rows) - len(whole))
    yield Measured("rows that differ", float(different), varied=facts)
    yield Measured("failed", float(sum(row[1] != "done" for row in whole)), varied=facts)


def _killed(settings: Settings, sweep: Path, out: Path) -> int:
    last = int(LAST_KILL * settings.members)  # beyond, the tasks that are left may all end at once
    counts = np.random.default_rng(settings.seed).integers(last, size=settings.kills)
    return sweep_processes.killed_at(sorted(counts.tolist()), sweep, out, "--workers", str(settings.workers))


def _with_a_worker_lost(settings: Settings, sweep: Path, out: Path) -> int:
    """The sweep goes on with those that are left; whether it was at work when the worker was killed."""
    with (
        sweep_processes.cluster(out.parent, settings.cluster) as (address, workers),
        sweep_processes.started(sweep, out, "--dask", address) as process,
    ):
        sweep_processes.until(lambda: sweep_processes.counted(out) >= LOST_AFTER * settings.members, process)
        at_work = process.poll() is None
        workers[0].kill()
        sweep_processes.finish(process)
    return int(at_work)
