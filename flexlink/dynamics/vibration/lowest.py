"""The lowest modes of a long chain, (λ² M + λ C + K) φ = 0, in O(n): Rayleigh and Ritz in a subspace that grows.

    φ = Wᵀ a        W M Wᵀ = 1        W ← W, (K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ        σ = |λ|

K, C and M projected on the rows of W are an eigenproblem of some dozen unknowns (`eigenproblem`). What is left over of
its slowest modes, divided by a matrix that is positive definite and as large as the parts that should cancel, are the
next rows (Davidson 1975; with an exact division, as here, Lanczos' method with shift and inversion, by blocks). A real
symmetric problem's modes are counted by Sylvester's law of inertia: none is passed over.
"""

from __future__ import annotations

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.small_motion import C_ALONE, K_ALONE, SMALLEST, SmallMotion
from flexlink.dynamics.tangent import Stiffness
from flexlink.dynamics.vibration import eigenproblem

CLOSE = 1e-9
"""Change of a shape, as a part of its largest entry, that one more division would bring, below which it is found. The
error of ω² is of the order of its square where damping and rotation do not couple the modes."""

EPS = np.finfo(float).eps

GUARD, ROUNDS = 4, 16
"""Rows of W at the start beside those that are wanted, and how often it may grow. It takes 5 to 7 rounds, unless modes
lie so close as those that creep, when dampers are as strong as springs, do."""

NEARLY = 1e-9
"""Part of ω² within which two modes are one when they are counted."""


