"""What acts on an arm besides gravity: the tip wrench in axes of frame 0, and the gains of a drive."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_one_of, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.batches import wrench_rows
from flexlink.kernels.geometry.kinematics import turned_with_tip


class Gains(NamedTuple):
    """Gains of a drive, T_EX = … − k_p q − k_d q̇, each (n,), or (n, n) if not diagonal [N m/rad, N m s/rad]."""

    kp: Array
    kd: Array

    def matrices(self) -> tuple[Array, Array]:
        """Both gains as matrices (n, n)."""
        kp, kd = (np.diag(slope) if slope.ndim == 1 else slope for slope in self)
        return kp, kd

    def diagonals(self) -> tuple[Array, Array]:
        """Both gains as vectors (n,), the diagonals."""
        kp, kd = (slope if slope.ndim == 1 else np.diag(slope).copy() for slope in self)
        return kp, kd


def turns_with_tip(frame: Frame) -> bool:
    """Whether a wrench in axes of `frame` turns with the tip.

    Raises
    ------
    ArgumentError
        `frame` is neither "world" nor "tip".
    """
    return require_one_of("frame", frame, {"world": False, "tip": True})


def world_wrench(chain: Chain, q: Array, tip_wrench: ArrayLike | None, frame: Frame) -> Array:
    """Tip wrench in axes of frame 0, (6,), at angles q (n,); errors as in `turns_with_tip` and `wrench_vector`."""
    wrench = wrench_vector(tip_wrench)
    if frame == "world" or not turns_with_tip(frame):  # the first test is fast
        return wrench
    turned: Array = turned_with_tip(chain.arrays, wrench, q)
    return turned


def world_wrenches(chains: Sequence[Chain], q: Array, tip_wrench: ArrayLike | None, frame: Frame) -> Array:
    """Tip wrenches in axes of frame 0, (b, 6), at b states of one chain or of b chains; see `wrench_rows`."""
    wrenches = wrench_rows(tip_wrench, len(q))
    if frame == "world" or not turns_with_tip(frame):
        return wrenches
    given = zip(itertools.cycle(chains), q, wrenches, strict=False)
    return np.array([world_wrench(chain, angles, wrench, frame) for chain, angles, wrench in given]).reshape(-1, 6)
