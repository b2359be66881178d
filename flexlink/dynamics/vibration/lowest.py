"""Lowest modes of a long chain, (λ² M + λ C + K) φ = 0, in O(n): Rayleigh-Ritz in a growing subspace.

    φ = Wᵀ a        W M Wᵀ = 1        W ← W, (K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ        σ = |λ|

K, C and M projected on the rows of W form an eigenproblem of a few dozen unknowns (`eigenproblem`). The residuals of
its slowest modes are multiplied by the inverse of a positive definite matrix and appended to W (Davidson 1975). With an
exact inverse, as here, this is the shift-and-invert block Lanczos method. For a real symmetric problem the modes are
counted by Sylvester's law of inertia, so none is missed.
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
"""Largest correction of a converged mode shape, relative to its largest entry. The error of ω² is of the order of this
number squared, unless damping or rotation couples the modes."""

EPS = np.finfo(float).eps

GUARD = 4
"""Number of initial rows of W in addition to the modes wanted."""
ROUNDS = 16
"""Largest number of iterations. 5 to 7 suffice unless modes lie very close together, as overdamped modes may."""

NEARLY = 1e-9
"""Relative difference of ω² up to which two modes are considered equal."""


class Subspace:
    """Subspace spanned by the rows of W, with K, C and M of a chain projected on it."""

    def __init__(self, motion: SmallMotion, loads: Array, square: Array, damped: bool) -> None:
        self.motion, self.loads, self.square, self.damped = motion, loads, square, damped
        self.least = self._least_shift()
        self.W = self.MW = self.KW = self.CW = np.zeros((0, len(square)))

    def grow(self, rows: Array) -> bool:
        """Extend W by the new directions among `rows`; return whether there were any."""
        new, M = self._orthonormal(rows)
        K, C = self.motion.times(K_ALONE, new), self.motion.times(C_ALONE, new) if self.damped else np.zeros_like(new)
        known = self.W, self.MW, self.KW, self.CW
        self.W, self.MW, self.KW, self.CW = (np.vstack(parts) for parts in zip(known, (new, M, K, C), strict=True))
        return len(new) > 0

    def _orthonormal(self, rows: Array) -> tuple[Array, Array]:
        """New rows of W with W M Wᵀ = 1, and M times them, in two passes, as the first leaves cancellation errors."""
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
        """K projected on the subspace, with the magnitudes of its terms."""
        n, K, each = len(self.square), self.W @ self.KW.T, np.abs(self.W)
        S = np.sqrt(self.W**2 @ self.square)
        scales = self.motion.scales
        of_loads = np.outer(each @ (self.loads * scales), (each / scales).sum(axis=1)) * (self.motion.rounding / n)
        symmetric = bool((np.abs(K - K.T) <= of_loads + of_loads.T + n * EPS * np.outer(S, S)).all())
        return Stiffness(K, S, symmetric, self.motion.rounding)

    def modes(self) -> eigenproblem.Solution:
        """Modes of the chain restricted to the subspace."""
        return eigenproblem.solve(*self._mass(), self.W @ self.CW.T, self.stiffness())

    def corrections(self, λ: NDArray[np.inexact], shapes: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """(K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ for each mode, relative to the largest entry of φ.

        `shapes` contains the amplitudes of the modes in the subspace, in columns.
        """
        square = λ**2 if np.iscomplexobj(shapes) else (λ**2).real
        residual = square[:, None] * (shapes.T @ self.MW) + shapes.T @ self.KW
        if self.damped:
            residual = residual + λ[:, None] * (shapes.T @ self.CW)
        for k, rate in enumerate(np.abs(λ)):
            self._shift(max(rate, self.least))
            residual[k] = self._divide(residual[k])
        largest = np.abs(shapes.T @ self.W / self.motion.scales).max(axis=1, keepdims=True)
        return np.asarray(residual / self.motion.scales / largest)

    def bent(self, dice: np.random.Generator, count: int) -> Array:
        """Static deflections under the inertia forces of random accelerations, shape (count, n)."""
        rows = dice.normal(size=(count, len(self.square)))
        rows[:, self.motion.locked] = 0.0
        self._shift(self.least)
        return self.motion.solve(self.motion.times_mass(rows))[0]

    def _divide(self, r: NDArray[np.inexact]) -> NDArray[np.inexact]:
        real, imaginary = self.motion.solve(np.array([r.real, r.imag]))[0]
        return np.asarray(real + 1j * imaginary) if np.iscomplexobj(r) else real

    def _shift(self, σ: float, smallest: float = 0.0) -> bool:
        """Factorize K + σ C + σ² M; return whether all pivots are positive and not small compared with their rows."""
        weights, ones = np.array([1.0, σ, σ**2]), np.ones(len(self.square))
        return not self.motion.eliminate(weights, ones, self.square, smallest) and not len(self.motion.skipped)

    def _least_shift(self) -> float:
        """Return the first σ of 0, σ₁, 2 σ₁ … for which K + σ C + σ² M is regular.

        σ₁² is the Rayleigh quotient of the deflection under inertia forces if all joints have equal accelerations.
        """
        if self._shift(0.0, SMALLEST):
            return 0.0
        φ = self.motion.times_mass(np.where(self.motion.locked, 0.0, 1.0)[None]) / self.square
        σ = float(np.sqrt((φ**2 @ self.square)[0] / (φ @ self.motion.times_mass(φ).T)[0, 0]))
        while not self._shift(σ, SMALLEST):
            σ *= 2.0
        return σ

    def is_complete(self, λ: NDArray[np.inexact]) -> bool:
        """Whether `λ` contains all modes below its highest mode; True if this cannot be checked."""
        if self.damped or not self.stiffness().conservative:
            return True
        μ = -(λ**2).real
        below = float(μ[-1]) - NEARLY * abs(float(μ[-1]))
        more = np.zeros(len(self.square)) if below else self.motion.rounding * self.square
        return self.motion.falling(np.array([1.0, 0.0, -below]), more) == int((μ < below).sum())


def lowest(chain: Chain, motion: SmallMotion, loads: Array, count: int, damped: bool) -> eigenproblem.Solution | None:
    """Return the slowest modes, with mode shapes in columns (n, count); None if the iteration does not converge.

    Parameters
    ----------
    chain, motion
        The chain, and its small motion.
    loads
        `rounding.largest_load_stiffness`, shape (n,).
    count
        Number of modes, less than a third of the free coordinates.
    damped
        Whether C is nonzero.
    """
    square, dice = chain.stiffness + loads, np.random.default_rng(0)
    space = Subspace(motion, loads, np.where(square > 0, square, 1.0), damped)
    space.grow(space.bent(dice, count + GUARD))
    for _ in range(ROUNDS):
        found = space.modes()
        λ, shapes = found.eigenvalues[:count], found.shapes[:, :count]
        change = space.corrections(λ, shapes)
        open_ = change[np.abs(change).max(axis=1) > CLOSE]
        if not len(open_):
            if space.is_complete(λ):
                return eigenproblem.Solution(λ, space.W.T @ shapes, found.rounding[:count])
            open_ = space.bent(dice, count + GUARD)
        if not space.grow(np.vstack([open_.real, open_.imag]) if np.iscomplexobj(open_) else open_):
            return None
    return None