class Subspace:
    """W, and K, C, M of a chain projected on it."""

    def __init__(self, motion: SmallMotion, loads: Array, square: Array, damped: bool) -> None:
        self.motion, self.loads, self.square, self.damped = motion, loads, square, damped
        self.least = self._least_shift()
        self.W = self.MW = self.KW = self.CW = np.zeros((0, len(square)))

    def grow(self, rows: Array) -> bool:
        """Add what is new of some rows; whether anything was."""
        new, M = self._orthonormal(rows)
        K, C = self.motion.times(K_ALONE, new), self.motion.times(C_ALONE, new) if self.damped else np.zeros_like(new)
        known = self.W, self.MW, self.KW, self.CW
        self.W, self.MW, self.KW, self.CW = (np.vstack(parts) for parts in zip(known, (new, M, K, C), strict=True))
        return len(new) > 0

    def _orthonormal(self, rows: Array) -> tuple[Array, Array]:
        """Directions of their own, W M Wᵀ = 1, and M times them; twice: what cancels in the first pass is noise."""
        for least in (1e-10, 0.5):
            M = self.motion.times_mass(rows)
            size = np.sqrt(np.maximum(np.einsum("mn,mn->m", rows, M), 0.0))
            rows, M = (part[size > 0] / size[size > 0, None] for part in (rows, M))
            known = rows @ self.MW.T
            rows, M = rows - known @ self.W, M - known @ self.MW
            μ, V = np.linalg.eigh(rows @ M.T)
            kept = μ > least**2
            rows, M = ((V[:, kept] / np.sqrt(μ[kept])).T @ part for part in (rows, M))
        return rows, M

    def _mass(self) -> tuple[Array, Array]:
        M = self.W @ self.MW.T
        return M, scipy.linalg.cholesky((M + M.T) / 2, lower=True)

    def stiffness(self) -> Stiffness:
        """K, with the sizes of its parts."""
        n, K, each = len(self.square), self.W @ self.KW.T, np.abs(self.W)
        S = np.sqrt(self.W**2 @ self.square)
        scales = self.motion.scales
        of_loads = np.outer(each @ (self.loads * scales), (each / scales).sum(axis=1)) * (self.motion.rounding / n)
        symmetric = bool((np.abs(K - K.T) <= of_loads + of_loads.T + n * EPS * np.outer(S, S)).all())
        return Stiffness(K, S, symmetric, self.motion.rounding)

    def modes(self) -> eigenproblem.Solution:
        """Those of the subspace."""
        return eigenproblem.solve(*self._mass(), self.W @ self.CW.T, self.stiffness())

    def left_over(self, λ: NDArray[np.inexact], shapes: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """(K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ for columns of amplitudes, as parts of the largest entry of φ."""
        square = λ**2 if np.iscomplexobj(shapes) else (λ**2).real
        left = square[:, None] * (shapes.T @ self.MW) + shapes.T @ self.KW
        if self.damped:
            left = left + λ[:, None] * (shapes.T @ self.CW)
        for k, rate in enumerate(np.abs(λ)):
            self._shift(max(rate, self.least))
            left[k] = self._divide(left[k])
        largest = np.abs(shapes.T @ self.W / self.motion.scales).max(axis=1, keepdims=True)
        return np.asarray(left / self.motion.scales / largest)

    def bent(self, dice: np.random.Generator, count: int) -> Array:
        """Shapes that random accelerations bend it to, shape (count, n)."""
        rows = dice.normal(size=(count, len(self.square)))
        rows[:, self.motion.locked] = 0.0
        self._shift(self.least)
        return self.motion.solve(self.motion.times_mass(rows))[0]

    def _divide(self, r: NDArray[np.inexact]) -> NDArray[np.inexact]:
        real, imaginary = self.motion.solve(np.array([r.real, r.imag]))[0]
        return np.asarray(real + 1j * imaginary) if np.iscomplexobj(r) else real

    def _shift(self, σ: float, smallest: float = 0.0) -> bool:
        """Eliminate K + σ C + σ² M; whether all pivots are positive and larger than a part of their rows."""
        weights, ones = np.array([1.0, σ, σ**2]), np.ones(len(self.square))
        return not self.motion.eliminate(weights, ones, self.square, smallest) and not len(self.motion.spared)

    def _least_shift(self) -> float:
        """The first σ of 0, σ₁, 2 σ₁ … where K + σ C + σ² M is regular.

        σ₁² is the quotient of Rayleigh of the shape to which the inertia of a common acceleration bends the springs.
        """
        if self._shift(0.0, SMALLEST):
            return 0.0
        φ = self.motion.times_mass(np.where(self.motion.locked, 0.0, 1.0)[None]) / self.square
        σ = float(np.sqrt((φ**2 @ self.square)[0] / (φ @ self.motion.times_mass(φ).T)[0, 0]))
        while not self._shift(σ, SMALLEST):
            σ *= 2.0
        return σ

    def is_complete(self, λ: NDArray[np.inexact]) -> bool:
        """Whether no mode below the highest of these is missing; True where that is not known."""
        if self.damped or not self.stiffness().conservative:
            return True
        μ = -(λ**2).real
        below = float(μ[-1]) - NEARLY * abs(float(μ[-1]))
        more = np.zeros(len(self.square)) if below else self.motion.rounding * self.square
        return self.motion.falling(np.array([1.0, 0.0, -below]), more) == int((μ < below).sum())


def lowest(chain: Chain, motion: SmallMotion, loads: Array, count: int, damped: bool) -> eigenproblem.Solution | None:
    """The slowest modes, shapes in columns (n, count); None if they are not found.

    Parameters
    ----------
    chain, motion
        The chain, and its small motion.
    loads
        `rounding.largest_load_stiffness`, shape (n,).
    count
        How many are wanted, fewer than a third of the coordinates that are free.
    damped
        Whether C is not 0.
    """
    square, dice = chain.stiffness + loads, np.random.default_rng(0)
    space = Subspace(motion, loads, np.where(square > 0, square, 1.0), damped)
    space.grow(space.bent(dice, count + GUARD))
    for _ in range(ROUNDS):
        found = space.modes()
        λ, shapes = found.eigenvalues[:count], found.shapes[:, :count]
        left = space.left_over(λ, shapes)
        open_ = left[np.abs(left).max(axis=1) > CLOSE]
        if not len(open_):
            if space.is_complete(λ):
                return eigenproblem.Solution(λ, space.W.T @ shapes, found.rounding[:count])
            open_ = space.bent(dice, count + GUARD)
        if not space.grow(np.vstack([open_.real, open_.imag]) if np.iscomplexobj(open_) else open_):
            return None
    return None
