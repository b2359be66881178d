"""The search: single numbers first, then runs in growing windows; weights from the residuals; several starts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import qmc

from flexlink.common.types import Array
from flexlink.identification.block import Block
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.signals import Signals

ROUNDS = 2
"""How often noise that is not stated is estimated anew from the residuals."""


class Found(NamedTuple):
    """Where a search ended.

    Attributes
    ----------
    x
        The point.
    cost
        Half the sum of squares, with the noise of the first search.
    blocks
        Of every source, with the noise that was taken at last.
    """

    x: Array
    cost: float
    blocks: list[list[Block]]


class Search(Likelihood):
    """The search for the largest likelihood."""

    def from_start(self, x: Array) -> Found:
        """Search from a point.

        Raises
        ------
        FlexlinkError
            The scene does not run at the initial guess.
        """
        windows = 0.0, 0.15, 0.4  # parts of each run, one after the other: a long one alone has minima a period apart
        self.signals.model(x)
        sources = self.signals.sources
        blocks = [list(source.blocks) for source in sources]
        single = [source for source in sources if not source.is_run]
        runs = len(single) < len(sources)
        for part in windows if runs else ():
            cut = [source.first(part) for source in sources if source.is_run] if part else []
            if part or single:
                x = Search(Signals([*cut, *single], self.coordinates), self.loss).near(x)
        last = not (self.coloured or self._weighs(blocks)) or not runs
        x = self.least(x, blocks, rough=not last)
        cost = self.cost(x, blocks)
        if not runs:
            return Found(x, cost, blocks)
        for _ in range(ROUNDS - self.coloured if self._weighs(blocks) else 0):
            blocks = self.weighed(x, blocks)
            x = self.least(x, blocks)
        blocks = self.weighed(x, blocks)
        return self._coloured(Found(x, cost, blocks)) if self.coloured else Found(x, cost, blocks)

    def near(self, x: Array) -> Array:
        """Where a rough search leads."""
        return self.least(x, [list(source.blocks) for source in self.signals.sources], rough=True)

    def _coloured(self, white: Found) -> Found:
        """The search with autocorrelated noise.

        Where it leaves clearly more than with white noise, the rest is no noise, but something that the scene does not
        have: then what leaves least stays.
        """
        more = 1.1  # times the sum of squares that autocorrelated noise may leave
        x, blocks = white.x, white.blocks
        for _ in range(ROUNDS):
            blocks = self.weighed(x, blocks, coloured=True)
            x = self.least(x, blocks)
        if self.cost(x, white.blocks) > more * self.cost(white.x, white.blocks):
            return white
        return Found(x, white.cost, self.weighed(x, blocks, coloured=True))

    @staticmethod
    def _weighs(blocks: Sequence[Sequence[Block]]) -> bool:
        """Whether there is noise that is not stated, and that weighs."""
        several = [block for part in blocks for block in part]
        return len(several) > 1 and not all(block.stated for block in several)


def start_points(coordinates: Sequence[Coordinate], count: int) -> list[Array]:
    """The problem's own start, then points that fill the bounds, or a factor of 2 to either side, evenly."""
    own = np.array([one.x(one.start) for one in coordinates])
    low, high = np.array([_around(one) for one in coordinates]).T
    points = qmc.LatinHypercube(len(own), seed=0).random(count - 1) if count > 1 else np.empty((0, len(own)))
    return [own, *(low + (high - low) * points)]


def _around(one: Coordinate) -> tuple[float, float]:
    far, x = np.log(2.0) if one.log else 1.0, one.x(one.start)
    low, high = one.bounds
    if one.prior is not None:
        x, far = one.x(one.prior[0]), min(far, 2 * one.prior[1] / one.size(one.prior[0]))
    return max(low, x - far), min(high, x + far)
