"""Size of the chunks of a run: how many steps to take before Python checks samples, signals and the terminal."""

from __future__ import annotations

import time

BREATH = 0.1  # time between two looks at the samples, at signals and the terminal [s]


Reached = tuple[int, float]
"""Progress of a run: samples that are there, and the part of its time."""


class ChunkSize:
    """Number of steps that take about `BREATH`: `size`, at first few for `n` joints, at most eight times the last."""

    def __init__(self, n: int) -> None:
        evaluations = 2000  # of one joint, and of a step of any method: 20 ms at most
        self.size, self._started = max(1, evaluations // n), time.perf_counter()
        self._looked = self._started

    def start(self) -> int:
        """Time what is done from now on; returns `size`."""
        self._started = time.perf_counter()
        return self.size

    @property
    def over(self) -> bool:
        """Whether `BREATH` has passed since the start."""
        return time.perf_counter() - self._started >= BREATH

    def end(self) -> bool:
        """`size` steps have been taken; returns whether it is time to look at them."""
        now = time.perf_counter()
        # short runs take few pieces, and a clock that stands does not end it all in one
        self.size = max(1, int(self.size * min(8.0, BREATH / max(now - self._started, 1e-9))))
        due = not 0 < now - self._looked < BREATH / 4  # 0: the clock stands
        if due:
            self._looked = now
        return due
