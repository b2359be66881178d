"""Deflection: how far springs, of links and of gears, move the tip away from where it is with all of them at rest."""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.placement import unbent
from flexlink.kernels.geometry.kinematics import tip_points
from flexlink.results.tip_motion import distances
from flexlink.results.trajectory import Trajectory


def deflections(run: Trajectory) -> Array:
    """How far the springs bend the tip away, at every sample of a run [m]."""
    unmoved = np.empty(run.tip.shape)
    tip_points(run.chain.arrays, np.ascontiguousarray(unbent(run.chain, run.q)), unmoved)
    return distances(run.tip, unmoved)
