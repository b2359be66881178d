"""Evaluation budget of an adaptive run, and whether its steps still make progress."""

from __future__ import annotations

import warnings
from typing import NamedTuple

LOOKS = 100
"""How often in its budget a run looks whether it gets on: two looks, a fiftieth of it, and where it hangs is told."""

FEWEST = 100
"""Steps from one look to the next, at least: after a jump a few are tiny, each up to five times the last."""

SHORTEST = 1e-10
"""Mean step from one look to the next, as a part of the duration, below which a run hangs: 1e10 steps for all of it,
10,000 times what the default budget pays, and no more than a hundred times the rounding of the time itself."""


class Spent(NamedTuple):
    """Evaluations spent, and time reached."""

    time: float  # [s]
    steps: int
    evaluations: int


class Budget:
    """Of a run, or of one call of a simulator.

    Attributes
    ----------
    over
        Why it may not go on; empty as long as it may.
    slow
        Why it will not end within the budget, if it goes on as it goes; empty until two looks have found that.
    safe
        Evaluations up to which there is nothing to look at.
    """

    def __init__(self, most: float, duration: float) -> None:
        self.most, self.duration = most, duration
        self.begin(Spent(0.0, 0, 0), 0.0)

    def begin(self, now: Spent, end: float, dearest: int = 0) -> None:
        """Allow all of it from here to a time [s]; there may be nothing to look at for a while of steps so dear."""
        self.over = self.slow = ""
        self._crawls = False
        self._start = self._last = now
        self._end = end
        self.safe = now.evaluations + min(self.most, self._apart(dearest)) if dearest else 0.0

    def affordable(self, now: Spent, dearest: int) -> int:
        """Number of steps up to the next look, each as dear as one may be; 0: no more.

        By evaluations, not by time, so that a run stops at the same step on every machine.
        """
        used, pause = now.evaluations - self._start.evaluations, self._apart(dearest)
        if used + dearest > self.most:
            part = (now.time - self._start.time) / (self._end - self._start.time)
            self.over = (
                f"after {used:,} evaluations, of max_evaluations = {self.most:g}, {part:.2%} of the time is done"
            )
        elif now.evaluations - self._last.evaluations + dearest > pause:
            self._look(now)
        if self.over:
            return 0
        self.safe = min(self._start.evaluations + self.most, self._last.evaluations + pause)
        return int((self.safe - now.evaluations) / dearest)

    def _apart(self, dearest: int) -> float:
        """Evaluations from one look to the next."""
        return max(self.most / LOOKS, float(FEWEST * dearest))

    def _look(self, now: Spent) -> None:
        """Whether it gets on since the last look."""
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
            self.slow = f"steps of {mean:.2g} s, with which the rest would take {rest:.2g} evaluations, {enough}"


def warn(text: str) -> None:
    """Tell what cannot wait for the end of a run."""
    warnings.warn(text, RuntimeWarning, stacklevel=2)
