"""Equilibria of a chain whose hinges move by shapes, q = q₀ + B z: the load path of `load_path` in the coordinates z.

F(z, s) = Bᵀ (T_FL(q) + s L(q) − (1 − s) T_FL(q₀))        coordinates with springs; the others under the full load
"""

from __future__ import annotations

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics import rounding
from flexlink.dynamics.free_motion import basis, first_joints, sums_of_squares
from flexlink.dynamics.load_path import Equations, shortest
from flexlink.dynamics.springs import about, linearised, spring_torque
from flexlink.dynamics.tangent import LoadedState, falls, stiffness_matrix


class ShapedEquations(Equations):
    """F(x) for x = (s, z), shape (1 + f,), and its derivatives; locked coordinates are not among z."""

    def __init__(self, chain: Chain, acting: LoadedState, drive: Array) -> None:
        start, rates, wrench, _, free = acting
        self.chain, self.acting, self.drive, self.B = chain, acting, drive, basis(chain, free)
        self.square = sums_of_squares(linearised(chain, start).stiffness, chain, free)
        self.sprung = self.square > 0
        self.start = np.zeros(1 + self.B.shape[1])
        self.sizes = sums_of_squares(rounding.largest_load_stiffness(chain, rates, wrench), chain, free)
        self.scales = np.append(1.0, rounding.scales(chain)[first_joints(chain, free)])
        self.rounding = len(self.square) * rounding.of_load_stiffness(chain)
        self.held = self.B.T @ spring_torque(chain, start) + np.where(self.sprung, 0.0, self.B.T @ self.load(start))
        self.slope, self.terms = np.zeros((len(self.square),) * 2), np.ones(len(self.square))

    def posture(self, x: Array) -> Array:
        """Angles q (n,) of a point of the path."""
        return np.asarray(self.acting.q + self.B @ x[1:])

    def falls(self, x: Array) -> bool:
        """Whether an equilibrium is unstable under the full load."""
        _, rates, wrench, follower, free = self.acting
        return falls(self.chain, self.posture(x), rates, wrench, free, follower)

    def value(self, x: Array) -> Array:
        """F(x)."""
        s, q = x[0], self.posture(x)
        loaded = np.where(self.sprung, s, 1.0) * (self.B.T @ self.load(q))
        return np.asarray(self.B.T @ spring_torque(self.chain, q) + loaded - (1 - s) * self.held)

    def with_slope(self, x: Array) -> tuple[Array, Array]:
        """F(x) and ∂F/∂s at x; computes ∂F/∂z for `solve`."""
        q, w = self.posture(x), np.where(self.sprung, x[0], 1.0)
        _, rates, wrench, follower, _ = self.acting
        elastic = about(self.chain, q).matrix("stiffness")
        whole = stiffness_matrix(self.chain, q, rates, wrench, follower)
        self.slope = self.B.T @ elastic @ self.B + w[:, None] * (self.B.T @ (whole - elastic) @ self.B)
        self.terms = self.square + np.abs(w) * self.sizes
        return self.value(x), np.where(self.sprung, self.B.T @ self.load(q), 0.0) + self.held

    def solve(self, by_s: Array, row: Array, residual: Array, last: float, *, held: bool = False) -> Array:
        """Shortest solution (δs, δz) of F' δx = residual and row · δx = last, or nan; `held` adds weak springs."""
        terms = np.where(self.terms > 0, self.terms, 1.0)
        slope = self.slope + np.diag(np.sqrt(self.rounding) * terms) if held else self.slope
        whole = np.block([[by_s[:, None], slope], [row[None]]])
        sizes = np.append(terms, max(np.abs(row).max(), np.finfo(float).tiny))
        return shortest(whole, np.append(residual, last), sizes, self.rounding)


def equations_of(chain: Chain, acting: LoadedState, drive: Array) -> Equations:
    """Equations of the load path of a chain, with or without shapes."""
    return (Equations if chain.shapes is None else ShapedEquations)(chain, acting, drive)
