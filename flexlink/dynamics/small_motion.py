"""Small motion x exp(λt) of a chain about a state, (λ² M + λ C + K) x = r: products and solutions in O(n)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.kernels.derivatives.small_motion import factor, multiply, small_motion, solve

K_ALONE, C_ALONE, M_ALONE = np.eye(3)
"""Weights of K, C and M in a sum of them."""

SMALLEST = 1e-8
"""Pivot, as a part of what its row is made of, below which a coordinate is spared: half of all digits are left."""


class SmallMotion:
    """K = ∂(T_GC + T_FL)/∂q, C = ∂(T_GC + T_FR)/∂q̇ and M about a posture at constant rates, locked coordinates at rest.

    Attributes
    ----------
    spared
        Coordinates that `eliminate` has left, since their pivots are too small: sequential indices.
    sizes
        What the rows of the matrix that was eliminated are made of, shape (n,).
    """

    def __init__(
        self, chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool, locked: NDArray[np.bool_]
    ) -> None:
        hinges = chain.hinges
        friction = chain.damping + hinges["coulomb"] / hinges["coulomb_width"]
        self._diagonals = np.array([chain.stiffness, friction, hinges["armature"]])
        self._work = small_motion(chain.arrays, wrench, follower, q, qd)
        self.locked, self.rounding = locked, int((~locked).sum()) * rounding.of_load_stiffness(chain)
        self.spared, self.sizes = np.zeros(0, np.intp), np.zeros(chain.n)

    def times(self, weights: Array, x: Array) -> Array:
        """(weights · (K, C, M)) x for rows x (m, n), 0 at locked coordinates, shape (m, n)."""
        product = np.empty_like(x)
        multiply(self._work, weights, weights @ self._diagonals, x, product)
        product[:, self.locked] = 0.0
        return product

    def eliminate(self, weights: Array, w: Array, sizes: Array) -> None:
        """Prepare `solve` for k + w (weights · (K, C, M) − k), k what springs, friction and rotors give, w by rows."""
        self.sizes, given = sizes, self._work.given
        given[:] = self.locked
        factor(self._work, weights, weights @ self._diagonals, w, sizes, SMALLEST)
        self.spared = np.flatnonzero(given & ~self.locked)

    def solve(self, r: Array) -> tuple[Array, Array]:
        """Solutions for right sides r (m, n), 0 at spared coordinates, and those for none where these are 1 in turn.

        Returns the solutions (m + spared, n), and the left sides of the spared rows, (m + spared, spared).
        """
        m, spared = len(r), self.spared
        right, x = (np.zeros((m + len(spared), r.shape[1])) for _ in range(2))
        right[:m], left = r, np.zeros_like(right)
        x[m + np.arange(len(spared)), spared] = 1.0
        solve(self._work, right, x, left)
        return x, left[:, spared]

    def falling(self, weights: Array, more: Array) -> int:
        """Number of negative eigenvalues of weights · (K, C, M) + diag(more), if that is symmetric."""
        self._work.given[:] = self.locked
        ones = np.ones(len(more))
        return int(factor(self._work, weights, weights @ self._diagonals + more, ones, ones, -1.0))
