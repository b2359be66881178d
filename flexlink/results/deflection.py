"""Deflection: displacement of the tip due to the springs of links and gears, relative to unloaded springs."""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.placement import unbent
from flexlink.kernels.geometry.kinematics import tip_points
from flexlink.results.tip_motion import distances
from flexlink.results.trajectory import Trajectory


def deflections(run: Trajectory) -> Array:
    """Deflection of the tip due to the springs, at every sample of a run [m]."""
    unmoved = np.empty(run.tip.shape)
    tip_points(run.chain.arrays, np.ascontiguousarray(unbent(run.chain, run.q)), unmoved)
    return distances(run.tip, unmoved)
