"""Run a slice of a long sweep, to measure the memory and time to plan it, run its members and store their rows.

python -m validation.sweep_slice SWEEP.toml --slice 20000 --workers 2
python -m validation.sweep_slice SWEEP.toml --slice 20000 --dask tcp://127.0.0.1:8786
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from flexlink.common.interruption import Stop
from flexlink.common.progress import Progress
from flexlink.sweeps.plan import Plan, Sweep, fingerprint, version
from flexlink.sweeps.run import Execution
from flexlink.sweeps.store import Store
from flexlink.sweeps.worker import rows_of
from flexlink.sweeps.workers import WorkerPool, pool_of
from validation.memory import peak_megabytes

WARM = 4
"""Number of untimed tasks per worker, which load machine code."""


def planned(file: Path) -> dict[str, float]:
    """CPU time [s] and memory [MB] for planning a sweep and computing the values of three of its members."""
    sweep = Sweep.load(file)
    Plan(replace(sweep, sample=replace(sweep.sample, count=4))).values(0)  # type: ignore[type-var]  # imports
    before, begun = peak_megabytes(), time.process_time()
    plan = Plan(sweep)
    for number in (plan.members - 1, 0, plan.members // 2):
        plan.values(number)
    return {"seconds": time.process_time() - begun, "megabytes": peak_megabytes() - before}


def member_time(sweep: Sweep, duration: float, members: int = 512, turns: int = 5) -> float:
    """CPU time per member in a worker, the minimum over `turns` repetitions [s]."""
    text = msgspec.json.encode(replace(sweep, set={**sweep.set, "run.duration": duration}))
    rows_of(text, version(), range(members))
    times = []
    for turn in range(1, turns + 1):
        begun = time.process_time()
        rows_of(text, version(), range(turn * members, (turn + 1) * members))
        times.append(time.process_time() - begun)
    return min(times) / members


def run_slice(sweep: Sweep, pool: WorkerPool, size: int) -> dict[str, float]:
    """Run `size` members and store their rows: rates, the parent's CPU time per row, the workers' memory."""
    plan = Plan(sweep)
    marks: list[tuple[float, float, int]] = []
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "slice.db"
        with Store(out, plan, fingerprint(sweep)) as store:
            bar, done = Progress("slice", parts=plan.members, what="members"), 0
            for rows in Execution(plan, pool, Stop()).rows(store.missing()):
                store.add(rows)
                done += len(rows)
                bar(done / plan.members)
                marks.append((time.process_time(), time.perf_counter(), done))
                if done >= size:
                    break
            most = max(future.result() for future in [pool.executor.submit(peak_megabytes) for _ in range(pool.slots)])
        kept = out.stat().st_size / done
    (cpu, begun, before), (cpu_end, end, after) = marks[min(WARM * pool.slots, len(marks) - 2)], marks[-1]
    return {
        "row": (cpu_end - cpu) / (after - before),
        "rate": (after - before) / (end - begun),
        "bytes": kept,
        "worker": most,
        "parent": peak_megabytes(),
    }


def main() -> None:
    """Print the results as JSON."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sweep", type=Path)
    parser.add_argument("--slice", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--dask")
    parser.add_argument("--durations", type=float, nargs="*", default=())
    options = parser.parse_args()
    found: dict[str, Any] = {"planned": planned(options.sweep)}
    sweep = Sweep.load(options.sweep)
    if options.slice:
        with pool_of(None, options.workers, options.dask) as pool:
            found["slice"] = run_slice(sweep, pool, options.slice)
    found["member"] = [member_time(sweep, duration) for duration in options.durations]
    print(json.dumps(found))


if __name__ == "__main__":
    main()
