"""What accuracy is asked for, and how far apart two runs are by it."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.arguments import positive, real
from flexlink.common.errors import ArgumentError
from flexlink.describe.conditions import RunSettings
from flexlink.describe.spec import short
from flexlink.dynamics import rounding
from flexlink.results.tip_motion import largest_so_far

Array = NDArray[np.float64]

OF_STEPS = 0.02
"""Part of what is allowed that the steps of a run keep that others are measured by."""

METRES = {"m": 1.0, "mm": 1e-3, "µm": 1e-6, "um": 1e-6}
LENGTH = re.compile(r"\s*([0-9.eE+-]+)\s*(m|mm|µm|um)\s*")


class Goal(NamedTuple):
    """Largest error of the tip, at any sample.

    A part of how far the tip gets from its start or, with `deflection`, of how far the springs bend it away; with
    `metres` a length. Vibrations beyond `band` [Hz] do not count.
    """

    size: float
    metres: bool = False
    deflection: bool = False
    band: float = np.inf

    def tolerance(self, motion: float, deflection: float) -> float:
        """The error that is allowed [m] where the tip moves, and the links bend it, so far [m]."""
        return self.size if self.metres else self.size * (deflection if self.deflection else motion)

    def __str__(self) -> str:
        return f"{self.size * 1e3:.3g} mm" if self.metres else f"{self.size:.0e}"


def goal_of(tip: float | str, *, deflection: bool, band: float | None, run: RunSettings) -> Goal:
    """The goal that arguments of `advise` say.

    Raises
    ------
    ArgumentError
        `tip` is neither a part between 0 and 1 nor a length with its unit, a length has `deflection`, too, or the
        samples are too far apart for `band`.
    """
    wanted = "a part of the motion, as 1e-3, or a length with its unit, as '2 mm'"
    if isinstance(tip, str) and (match := LENGTH.fullmatch(tip)):
        size, metres = real("tip", match[1], wanted) * METRES[match[2]], True
    else:
        size, metres = real("tip", tip, wanted), False
    if not 0 < size < (np.inf if metres else 1.0):
        raise ArgumentError(f"tip = {short(tip)}: expected a part of the motion between 0 and 1, or a length as '2 mm'")
    if metres and deflection:
        raise ArgumentError(f"deflection = True: tip = {short(tip)} is a length; give a part of the deflection")
    if band is not None:
        band, highest = positive("band", band), 0.5 / run.sample
        if band > highest:
            raise ArgumentError(f"band = {band!r}: samples {run.sample:g} s apart tell at most {highest:g} Hz")
    return Goal(size, metres, deflection, np.inf if band is None else band)


class Ruler:
    """Measures differences of tips that are sampled alike, shape (samples, 3) [m]."""

    def __init__(self, goal: Goal, sample: float) -> None:
        self.window = _window(goal.band, sample)

    def slow(self, difference: Array) -> Array:
        """What is left of a difference within the band."""
        if self.window is None:
            return difference
        weight = self._windowed(np.ones(len(difference)))
        return np.column_stack([self._windowed(column) / weight for column in difference.T])

    def _windowed(self, column: Array) -> Array:
        """As np.convolve's "same", which is as long as the window where that is longer than a run."""
        assert self.window is not None
        before = len(self.window) // 2
        return np.convolve(column, self.window)[before : before + len(column)]

    def along(self, difference: Array) -> Array:
        """Length at every sample [m]."""
        return np.asarray(np.linalg.norm(self.slow(difference), axis=1))

    def up_to(self, difference: Array) -> Array:
        """Largest length up to every sample (samples,) [m]; inf from where the difference is not finite."""
        return largest_so_far(self.along(difference))

    def __call__(self, difference: Array) -> float:
        """Largest length [m]; inf if the difference is not finite."""
        return float(self.along(difference).max()) if np.isfinite(difference).all() else np.inf


def _window(band: float, sample: float) -> Array | None:
    """Hann's window of length 2/band, whose gain is zero from the band on but for side lobes of 3 %."""
    half = round(1.0 / (band * sample)) if np.isfinite(band) else 0
    return np.hanning(2 * half + 1)[1:-1] if half > 1 else None


def least_tolerance(reach: float) -> float:
    """Of the steps of an arm of this reach [m], a thousand roundings of the tip's place: below, they gain nothing."""
    return 1e3 * rounding.of_reach(reach)
