"""Load of the machine during a timed case: cores used by other processes, and spread of a calibration loop's times."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import NamedTuple

from validation.store import Conditions

PROC_STAT = Path("/proc/stat")
TICKS = os.sysconf("SC_CLK_TCK") if hasattr(os, "sysconf") else 100  # 1/s
SHORTEST_LOAD = 0.2  # s; the system counts in ticks of 0.01 s, so loads over shorter times are mostly rounding error


class LoadMonitor:
    """Measures the load of the machine from the monitor's construction to a call of `conditions`."""

    def __init__(self) -> None:
        self._laps = _laps()
        self._start = _read()

    def conditions(self) -> Conditions:
        """Load since the monitor's construction, and spread of the calibration times at both ends."""
        start, end = self._start, _read()
        load = None
        passed = end.wall - start.wall
        if start.every is not None and end.every is not None and passed >= SHORTEST_LOAD:
            others = (end.every - start.every) - (end.own - start.own)
            load = round(max(0.0, others) / passed, 3)
        laps = sorted(self._laps + _laps())
        usual = laps[: len(laps) - len(laps) // 50]  # drop the slowest 2 %: rare delays do not affect minima either
        spread = sum(usual) / len(usual) / laps[0] - 1.0
        return Conditions(load, round(spread, 3), os.cpu_count() or 1)


class ClockReading(NamedTuple):
    """Seconds of wall time, of CPU time of all processes, and of CPU time of this process and those that it started."""

    wall: float
    every: float | None
    own: float


def _read() -> ClockReading:
    times = os.times()
    own = times.user + times.system + times.children_user + times.children_system  # children that have ended
    return ClockReading(time.perf_counter(), _busy_seconds(), own + _seconds_of_running_children())


def _busy_seconds() -> float | None:
    """CPU time of processes, interrupts and the virtual machine's host, over all cores [s]; None if not counted."""
    if not PROC_STAT.exists():
        return None
    user, nice, system, _idle, _wait, *interrupts = map(int, PROC_STAT.read_text().splitlines()[0].split()[1:9])
    return float(user + nice + system + sum(interrupts)) / TICKS


def _seconds_of_running_children() -> float:
    """CPU time of running processes that this one started, such as an engine's, and of their ended children [s]."""
    running = dict[int, tuple[int, int]]()  # process → its parent, and ticks of CPU time
    for file in PROC_STAT.parent.glob("[0-9]*/stat"):
        try:
            _, parent, *fields = file.read_text().rpartition(")")[2].split()
        except OSError:  # ended meanwhile
            continue
        running[int(file.parent.name)] = int(parent), sum(map(int, fields[9:13]))
    found, own = 0, {os.getpid()}
    while children := {pid for pid, (parent, _) in running.items() if parent in own}:
        found += sum(running.pop(pid)[1] for pid in children)
        own = children
    return found / TICKS


def _laps() -> list[float]:
    """Seconds of each lap of the calibration loop: about 50 ms, more than a time slice of the scheduler."""
    found = []
    for _ in range(100):
        start, total = time.perf_counter(), 0
        for i in range(10_000):
            total += i * i
        found.append(time.perf_counter() - start)
    return found
