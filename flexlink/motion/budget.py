"""Evaluation budget of an adaptive run, the check that its steps still make progress, and the size of its chunks."""

import time
import warnings
from typing import NamedTuple

LOOKS = 100
"""Number of progress checks per budget. Slow progress in two consecutive checks, after a fiftieth of the budget,
triggers a warning."""

FEWEST = 100
"""Minimum number of steps between two checks: after a jump steps are tiny, and grow at most fivefold from one to the
next."""

SHORTEST = 1e-10
"""Mean step between two checks, relative to the duration, below which a run is considered stuck.

At this step a run would need 1e10 steps, 10,000 times the default budget.
"""


class Spent(NamedTuple):
    """Time reached, and numbers of steps and evaluations so far."""

    time: float  # time reached [s]
    steps: int
    evaluations: int


class Budget:
    """Evaluation budget of a run, or of one call of a simulator.

    `over`: why the run must stop, empty while it may go on; `slow`: why it would exceed its budget at its pace, empty
    until two consecutive checks predict this; `safe`: number of evaluations after which the next check is due.
    """

    def __init__(self, most: float, duration: float) -> None:
        self.most, self.duration = most, duration
        self.begin(Spent(0.0, 0, 0), 0.0)

    def begin(self, now: Spent, end: float, dearest: int = 0) -> None:
        """Start the budget for integration to `end` [s]; a step takes at most `dearest` evaluations."""
        self.over = self.slow = ""
        self._crawls = False
        self._start = self._last = now
        self._end = end
        self.safe = now.evaluations + min(self.most, self._apart(dearest)) if dearest else 0.0

    def affordable(self, now: Spent, dearest: int) -> int:
        """Number of steps to the next check, by evaluations, so the same on every machine; 0: the run must stop."""
        used, pause = now.evaluations - self._start.evaluations, self._apart(dearest)
        if used + dearest > self.most:
            part = (now.time - self._start.time) / (self._end - self._start.time)
            spent = f"{used:,} evaluations (max_evaluations = {self.most:g})"
            self.over = f"after {spent} only {part:.2%} of the duration is done"
        elif now.evaluations - self._last.evaluations + dearest > pause:
            self._check_progress(now)
        if self.over:
            return 0
        self.safe = min(self._start.evaluations + self.most, self._last.evaluations + pause)
        return int((self.safe - now.evaluations) / dearest)

    def _apart(self, dearest: int) -> float:
        """Number of evaluations between two checks."""
        return max(self.most / LOOKS, float(FEWEST * dearest))

    def _check_progress(self, now: Spent) -> None:
        """Check that the run has progressed since the last check."""
        past, steps, evaluations = (float(b - a) for a, b in zip(self._last, now, strict=True))
        self._last = now
        mean = past / max(steps, 1.0)
        if mean < SHORTEST * self.duration:
            short = f"{mean:.2g} s, below {SHORTEST:g} of the duration"
            self.over = f"the last {evaluations:,.0f} evaluations took steps of only {short}"
            return
        rest = (self._end - now.time) / past * evaluations
        crawled, self._crawls = self._crawls, now.evaluations - self._start.evaluations + rest > self.most
        if crawled and self._crawls and not self.slow:
            enough = f"more than max_evaluations = {self.most:g}"
            self.slow = f"with steps of {mean:.2g} s, the rest of the run takes {rest:.2g} evaluations, {enough}"


def warn(text: str) -> None:
    """Issue a warning during a run."""
    warnings.warn(text, RuntimeWarning, stacklevel=2)


# Chunk size of a run: number of compiled steps between two checks of samples, signals and terminal by Python.


BREATH = 0.1  # time between two checks of samples, signals and the terminal [s]


Reached = tuple[int, float]  # progress of a run: number of samples computed, and completed fraction of its duration


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
