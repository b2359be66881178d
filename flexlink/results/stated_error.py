"""Stated error of a run with a tolerance, and what a run hands on to the run that continues it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from flexlink.common.types import Array

Start = tuple[float, Array, Array]
"""Time [s], angles [rad] and rates [rad/s]."""


class StatedError(NamedTuple):
    """Estimated error of a run, what it may be, and what the error of a run that continues it depends on."""

    tip: Array  # (samples,) of the tip, the largest of all tips [m]
    allowed: float  # tolerance of the run [m]
    compared: bool  # whether it is the distance to another run, or estimated from the errors of the steps
    outputs: Mapping[str, Array]  # of what is read besides the tip, by name with unit, (samples,)
    start: Start  # of the motion, which may have begun in an earlier run
    travelled: float  # angle travelled by all free joints since then [rad]
    drifting: float  # sum of the estimated errors of rates that last [m/s]; the displacement by these [m]
    drifted: float
    end: Start | None = None  # where the run ended with which this one was compared
    delayed: Array | None = None  # torques on their way then, as in `RunSamples.delayed`

    def __str__(self) -> str:
        """The largest error, whether the tolerance is kept, and how the error was found."""
        error = float(self.tip.max())
        verdict = "kept" if error <= self.allowed else f"exceeded {error / self.allowed:.2g}-fold; take a smaller one"
        found = "by a second run" if self.compared else "from the errors of the steps"
        return f"tip error {error:.2g} m, {found}; tolerance {self.allowed:.2g} m, {verdict}"
