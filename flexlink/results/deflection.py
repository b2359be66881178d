"""Deflection: how far springs, of links and of gears, move the tip away from where it is with all of them at rest."""

from __future__ import annotations

import numpy as np

from flexlink.common.types import Array
from flexlink.dynamics.placement import tip_position, unbent
from flexlink.results.trajectory import Trajectory


def deflections(run: Trajectory) -> Array:
    """How far the springs bend the tip away, at every sample of a run [m]."""
    return np.asarray(np.linalg.norm(run.tip - tip_position(run.chain, unbent(run.chain, run.q)), axis=1))
