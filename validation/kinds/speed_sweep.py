"""Throughput of a sweep on some workers, into its database, beside a process that calls MuJoCo for the same members."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from msgspec.structs import replace

import flexlink as fl
from flexlink.common.errors import FlexlinkError
from flexlink.describe.spec import Spec
from flexlink.sweeps.plan import Plan, load_sweep
from validation.case import Case, Measured
from validation.facts import Facts
from validation.speed import mujoco_sweep
from validation.speed.stopwatch import race
from validation.sweep_processes import shortened

TIMED = True


class Settings(Spec, frozen=True):
    """A sweep of validation/sweeps; members of a turn, workers, turns; MuJoCo's members, and seconds of its turns."""

    sweep: str
    members: int
    workers: int = 2
    turns: int = 3
    beside: int = 100
    turn: float = 1.0


def rehearsal(settings: Settings) -> Settings:
    """So few members that nothing but compilation takes time."""
    return replace(settings, members=64, workers=1, turns=1, beside=1, turn=0.0)


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Members a second of the whole sweep, time of a member by MuJoCo's three ways, and the ratios; CPU time, too.

    Contestants take turns, of which the fastest count.
    """
    facts: Facts = {"members": settings.members}
    with tempfile.TemporaryDirectory() as folder:
        sweep = shortened(settings.sweep, settings.members, Path(folder))
        plan = Plan(load_sweep(sweep))
        works = mujoco_sweep.works([plan.member(k)[0] for k in range(min(settings.beside, settings.members))])
        theirs, ours = dict.fromkeys(works, math.inf), math.inf
        for turn in range(settings.turns):
            ours = min(ours, _seconds(sweep, settings, Path(folder) / f"{turn}.db"))
            for name, lap in race(works, 1, settings.turn).items():
                theirs[name] = min(theirs[name], lap.seconds)
        own = _processor_time(lambda: fl.sweep(sweep, out=Path(folder) / "own.db")) / settings.members
        cost = {name: _processor_time(lambda w=w: w(settings.beside)) / settings.beside for name, w in works.items()}  # type: ignore[misc]
    yield Measured("members a second", 1 / ours, varied=facts, timed=True)
    yield Measured("CPU time of a member", 1e3 * own, varied=facts, timed=True)
    for name, seconds in theirs.items():
        yield Measured(f"time of a member: {name}", 1e3 * seconds, "", "mujoco", timed=True)
        yield Measured(f"{name}: mujoco / native", seconds / ours, "", "mujoco", facts, timed=True)
        by_cost = settings.workers * cost[name] / own
        yield Measured(f"{name}: mujoco / native, of CPU time", by_cost, "", "mujoco", facts, timed=True)


def _seconds(sweep: Path, settings: Settings, out: Path) -> float:
    """Of a member on all workers, from the first rows on: their start, seconds, is once for a sweep of any length."""
    marks: list[tuple[float, float]] = []
    fl.sweep(sweep, out=out, workers=settings.workers, progress=lambda part: marks.append((part, time.perf_counter())))
    marks = [mark for mark in marks if mark[0] > 0]
    if len(marks) < 2:
        raise FlexlinkError(f"members = {settings.members}: too few to see the throughput of")
    (first, begun), (last, ended) = marks[0], marks[-1]
    return (ended - begun) / ((last - first) * settings.members)


def _processor_time(work: Callable[[], object]) -> float:
    """Of this process [s], which does not change much where others share its cores."""
    begun = time.process_time()
    work()
    return time.process_time() - begun
