"""Deflection: how far springs, of links and of gears, move the tip away from where it is with all of them at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.dynamics.placement import tip_position
from flexlink.results.trajectory import Trajectory

Array = NDArray[np.float64]


def unbent(chain: Chain, q: Array) -> Array:
    """The same angles of joints without springs, with every spring at its angle at rest; shape as of `q`."""
    return np.where(chain.stiffness > 0, chain.rest, q)


def deflections(run: Trajectory) -> Array:
    """How far the springs bend the tip away, at every sample of a run [m]."""
    return np.asarray(np.linalg.norm(run.tip - tip_position(run.chain, unbent(run.chain, run.q)), axis=1))
