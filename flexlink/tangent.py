"""Slopes of the torques about a state: what modal analysis and Newton's method for statics need.

No step size: along one angle every torque of a chain is a trigonometric polynomial of degree 2 at most, for which
M. Riesz's interpolation formula is exact, and along the rates it is a quadratic, for which the central difference is.

    f'(q) = Σ_k (−1)^(k+1) / (4 d sin²(x_k/2)) f(q + x_k),   x_k = (2k − 1) π / 2d,   k = 1 … 2d,   d = 2

Degree 2: q_j turns all bodies beyond hinge j, so that M(q) = Σ JᵀmJ + Jᵀ R I Rᵀ J contains cos q_j and sin q_j at most
twice; its derivatives (T_GC) do not raise the degree; T_G and Jᵀ w are of degree 1, with a follower wrench of degree 2.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexlink.chain import Chain
from flexlink.dynamics import bias_torque, frames
from flexlink.errors import ArgumentError

Array = NDArray[np.float64]

_SHIFTS = np.pi * np.array([1, 3, 5, 7]) / 4
_WEIGHTS = np.array([1, -1, 1, -1]) / (8 * np.sin(_SHIFTS / 2) ** 2)


def unlocked(chain: Chain, locked: Sequence[int]) -> NDArray[np.intp]:
    """Sequential indices of the coordinates that may move: neither locked nor moving as prescribed.

    Raises
    ------
    ArgumentError
        `locked` holds something that is no coordinate, or leaves nothing to move.
    """
    wrong = [k for k in locked if k not in range(chain.n)]
    if wrong:
        raise ArgumentError(f"locked = {list(locked)}: {wrong[0]!r} is no coordinate; allowed are 0 … {chain.n - 1}")
    free = np.setdiff1d(np.flatnonzero(chain.hinges["prescribed"] == 0), np.array(locked, dtype=np.intp))
    if not len(free):
        raise ArgumentError(f"locked = {list(locked)}: nothing is left to move; prescribed joints do not, either")
    return free


def load_torque(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool = False) -> Array:
    """T_GC with a dead or a follower wrench, shape (n,) [N m]; T_EX − T_FL in (relative) equilibrium.

    `wrench` (6,) [N, N m] acts on the tip in axes of frame 0 and keeps its direction there; with `follower` its
    components are in axes of the tip frame and it turns with the tip.
    """
    if follower:
        R = frames(chain, q).rotations[-1]
        wrench = np.concatenate([R @ wrench[:3], R @ wrench[3:]])
    return bias_torque(chain, q, qd, wrench)


def stiffness_matrix(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool = False) -> Array:
    """K = ∂(T_GC + T_FL)/∂q at constant rates, shape (n, n) [N m/rad], exact up to rounding.

    Elastic + gravity + load + centrifugal stiffness; not symmetric under a follower wrench or a spatial moment.
    """
    K = np.diag(chain.stiffness)
    for j in range(chain.n):
        for shift, weight in zip(_SHIFTS, _WEIGHTS, strict=True):
            moved = q.copy()
            moved[j] += shift
            K[:, j] += weight * load_torque(chain, moved, qd, wrench, follower)
    return K


def gyroscopic_matrix(chain: Chain, q: Array, qd: Array) -> Array:
    """G = ∂T_GC/∂q̇, shape (n, n) [N m s/rad]; zero at rest, since T_GC is quadratic in the rates."""
    G = np.zeros((chain.n, chain.n))
    if qd.any():
        unit = np.abs(qd).max()  # same size as the rates: no cancellation
        for j, e in enumerate(unit * np.eye(chain.n)):
            G[:, j] = (bias_torque(chain, q, qd + e) - bias_torque(chain, q, qd - e)) / (2 * unit)
    return G


def point_jacobian(chain: Chain, q: Array) -> Array:
    """∂p/∂q of the body origins and the tip, frame 0, shape (bodies, n, 3) [m/rad]; Riesz's formula for degree 1."""
    J = np.empty((len(chain.bodies), chain.n, 3))
    for j, quarter in enumerate(np.pi / 2 * np.eye(chain.n)):
        J[:, j] = (frames(chain, q + quarter).points - frames(chain, q - quarter).points) / 2
    return J
