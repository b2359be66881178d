"""Throughput of a sweep with several workers and its database, and of one process that calls MuJoCo."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from msgspec.structs import replace

import flexlink as fl
from flexlink.common.errors import FlexlinkError
from flexlink.sweeps.plan import Plan, Sweep
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import mujoco_sweep
from validation.speed.races import processor_time, race
from validation.sweep_processes import shortened

TIMED = True


def rehearsal(settings: Any) -> Any:
    """Settings with few members, whose time is mostly compilation."""
    return replace(settings, members=64, workers=1, turns=1, beside=1, turn=0.0)


def run(
    case: Case, sweep: str, members: int, workers: int = 2, turns: int = 3, beside: int = 100, turn: float = 1.0
) -> Iterator[Measured]:
    """Yield members per second of a sweep, MuJoCo's time per member in three ways, their ratios, and CPU times.

    The sweep is one of validation/sweeps. The programs take turns, and the fastest turns count: flexlink runs all
    members on all workers, MuJoCo runs `beside` members for at least `turn` [s].
    """
    facts: Facts = {"members": members}
    with tempfile.TemporaryDirectory() as folder:
        file = shortened(sweep, members, Path(folder))
        plan = Plan(Sweep.load(file))
        works = mujoco_sweep.works([plan.member(k)[0] for k in range(min(beside, members))])
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
