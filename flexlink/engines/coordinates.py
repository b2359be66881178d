"""Map flexlink's coordinates to an engine's, which orders joints and describes a floating base differently.

flexlink describes a floating base by a position in frame 0 and three angles. Engines use a position, a quaternion, a
velocity and a spin. The engine's rates are v = T(q) q̇, where T reorders the joints and maps the base:

    M = Tᵀ M_e T        T_GC = Tᵀ (T_GC,e + M_e Ṫ q̇)        τ = Tᵀ τ_e        q̈ = T⁻¹ (v̇ − Ṫ q̇)
"""

from typing import NamedTuple

import numpy as np

from flexlink.chain.coordinates import BASE_JOINTS as JOINTS
from flexlink.chain.coordinates import BASE_NAMES
from flexlink.chain.rigid import quaternion_from_matrix, rates_matrices, rates_matrices_changing, rotations_of
from flexlink.common.products import cross, product
from flexlink.common.types import Array, Indices
from flexlink.describe.arm import BASE

BASE_JOINTS = tuple(f"{BASE}.{name}" for name in BASE_NAMES)  # flexlink's names of the joints of a floating base


class Floating(NamedTuple):
    """An engine's convention for the pose and velocity of a floating base, which precedes all other joints."""

    velocity_in_base: bool = False  # whether the velocity is in axes of the base; otherwise in axes of frame 0
    spin_in_base: bool = False  # whether the spin is in axes of the base; otherwise in axes of frame 0
    turn_first: bool = False  # whether quaternion and spin come before position and velocity
    scalar_first: bool = False  # whether the quaternion is (w, x, y, z); otherwise (x, y, z, w)


class Coordinates:
    """The map between flexlink's coordinates and the coordinates of an engine with a loaded chain or file.

    `order` is the engine's degree of freedom for each of flexlink's joints, `reference` the rotation of a floating base
    at zero angles.
    """

    def __init__(self, order: Indices, reference: Array | None = None, floating: Floating | None = None) -> None:
        self.order, self.reference, self._layout = order, reference, floating or Floating()
        self._own = 0 if reference is None else JOINTS  # number of joints of the base
        self.plain = reference is None and np.array_equal(order, np.arange(len(order)))

    def position(self, q: Array) -> Array:
        """Return the engine's coordinates."""
        if self.plain:
            return q
        base = np.zeros(0)
        if self._own:
            w, *xyz = quaternion_from_matrix(self._rotation(q))
            base = self._sorted(q[:3], np.array([w, *xyz] if self._layout.scalar_first else [*xyz, w]))
        place = np.empty(len(q) - self._own + len(base))
        place[: len(base)] = base
        place[self.order[self._own :] + len(base) - self._own] = q[self._own :]
        return place

    def rates(self, q: Array, qd: Array) -> Array:
        """Return v = T q̇."""
        v = self._theirs(qd)
        if self._own:
            v[:JOINTS] = self._turn(q) @ qd[:JOINTS]
        return v

    def torques(self, q: Array, tau: Array) -> Array:
        """Return the engine's torques, T⁻ᵀ τ."""
        found = self._theirs(tau)
        if self._own:
            found[:JOINTS] = np.linalg.solve(self._turn(q).T, tau[:JOINTS])
        return found

    def drift(self, q: Array, qd: Array) -> Array | None:
        """Return Ṫ q̇ in the engine's order; None if T is constant."""
        if not self._own:
            return None
        found, R, S = np.zeros(len(q)), self._rotation(q), rates_matrices(q[3:JOINTS])
        turn = product(rates_matrices_changing(q[3:JOINTS], qd[3:JOINTS]), qd[3:JOINTS])
        move = -cross(S @ qd[3:JOINTS], R.T @ qd[:3])
        found[:JOINTS] = self._sorted(
            move if self._layout.velocity_in_base else np.zeros(3), turn if self._layout.spin_in_base else R @ turn
        )
        return found

    def our_torques(self, q: Array, tau: Array) -> Array:
        """Return flexlink's torques, Tᵀ τ_e."""
        found = np.array(tau if self.plain else tau[self.order])
        if self._own:
            found[:JOINTS] = self._turn(q).T @ tau[:JOINTS]
        return found

    def our_matrix(self, q: Array, M: Array) -> Array:
        """Return Tᵀ M_e T, which is symmetric because M_e is."""
        found = np.array(M if self.plain else M[np.ix_(self.order, self.order)])
        if self._own:
            T = np.eye(len(M))
            T[:JOINTS, :JOINTS] = self._turn(q)[self.order[:JOINTS]]
            found = T.T @ found @ T
            found = (found + found.T) / 2
        return found

    def our_accelerations(self, q: Array, qd: Array, a: Array) -> Array:
        """Return q̈ = T⁻¹ (v̇ − Ṫ q̇)."""
        drift = self.drift(q, qd)
        found = np.array(a if self.plain else a[self.order])
        if drift is not None:
            found[:JOINTS] = np.linalg.solve(self._turn(q), (a - drift)[:JOINTS])
        return found

    def _theirs(self, values: Array) -> Array:
        """Return joint values in the engine's order."""
        if self.plain:
            return values
        found = np.empty(len(values))
        found[self.order] = values
        return found

    def _rotation(self, q: Array) -> Array:
        assert self.reference is not None
        return product(self.reference, rotations_of(q[3:JOINTS]))

    def _turn(self, q: Array) -> Array:
        """Return the block of T for a floating base, shape (6, 6)."""
        R, S, nothing = self._rotation(q), rates_matrices(q[3:JOINTS]), np.zeros((3, 3))
        move = R.T if self._layout.velocity_in_base else np.eye(3)
        spin = S if self._layout.spin_in_base else R @ S
        return self._sorted(np.hstack([move, nothing]), np.hstack([nothing, spin]))

    def _sorted(self, move: Array, turn: Array) -> Array:
        return np.concatenate([turn, move] if self._layout.turn_first else [move, turn])
