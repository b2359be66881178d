"""Where an arm is: the frames of its bodies and of its tip, of one state or of many (see `terms`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import given, vector
from flexlink.chain.chain import Chain
from flexlink.dynamics.batches import each, is_batch
from flexlink.kernels.kinematics import forward_kinematics

Array = NDArray[np.float64]


class Frames(NamedTuple):
    """Where the `chain.bodies` are, in frame 0; the last one is the tip frame."""

    rotations: Array  # (…, bodies, 3, 3), R: v_0 = R v_body
    points: Array  # (…, bodies, 3), origins [m]

    def __repr__(self) -> str:
        *states, bodies, _ = self.points.shape
        return f"<Frames: {bodies} bodies{f' in {states[0]} states' if states else ''}>"


def frames(chain: Chain, q: ArrayLike) -> Frames:
    """Rotation and origin of every body frame in frame 0.

    Parameters
    ----------
    chain
        The chain.
    q
        Angles [rad], shape (n,), or (b, n) for b states.

    Returns
    -------
    Frames
        Rotations (bodies, 3, 3) and origins (bodies, 3) [m], or with a leading b; the last one is the tip frame.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    """
    if is_batch(q):
        return each(frames, chain, {"q": q})
    arrays = given("chain", chain, Chain).arrays
    placed = forward_kinematics(arrays, vector("q", q, chain.n, many=True))
    return Frames(placed.rotations, placed.points)


def tip_position(chain: Chain, q: ArrayLike) -> Array:
    """Origin of the tip frame in frame 0.

    Parameters
    ----------
    chain
        The chain.
    q
        Angles [rad], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        The point, shape (3,), or (b, 3) [m].

    Raises
    ------
    ArgumentError
        As in `frames`.
    """
    tip: Array = frames(chain, q).points[..., -1, :]
    return tip
