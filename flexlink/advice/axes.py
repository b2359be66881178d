"""Which axes each link needs, on a coarse chain: one is left out while all that are do next to nothing to the tip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.goal import Ruler
from flexlink.advice.model import FLEX, Axes, capped, uniform
from flexlink.advice.model_runner import ModelRunner, Stepping

Array = NDArray[np.float64]

COARSE = 2
"""Hinges of each link. Loads alone do not tell: an axis that they bent by 3e-4 of the motion changed it by 6e-3."""

SHARE = 0.1
"""Of the tolerance, which all axes left out may do together."""


class Trial(NamedTuple):
    """An axis that was left out, for once or for good."""

    words: str
    effect: float  # on the tip [m]
    kept: bool

    def __str__(self) -> str:
        return f"{self.words}: {self.effect:.1e} m {'kept' if self.kept else 'left out'}"


class Screening:
    """Axes of each link after those that do nothing are left out.

    Attributes
    ----------
    axes
        Of every link.
    gone
        What all that are left out do to the tip together, shape (samples, 3) [m].
    trials
        What was tried, in order.
    """

    def __init__(self, bench: ModelRunner, ruler: Ruler, axes: Axes, stepping: Stepping, tolerance: float) -> None:
        self.bench, self.ruler, self.stepping, self.allowed = bench, ruler, stepping, SHARE * tolerance
        self.axes, self.trials = axes, list[Trial]()
        self.tip = bench.run(uniform(axes, COARSE), stepping).tip
        self.gone = np.zeros_like(self.tip)
        if not self._try("all: to z", capped(axes, "z")):
            self._link_by_link()

    def _link_by_link(self) -> None:
        if self.axes.count("rigid") < len(self.axes) - 1:
            self._try("all: to yz", capped(self.axes, "yz"))
        for k, link in enumerate(self.bench.scene.arm.links):
            while self.axes[k] in FLEX[2:]:
                flex, less = self.axes[k], FLEX[FLEX.index(self.axes[k]) - 1]
                if not self._try(f"{link.name}: {flex} to {less}", (*self.axes[:k], less, *self.axes[k + 1 :])):
                    break

    def _try(self, words: str, axes: Axes) -> bool:
        """Leave out what a choice of axes does not have, if that is allowed."""
        if axes == self.axes:
            return True
        tip = self.bench.run(uniform(axes, COARSE), self.stepping).tip
        without = self.gone + tip - self.tip
        kept = self.ruler(without) > self.allowed
        self.trials.append(Trial(words, self.ruler(tip - self.tip), kept))
        if not kept:
            self.axes, self.tip, self.gone = axes, tip, without
        return not kept
