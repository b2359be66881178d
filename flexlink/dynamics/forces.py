"""Torques at a state: of springs and dampers with their slopes, of force elements, and of the tip wrench."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import beyond_float64, require_one_of, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain, merged
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.batches import is_batch, rows, wrench_rows
from flexlink.kernels.forces.couplings import give_way
from flexlink.kernels.forces.elements import POTENTIALS, motion_slopes, motion_torques
from flexlink.kernels.forces.rotation_springs import excess_torque, rotation_vectors
from flexlink.kernels.forces.rotation_tangent import excess_stiffness
from flexlink.kernels.geometry.kinematics import turned_with_tip
from flexlink.kernels.layout import COUPLING
from flexlink.kernels.tools.finite import is_finite


def drag_torque(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """T_DRAG = −Σ Jᵀ f: joint torques, in addition to T_FR, that overcome the drag of links, `link.drag`.

    f = −½ ρ c_d b Δx |v| v at points along each link, where v is their velocity across it (`Drag`). q̇·T_DRAG ≥ 0 is
    the dissipated power [W]. The integral uses two Gauss points per segment and at least eight per link. The result is
    exact in a plane if v keeps its sign within a segment and the breadth is constant.

    Parameters
    ----------
    chain, q, qd
        The chain; angles [rad] and rates [rad/s], shape (n,), or (b, n) for b states.

    Returns
    -------
    Array
        T_DRAG, shape (n,), or (b, n) [N m]; zero at rest and for a chain without drag.

    Raises
    ------
    ArgumentError
        `q` or `qd` has the wrong shape, is not real or not finite, or a torque is beyond float64.

    Examples
    --------
    >>> in_air = fl.lump(scene.varied({"link.*.drag": fl.Drag(coefficient=1.2)}))
    >>> rates = np.ones(chain.n)  # rad/s
    >>> print(f"{rates @ fl.drag_torque(in_air, q, rates):.2f} W")
    1.09 W
    """
    return all_torques(_with(require_type("chain", chain, Chain), chain.forces.keys() & {"drag"}), q, qd)


def force_torque(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Torque T of the force elements in `chain.forces` without a potential; errors and shape as in `drag_torque`."""
    return all_torques(_with(chain, chain.forces.keys() - POTENTIALS), q, qd)


def all_torques(chain: Chain, q: ArrayLike, qd: ArrayLike) -> Array:
    """Torque T of all force elements in `chain.forces`; errors and shape as in `drag_torque`."""
    n, many = require_type("chain", chain, Chain).n, is_batch(q, qd)
    qs, qds = rows(n, {"q": q, "qd": qd}) if many else (vector(k, x, n)[None] for k, x in (("q", q), ("qd", qd)))
    found = np.zeros((len(qs), n))
    if chain.forces:
        motion_torques(chain.arrays, qs, qds, found)
        if not is_finite(found.reshape(-1)):
            raise beyond_float64(f"{', '.join(chain.forces)} of {chain.name!r}", q=qs, qd=qds)
    return found if many else found[0]


def force_slopes(chain: Chain, q: Array, qd: Array) -> tuple[Array, Array]:
    """∂T/∂q [N m/rad] and ∂T/∂q̇ [N m s/rad] of `force_torque` at one state, (n, n) each, exact up to rounding."""
    return _slopes(_with(chain, chain.forces.keys() - POTENTIALS), q, qd)


def _slopes(chain: Chain, q: Array, qd: Array) -> tuple[Array, Array]:
    by_angle, by_rate = np.zeros((2, chain.n, chain.n))
    if chain.forces:
        motion_slopes(chain.arrays, q, qd, by_angle, by_rate)
    return by_angle, by_rate


def has_potential(chain: Chain) -> bool:
    """Whether some force element of the chain has a potential."""
    return not POTENTIALS.isdisjoint(chain.forces)


def with_potential(chain: Chain) -> Chain:
    """Return the chain with only the force elements that have a potential."""
    return _with(chain, chain.forces.keys() & POTENTIALS)


def of_joint_rates(chain: Chain) -> Chain:
    """Return the chain with only the force elements that act on joint rates and so belong to T_FR."""
    return _with(chain, {name for name, rows in chain.forces.items() if "body" not in (rows.dtype.names or ())})


def _with(chain: Chain, names: set[str]) -> Chain:
    """Return the chain with only the force elements of these names; the same chain if it has no others."""
    if len(names) == len(chain.forces):
        return chain
    return dataclasses.replace(chain, forces={name: rows for name, rows in chain.forces.items() if name in names})


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
    rows, columns = triples[blocks[:, 0], :, None], triples[blocks[:, 1], None, :]
    return _stiffened(straight, rows + 0 * columns, columns + 0 * rows, values)  # 0 × the other: broadcast


def linearised(chain: Chain, q: Array) -> Chain:
    """Return the chain with linear springs, of the slopes at q (n,), for force elements that have a potential."""
    if not has_potential(chain):
        return chain
    joined = np.eye(chain.n, dtype=bool)
    elastic = with_potential(chain)
    for elements in elastic.forces.values():
        if "outer" in (elements.dtype.names or ()):
            joined[elements["inner"], elements["outer"]] = True
    i, j = np.nonzero(joined)
    return _stiffened(chain, i, j, _slopes(elastic, q, np.zeros(chain.n))[0][i, j])


def _stiffened(chain: Chain, i: NDArray[np.intp], j: NDArray[np.intp], values: Array) -> Chain:
    """Return the chain without force elements, with `values` added to K_ij; pairs with i > j are ignored."""
    bodies, hinges, diagonal, above = chain.bodies.copy(), chain.hinges.copy(), i == j, i < j
    bodies["springs"] = 0
    hinges["stiffness"][i[diagonal]] += values[diagonal]
    couplings = np.zeros(np.count_nonzero(above), COUPLING)
    couplings["inner"], couplings["outer"], couplings["stiffness"] = i[above], j[above], values[above]
    joined = merged(np.concatenate([chain.couplings, couplings]))
    return Chain(chain.name, bodies, hinges, chain.gravity, chain.coordinates, chain.link_names, joined)


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
    """Whether a wrench in axes of `frame` turns with the tip; refuses other frames than "world" and "tip"."""
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
