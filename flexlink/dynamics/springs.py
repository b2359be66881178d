"""T_FL of a chain, its tangent stiffness, and matrices of springs and dampers with couplings and their inverse."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.forces import all_torques, has_potential, potential_slopes, with_potential
from flexlink.kernels.forces.couplings import give_way
from flexlink.kernels.forces.rotation_springs import excess_torque, rotation_vectors
from flexlink.kernels.forces.rotation_tangent import excess_stiffness
from flexlink.kernels.layout import COUPLING


def spring_torque(chain: Chain, q: Array) -> Array:
    """Return T_FL at angles q (n,), shape (n,) [N m]."""
    torque = chain.times("stiffness", q - chain.rest)
    if chain.has_rotation_springs:
        torque += excess_torque(chain.bodies, chain.hinges, chain.couplings, q)
    if has_potential(chain):
        torque += all_torques(with_potential(chain), q, np.zeros(chain.n))
    return torque


def held_angles(chain: Chain, q: Array) -> Array:
    """Variables on which springs act, at angles q (n,) or (b, n): angles, or rotation vectors of hinge triples."""
    if not chain.has_rotation_springs:
        return q
    held = [rotation_vectors(chain.bodies, chain.hinges, chain.couplings, row) for row in np.atleast_2d(q)]
    return np.reshape(held, q.shape)


def about(chain: Chain, q: Array) -> Chain:
    """Return the chain with ∂T_FL/∂q at angles q (n,) as its K; the same chain if all its springs are linear.

    The derivatives of springs of rotation vectors couple all hinges of a triple, and the triples of a cell.
    """
    straight = linearised(chain, q)
    if not chain.has_rotation_springs:
        return straight
    blocks, triples, values = excess_stiffness(chain.bodies, chain.hinges, chain.couplings, q)
    rows, columns = (triples[blocks[:, side]] for side in (0, 1))
    i, j = np.broadcast_to(rows[:, :, None], values.shape), np.broadcast_to(columns[:, None, :], values.shape)
    return _stiffened(straight, i, j, values)


def linearised(chain: Chain, q: Array) -> Chain:
    """Return the chain with linear springs, of the slopes at q (n,), for force elements that have a potential."""
    if not has_potential(chain):
        return chain
    joined = np.eye(chain.n, dtype=bool)
    for rows in with_potential(chain).forces.values():
        if "outer" in (rows.dtype.names or ()):
            joined[rows["inner"], rows["outer"]] = True
    i, j = np.nonzero(joined)
    return _stiffened(chain, i, j, potential_slopes(chain, q)[i, j])


def _stiffened(chain: Chain, i: NDArray[np.intp], j: NDArray[np.intp], values: Array) -> Chain:
    """Return the chain without force elements, with `values` added to K_ij; pairs with i > j are ignored."""
    bodies, hinges = chain.bodies.copy(), chain.hinges.copy()
    bodies["springs"] = 0
    hinges["stiffness"][i[i == j]] += values[i == j]
    couplings = np.zeros(int((i < j).sum()), COUPLING)
    couplings["inner"], couplings["outer"], couplings["stiffness"] = i[i < j], j[i < j], values[i < j]
    joined = _joined(np.concatenate([chain.couplings, couplings]))
    return Chain(chain.name, bodies, hinges, chain.gravity, chain.coordinates, chain.link_names, joined)


def _joined(couplings: NDArray[np.void]) -> NDArray[np.void]:
    """Merge couplings, so that each pair of hinges occurs once."""
    pairs, pair_index = np.unique(couplings[["inner", "outer"]], return_inverse=True)
    joined = np.zeros(len(pairs), COUPLING)
    joined["inner"], joined["outer"] = pairs["inner"], pairs["outer"]
    for field in ("stiffness", "damping"):
        np.add.at(joined[field], pair_index, couplings[field])
    return joined


def damping_slope(chain: Chain) -> Array:
    """Derivative of each joint's T_FR with respect to its own rate, at rest: d + coulomb / coulomb_width, (n,)."""
    return np.asarray(chain.damping + _dry(chain))


def damping_matrix(chain: Chain) -> Array:
    """∂T_FR/∂q̇ at rest, D + diag(coulomb / coulomb_width), shape (n, n)."""
    return np.asarray(chain.matrix("damping") + np.diag(_dry(chain)))


def damping_along(chain: Chain, φ: Array) -> Array:
    """`damping_matrix` times rates φ (n,), in O(n)."""
    if not len(chain.couplings):
        return damping_slope(chain) * φ
    return np.asarray(chain.times("damping", φ) + _dry(chain) * φ)


def _dry(chain: Chain) -> Array:
    return np.asarray(chain.hinges["coulomb"] / chain.hinges["coulomb_width"])


def deflections(chain: Chain, torques: Array) -> Array:
    """Deflections K⁻¹ τ [rad] of springs under torques τ (n,) or (rows, n); 0 for joints without a spring."""
    sprung = np.flatnonzero(chain.stiffness > 0)
    angles = np.zeros_like(torques)
    if not len(chain.couplings):
        angles[..., sprung] = torques[..., sprung] / chain.stiffness[sprung]
        return angles
    held = np.ascontiguousarray(np.atleast_2d(torques)[:, sprung])
    give_way(chain.arrays, sprung, held)
    angles[..., sprung] = held.reshape(*torques.shape[:-1], len(sprung))
    return angles
