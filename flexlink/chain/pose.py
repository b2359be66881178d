"""Placements of frames in one another."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Placement of a frame in another: v_outer = R v + p."""

    R: Array
    p: Array

    def then(self, inner: Pose) -> Pose:
        """Of a frame placed by `inner` in this one."""
        return Pose(self.R @ inner.R, self.p + self.R @ inner.p)

    @property
    def inverse(self) -> Pose:
        """Of the outer frame in the inner one."""
        return Pose(self.R.T, -self.R.T @ self.p)


HERE = Pose(np.eye(3), np.zeros(3))
