"""Static feed-forward: the torque that holds the arm, with its hinges bent by gravity, along a reference."""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.memo import Memo
from flexlink.common.types import Array, Indices
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.dynamics.equilibrium import static_postures
from flexlink.kernels.derivatives.static_continuation import gravity_torques
from flexlink.kernels.inputs.record import PiecewisePolynomial

TURN = np.radians(8.0)
"""Largest rotation of a joint within one polynomial of degree 5 [rad]; the torque error is then below 1e-6 of the
largest torque."""
NODES = np.linspace(0.0, 1.0, 6)
TO_POWERS = np.linalg.inv(np.vander(NODES, increasing=True))


def holding_torque(chain: Chain, target: PiecewisePolynomial) -> PiecewisePolynomial:
    """Torque of the driven joints that keeps the arm in equilibrium along its reference, as polynomials in time [N m].

    Each polynomial passes through six equilibria (`static_postures`); large rotations need more pieces.

    Raises
    ------
    ConvergenceError
        The arm has no equilibrium somewhere along the reference.
    """
    kept = TORQUES.calling(_holding_torque, chain, target)
    return PiecewisePolynomial(*(part.copy() for part in kept))


TORQUES = Memo(16)
"""Cache of holding torques by chain and reference, as each requires hundreds of equilibria."""


def _holding_torque(chain: Chain, target: PiecewisePolynomial) -> PiecewisePolynomial:
    course = ReferenceTrajectory(*target)
    knots = _divided(*target)
    c, h = course.restated(knots), np.diff(knots, append=knots[-1] + 1.0)  # the last piece is constant
    x = NODES * h[:, None]
    angles = np.einsum("kjd,knj->knd", c, x[:, :, None] ** np.arange(c.shape[1]))
    moving = np.asarray(c[:, 1:].any(axis=(1, 2)))
    needed = np.arange(len(NODES)) < np.where(moving, len(NODES), 1)[:, None]  # a constant piece needs one node
    nodes, which = _different(angles[needed])
    postures = nodes if len(chain.active) == chain.n else static_postures(chain, nodes)
    holding = np.empty_like(postures)
    gravity_torques(chain.arrays, postures, holding)
    torques = np.zeros_like(angles)
    torques[needed] = holding[which][:, chain.active]
    torques[~moving] = torques[~moving, :1]
    powers = np.einsum("jn,knd->kjd", TO_POWERS, torques) / h[:, None, None] ** np.arange(len(NODES))[:, None]
    powers[~moving, 1:] = 0.0
    return PiecewisePolynomial(knots, powers)


def _different(nodes: Array) -> tuple[Array, Indices]:
    """Nodes (rows, d) without consecutive repetitions, and for each original node its index among them."""
    new = np.append(True, (np.diff(nodes, axis=0) != 0).any(axis=1))
    return np.ascontiguousarray(nodes[new]), np.cumsum(new) - 1


def _divided(knots: Array, c: Array) -> Array:
    """Start times after dividing pieces so that no joint turns by more than `TURN`; the last one is constant."""
    h = np.diff(knots)
    farthest = (np.abs(c[:-1, 1:]) * h[:, None, None] ** np.arange(1, c.shape[1])[:, None]).sum(axis=1)
    parts = np.maximum(1, np.ceil(farthest.max(axis=1, initial=0.0) / TURN).astype(np.int64)).tolist()
    pieces = zip(knots[:-1].tolist(), knots[1:].tolist(), parts, strict=True)
    begins = [np.linspace(start, end, n, endpoint=False) if n > 1 else [start] for start, end, n in pieces]
    return np.concatenate([*begins, knots[-1:]])
