"""Screening of bending axes: in runs with few hinges, axes are omitted as long as this hardly moves the tip's path."""

from __future__ import annotations

import numpy as np

from flexlink.advice.goal import TipErrorNorm
from flexlink.advice.model import FLEX, Axes, limited_axes, uniform
from flexlink.advice.model_runner import ModelRunner, Stepping
from flexlink.advice.thresholds import Thresholds


class AxisScreening:
    """Axes of each link, without axes that hardly change the tip's path.

    Attributes
    ----------
    axes
        Remaining axes of every link.
    left_out
        Change of the tip's path by omitting all these axes together, shape (samples, 3) [m].
    trials
        One line per attempt to omit axes, in order: change of the tip's path, and whether it is accepted.
    """

    def __init__(
        self, runner: ModelRunner, norm: TipErrorNorm, axes: Axes, stepping: Stepping, tolerance: float
    ) -> None:
        self.runner, self.norm, self.stepping = runner, norm, stepping
        self.allowed = Thresholds.allowed_share * tolerance
        self.axes, self.trials = axes, list[str]()
        self.tip = runner.run(uniform(axes, Thresholds.screening_hinges), stepping).tip
        self.left_out = np.zeros_like(self.tip)
        if not self._try("all: flex z only", limited_axes(axes, "z")):
            self._link_by_link()

    def _link_by_link(self) -> None:
        if self.axes.count("rigid") < len(self.axes) - 1:
            self._try("all: flex yz only", limited_axes(self.axes, "yz"))
        for k, link in enumerate(self.runner.scene.arm.links):
            while self.axes[k] in FLEX[2:]:
                flex, less = self.axes[k], FLEX[FLEX.index(self.axes[k]) - 1]
                if not self._try(f"{link.name}: flex {flex} to {less}", (*self.axes[:k], less, *self.axes[k + 1 :])):
                    break

    def _try(self, name: str, axes: Axes) -> bool:
        """Adopt these axes if they change the tip's path by no more than allowed; return whether they do."""
        if axes == self.axes:
            return True
        tip = self.runner.run(uniform(axes, Thresholds.screening_hinges), self.stepping).tip
        without = self.left_out + tip - self.tip
        kept = self.norm(without) > self.allowed
        verdict = "too much" if kept else "accepted"
        self.trials.append(f"{name}: tip changes by {self.norm(tip - self.tip):.1e} m, {verdict}")
        if not kept:
            self.axes, self.tip, self.left_out = axes, tip, without
        return not kept
