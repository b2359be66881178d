"""A sweep that is killed or loses a worker must end with one row per member, and the rows of an undisturbed sweep."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import flexlink as fl
from validation import sweep_processes
from validation.case import Case, Measured
from validation.facts import Facts

LOST_AFTER, LAST_KILL = 0.1, 0.9
"""Share of stored members at which a cluster's worker is killed; largest share at which a sweep is killed."""


def run(
    case: Case, sweep: str, members: int, workers: int = 2, kills: int = 0, seed: int = 0, cluster: int = 0
) -> Iterator[Measured]:
    """Yield the numbers of kills, of members without exactly one row, and of rows that differ.

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
