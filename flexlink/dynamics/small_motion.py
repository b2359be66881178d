"""Small motion x exp(λt) of a chain about a state, (λ² M + λ C + K) x = r: products and solutions in O(n)."""

from typing import Any

import numpy as np

from flexlink.chain.chain import Chain, add_products
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Indices
from flexlink.dynamics import rounding
from flexlink.dynamics.forces import about, damping_slope
from flexlink.kernels.derivatives.small_motion import HINGE, mass_products, multiply, set_state, small_motion
from flexlink.kernels.derivatives.small_motion_factors import cells_workspace, factor, solve
from flexlink.kernels.forces.elements import POTENTIALS

K_ALONE, C_ALONE, M_ALONE = np.eye(3)  # weights that select one matrix in the weighted sum of K, C and M

SMALLEST = 1e-8
"""Smallest pivot, relative to the terms of its row, that is eliminated; it leaves half of all digits correct."""


class SmallMotion:
    """K = ∂(T_GC + T_FL)/∂q, C = ∂(T_GC + T_FR)/∂q̇ and M at constant rates; joints may be locked."""

    def __init__(self, chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool, free: Indices) -> None:
        if qd.any() and (others := ", ".join(name for name in chain.forces if name not in POTENTIALS)):
            why = "equilibria at given rates, and steady motions of more than 100 joints, do not support"
            raise ArgumentError(f"{chain.name}: {why} {others}; leave them out", id="arguments-not-counted")
        sprung = about(chain, q)
        self._diagonals = np.array([sprung.stiffness, damping_slope(chain), chain.hinges["armature"]])
        self._chain, self._state, self._couplings = chain, (wrench, follower, qd), sprung.couplings
        self._work = small_motion(sprung.arrays)
        self._cells = cells_workspace(sprung.arrays) if len(sprung.couplings) else None
        self.set_position(q)
        self.scales = rounding.scales(chain)
        self.locked, self.rounding = np.ones(chain.n, dtype=bool), len(free) * rounding.of_load_stiffness(chain)
        self.locked[free] = False
        self.skipped = np.zeros(0, np.intp)  # coordinates that `eliminate` skipped because their pivots are too small
        self.sizes = np.zeros(chain.n)  # magnitude of the terms in each row of the eliminated matrix

    def set_position(self, q: Array) -> None:
        """Change the configuration to q (n,), and the stiffness to the tangent stiffness there."""
        if (sprung := about(self._chain, q)) is not self._chain:
            self._diagonals[0], self._couplings = sprung.stiffness, sprung.couplings
            self._work = self._work._replace(chain=sprung.arrays)
        wrench, follower, qd = self._state
        set_state(self._work, wrench, follower, q, qd)
        self._q = q

    @property
    def _matrix(self) -> Any:
        """The workspace with the data of coupled cells, which only factorizations and solutions need."""
        return self._work._replace(cells=self._cells)

    def times(self, weights: Array, x: Array) -> Array:
        """(weights · (K, C, M)) x for rows x (m, n), 0 at locked coordinates, shape (m, n)."""
        product = np.empty_like(x)
        multiply(self._work, weights, weights @ self._diagonals, x, product)
        if len(pairs := self._couplings):
            add_products(product, pairs, weights[0] * pairs["stiffness"] + weights[1] * pairs["damping"], x)
        product[:, self.locked] = 0.0
        return product

    def times_mass(self, x: Array) -> Array:
        """M x for rows x (m, n), 0 at locked coordinates, shape (m, n); more accurate than `times`."""
        product = np.empty_like(x)
        mass_products(self._chain.arrays, self._q, x, product)
        product[:, self.locked] = 0.0
        return product

    def eliminate(self, weights: Array, w: Array, sizes: Array, smallest: float = SMALLEST) -> int:
        """Factorize k + w (weights · (K, C, M) − k) for `solve`; returns the number of pivots that are not positive.

        k is the part of weights · (K, C, M) due to springs, friction and rotors; w contains one factor per row.
        """
        self.sizes, given = sizes, self._work.given
        given[:] = self.locked
        negative = factor(self._matrix, weights, weights @ self._diagonals, w, sizes, smallest)
        self.skipped = np.flatnonzero(given & ~self.locked)
        return int(negative)

    def inertias(self) -> tuple[Array, Array]:
        """Diagonal of M, and each coordinate's inertia if all outboard coordinates move freely, shape (n,) [kg m²]."""
        found, ones = [], np.ones(len(self.locked))
        for given in (True, self.locked):
            self._work.given[:] = given
            factor(self._matrix, M_ALONE, M_ALONE @ self._diagonals, ones, ones, -1.0)
            found.append(self._work.hinges[:, HINGE.D].copy())
        return found[0], found[1]

    def solve(self, r: Array) -> tuple[Array, Array]:
        """Solve for right sides r (m, n) with skipped coordinates at 0, then for r = 0 with one of them at 1 at a time.

        Returns the solutions, (m + skipped, n), and the left sides of the skipped rows, (m + skipped, skipped).
        """
        m, skipped = len(r), self.skipped
        right, x = (np.zeros((m + len(skipped), r.shape[1])) for _ in range(2))
        right[:m], left = r, np.zeros_like(right)
        x[m + np.arange(len(skipped)), skipped] = 1.0
        solve(self._matrix, right, x, left)
        return x, left[:, skipped]

    def falling(self, weights: Array, more: Array) -> int:
        """Number of negative eigenvalues of the matrix weights · (K, C, M) + diag(more), which must be symmetric."""
        self._work.given[:] = self.locked
        ones = np.ones(len(more))
        return int(factor(self._matrix, weights, weights @ self._diagonals + more, ones, ones, -1.0))
