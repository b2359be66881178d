"""Chunk size of a run: number of compiled steps between two checks of samples, signals and terminal by Python."""

from __future__ import annotations

import time

BREATH = 0.1  # time between two checks of samples, signals and the terminal [s]


Reached = tuple[int, float]
"""Progress of a run: number of samples computed, and completed fraction of its duration."""


class ChunkSize:
    """Adaptive chunk size, such that `size` steps take about `BREATH`; it starts small, and grows at most 8-fold."""

    def __init__(self, n: int) -> None:
        evaluations = 2000  # evaluations for one joint in the first chunk; they take at most 20 ms by any method
        self.size, self._started = max(1, evaluations // n), time.perf_counter()
        self._looked = self._started

    def start(self) -> int:
        """Start timing a chunk; return its `size`."""
        self._started = time.perf_counter()
        return self.size

    @property
    def over(self) -> bool:
        """Whether `BREATH` has passed since the start."""
        return time.perf_counter() - self._started >= BREATH

    def end(self) -> bool:
        """Adapt `size` after a chunk of `size` steps; return whether a check is due."""
        now = time.perf_counter()
        # growth by at most 8 splits short runs into a few chunks, and limits chunks even if the clock has stopped
        self.size = max(1, int(self.size * min(8.0, BREATH / max(now - self._started, 1e-9))))
        due = not 0 < now - self._looked < BREATH / 4  # 0: the clock has stopped
        if due:
            self._looked = now
        return due
