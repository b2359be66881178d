"""The eigenproblem of small motion, (λ² M + λ C + K) φ = 0, with stiffnesses that differ by orders of magnitude.

1.  K = S K̂ S with a diagonal S, so that K̂ is of order 1. By Sylvester's law of inertia, the numbers of negative and
    zero eigenvalues of K̂ are the numbers of unstable and neutral modes, for any M. Small eigenvalues are compared with
    the rounding error here, where all rows have the same magnitude.
2.  With K = Y Yᵀ and M = L Lᵀ, the ω are the singular values of Yᵀ L⁻ᵀ. Nothing is squared: the relative error of ω is
    eps · ω_max/ω; it would be eps · (ω_max/ω)² from eigenvalues of M⁻¹ K. An indefinite K is shifted: K + σ M.
3.  With damping, rotation or a load without a potential, the λ follow from the first-order system in these modes,
    fastest first. The rows of its matrix decrease in size, so the QR algorithm is accurate row by row.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.dynamics.small_motion import C_ALONE, K_ALONE, SMALLEST, SmallMotion
from flexlink.dynamics.tangent import Stiffness

EPS = np.finfo(float).eps


class Solution(NamedTuple):
    """Eigenvalues λ [1/s], slowest first, mode shapes φ in columns, and the rounding error of each λ [1/s]."""

    eigenvalues: Complex
    shapes: NDArray[np.inexact]
    rounding: Array


def too_large(what: str) -> ArgumentError:
    """Return the error for matrices with which some numbers are beyond float64."""
    return ArgumentError(f"stiffness, damping, loads or rates are so large that {what} overflow float64", id="overflow")


class _Modes(NamedTuple):
    """Modes of K φ = μ M φ with the symmetric part of K; μ = −λ² in ascending order; Φᵀ M Φ = 1."""

    μ: Array
    Φ: Array
    falling: int
    resting: int


def solve(M: Array, L: Array, C: Array, stiffness: Stiffness) -> Solution:
    """Return one λ of each conjugate pair, and each real λ; of real pairs ±λ without damping C only λ > 0. M = L Lᵀ."""
    if not all(np.isfinite(part).all() for part in (stiffness.K, stiffness.S, C)):
        raise too_large("numbers")
    modes = _conservative(M, L, stiffness)
    K = stiffness.K
    without_potential = np.zeros_like(K) if stiffness.conservative else (K - K.T) / 2
    found = _first_order(modes, C, without_potential) if C.any() else _undamped(modes, without_potential)
    return found._replace(eigenvalues=np.where(np.abs(found.eigenvalues) <= found.rounding, 0.0, found.eigenvalues))


def _conservative(M: Array, L: Array, stiffness: Stiffness) -> _Modes:
    """Take step 2, twice if K is indefinite, since the first shift is a bound that may be far too high."""
    w, V = np.linalg.eigh(stiffness.scaled)  # reads the lower triangle: rows of outer hinges, which are more accurate
    falling = int((w < -stiffness.rounding).sum())
    resting = int((np.abs(w) <= stiffness.rounding).sum())
    S = stiffness.S
    if not falling:
        squares, Φ = _swinging(L, S, w, V, resting)
        return _Modes(squares, Φ, falling, resting)
    down = scipy.linalg.solve_triangular(L, S[:, None] * V[:, :falling] * np.sqrt(-w[:falling]), lower=True)
    lift = 2 * float(np.linalg.norm(down, 2)) ** 2  # since μ ≥ −‖L⁻¹ Y₋‖²
    for _ in range(2):
        lifted = np.sqrt(S**2 + lift * np.diag(M))
        w, V = np.linalg.eigh((stiffness.symmetric + lift * M) / np.outer(lifted, lifted))
        squares, Φ = _swinging(L, lifted, np.abs(w), V, 0)
        μ = squares - lift
        lift = 2 * abs(float(μ[0]))
    μ = np.concatenate([-np.abs(μ[:falling]), np.zeros(resting), np.abs(μ[falling + resting :])])
    return _Modes(μ, Φ, falling, resting)


def _swinging(L: Array, S: Array, w: Array, V: Array, resting: int) -> tuple[Array, Array]:
    """ω², slowest first, and Φ for K = Y Yᵀ with Y = S V √w; the first `resting` entries of w are treated as zero.

    With Yᵀ L⁻ᵀ = U ω Rᵀ the mode shapes are Φ = L⁻ᵀ R, and also Yᵀ Φ = U ω. The rounding error of row i is
    eps ‖(L⁻ᵀ)_i‖ by the first formula and eps ω/S_i by the second, which is smaller for stiff hinges in slow modes.
    Each entry is taken from the more accurate formula.
    """
    still, root = V[:, :resting], np.sqrt(w[resting:])
    Y = S[:, None] * V[:, resting:] * root
    inverse = scipy.linalg.solve_triangular(L, np.eye(len(L)), lower=True).T
    U, ω, right = np.linalg.svd(Y.T @ inverse)  # `right` has all n rows
    Φ = inverse @ right.T
    moving = Φ[:, : len(ω)]
    by_springs = (V[:, resting:] @ (U * ω / root[:, None]) + still @ (still.T @ (S[:, None] * moving))) / S[:, None]
    Φ[:, : len(ω)] = np.where(np.outer(1 / S, ω) < np.linalg.norm(inverse, axis=1)[:, None], by_springs, moving)
    return np.concatenate([np.zeros(resting), ω[::-1] ** 2]), Φ[:, ::-1]


def _undamped(modes: _Modes, without_potential: Array) -> Solution:
    """Solution without damping, λ = ±√−μ: it contains the λ of each pair ±λ with Im λ > 0, or λ > 0 if real."""
    μ: Complex = modes.μ.astype(complex)
    shapes: NDArray[np.inexact] = modes.Φ
    moved = np.zeros(len(μ))
    if without_potential.any():
        fast = np.argsort(-np.abs(modes.μ), kind="stable")
        Φ = modes.Φ[:, fast]
        μ, amplitudes, moved = _eigenvalues(np.diag(modes.μ[fast]) + Φ.T @ without_potential @ Φ)
        shapes = Φ @ amplitudes
    order = np.argsort(μ.real, kind="stable")
    λ, moved = np.sqrt(-μ[order]), moved[order]
    size = np.maximum(np.abs(λ), np.sqrt(moved))
    rounding = np.divide(moved, size, out=np.zeros(len(λ)), where=size > 0)  # 2 λ dλ = −dμ, and λ² = −dμ at μ = 0
    return Solution(np.where(λ.imag < 0, -λ, λ), shapes[:, order], rounding)


def _eigenvalues(A: Array) -> tuple[Complex, Complex, Array]:
    """Eigenvalues and right eigenvectors of A, and the rounding error of each eigenvalue."""
    λ, left, right = scipy.linalg.eig(A, left=True)
    overlap = np.abs(np.einsum("ik,ik->k", left.conj(), right))
    # The QR algorithm changes a simple eigenvalue by at most N eps ‖A‖/|wᴴ v| (Golub & Van Loan, section 7.2.2), and an
    # eigenvalue of multiplicity m by m times this bound: m = 2 for one neutral joint, 4 for two.
    return λ, right, np.asarray(4 * len(A) * EPS * np.linalg.norm(A, 2) / np.maximum(overlap, EPS))


def _first_order(modes: _Modes, C: Array, without_potential: Array) -> Solution:
    """Solve ẋ = s y, ẏ = −μ a − Φᵀ (C Φ y + N Φ a) for x = s a and y = ȧ, with mode amplitudes a and s = √|μ|.

    The amplitude of a neutral mode has no effect, so the mode has no x, but contributes one λ = 0. If nothing brakes
    the mode, λ = 0 is a double root, whose second half is the steady motion y.
    """
    n, resting = len(modes.μ), 0 if without_potential.any() else modes.resting
    fast = np.argsort(-np.abs(modes.μ), kind="stable")  # neutral modes last
    μ, Φ, m = modes.μ[fast], modes.Φ[:, fast], n - resting
    s = np.sqrt(np.abs(μ[:m]))
    s[s == 0] = s[s > 0].min(initial=1.0)
    x, y = 2 * np.arange(m), np.concatenate([2 * np.arange(m) + 1, m + np.arange(m, n)])
    A = np.zeros((m + n, m + n))
    A[np.ix_(y, y)] = -Φ.T @ C @ Φ
    A[np.ix_(y, x)] = -(Φ.T @ without_potential @ Φ)[:, :m] / s
    A[y[:m], x] -= μ[:m] / s
    A[x, y[:m]] = s
    if not np.isfinite(A).all():
        raise too_large("accelerations")
    λ, right, rounding = _eigenvalues(A)
    if modes.falling == 0 and not without_potential.any() and _dissipative(C):
        λ.real, rounding = np.minimum(λ.real, 0.0), np.zeros(len(λ))  # the energy ½ ȧ² + ½ μ a² ≥ 0 never grows
    order = np.argsort(np.abs(λ), kind="stable")
    steady = order[:resting][np.abs(λ[order[:resting]]) <= len(A) * EPS * np.linalg.norm(A, 2)]
    kept = np.setdiff1d(order[λ[order].imag >= 0], steady, assume_unique=True)
    kept = kept[np.argsort(np.abs(λ[kept]), kind="stable")]
    amplitudes = right[y][:, kept] / np.where(λ[kept] == 0, 1.0, λ[kept])
    amplitudes[:m] = right[x][:, kept] / s[:, None]
    return Solution(
        np.concatenate([np.zeros(resting), λ[kept]]),
        Φ @ np.hstack([np.eye(n)[:, m:], amplitudes]),
        np.concatenate([np.zeros(resting), rounding[kept]]),
    )


def _dissipative(C: Array) -> bool:
    """Whether q̇ᵀ C q̇ ≥ 0 for all q̇ up to rounding errors, judged with all rows scaled to the same magnitude."""
    size = np.sqrt(np.abs(C).max(axis=1))
    size[size == 0] = 1.0
    return bool(np.linalg.eigvalsh((C + C.T) / 2 / np.outer(size, size)).min() >= -len(C) * EPS)


def first_order_matrix(M: Array, C: Array, K: Array) -> Array:
    """A of d/dt (q, q̇) = A (q, q̇), shape (2n, 2n); M must have passed `factored_mass`."""
    L, _ = scipy.linalg.lapack.dpotrf(M, lower=1)
    lower = [-scipy.linalg.cho_solve((L, True), right, check_finite=False) for right in (K, C)]
    A = np.block([[np.zeros_like(M), np.eye(len(M))], lower])
    if not np.isfinite(A).all():
        raise too_large("accelerations")
    return A


# Lowest modes of a long chain, (λ² M + λ C + K) φ = 0, in O(n): Rayleigh-Ritz in a growing subspace.
#
#     φ = Wᵀ a        W M Wᵀ = 1        W ← W, (K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ        σ = |λ|
#
# K, C and M projected on the rows of W form an eigenproblem of a few dozen unknowns (`eigenproblem`). The residuals of
# its slowest modes are multiplied by the inverse of a positive definite matrix and appended to W (Davidson 1975). With
# an exact inverse, as here, this is the shift-and-invert block Lanczos method. For a real symmetric problem the modes
# are counted by Sylvester's law of inertia, so none is missed.


CLOSE = 1e-9
"""Largest correction of a converged mode shape, relative to its largest entry. The error of ω² is of the order of this
number squared, unless damping or rotation couples the modes."""

GUARD = 4  # number of initial rows of W in addition to the modes wanted
ROUNDS = 16
"""Largest number of iterations. 5 to 7 suffice unless modes lie very close together, as overdamped modes may."""

NEARLY = 1e-9  # relative difference of ω² up to which two modes are considered equal


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

    def stiffness(self) -> Stiffness:
        """K projected on the subspace, with the magnitudes of its terms."""
        n, K, each = len(self.square), self.W @ self.KW.T, np.abs(self.W)
        S = np.sqrt(self.W**2 @ self.square)
        scales = self.motion.scales
        of_loads = np.outer(each @ (self.loads * scales), (each / scales).sum(axis=1)) * (self.motion.rounding / n)
        symmetric = bool((np.abs(K - K.T) <= of_loads + of_loads.T + n * EPS * np.outer(S, S)).all())
        return Stiffness(K, S, symmetric, self.motion.rounding)

    def modes(self) -> Solution:
        """Modes of the chain restricted to the subspace."""
        M = self.W @ self.MW.T
        return solve(M, scipy.linalg.cholesky((M + M.T) / 2, lower=True), self.W @ self.CW.T, self.stiffness())

    def corrections(self, λ: NDArray[np.inexact], shapes: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """(K + σ C + σ² M)⁻¹ (λ² M + λ C + K) φ, relative to the largest entry of φ, for modes in the subspace."""
        square = λ**2 if np.iscomplexobj(shapes) else (λ**2).real
        residual = square[:, None] * (shapes.T @ self.MW) + shapes.T @ self.KW
        if self.damped:
            residual = residual + λ[:, None] * (shapes.T @ self.CW)
        for k, rate in enumerate(np.abs(λ)):
            self._shift(max(rate, self.least))
            real, imaginary = self.motion.solve(np.array([residual[k].real, residual[k].imag]))[0]
            residual[k] = real + 1j * imaginary if np.iscomplexobj(residual) else real
        largest = np.abs(shapes.T @ self.W / self.motion.scales).max(axis=1, keepdims=True)
        return np.asarray(residual / self.motion.scales / largest)

    def bent(self, dice: np.random.Generator, count: int) -> Array:
        """Static deflections under the inertia forces of random accelerations, shape (count, n)."""
        rows = dice.normal(size=(count, len(self.square)))
        rows[:, self.motion.locked] = 0.0
        self._shift(self.least)
        return self.motion.solve(self.motion.times_mass(rows))[0]

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


def lowest(chain: Chain, motion: SmallMotion, loads: Array, count: int, damped: bool) -> Solution | None:
    """Return the slowest modes, with mode shapes in columns (n, count); None if the iteration does not converge.

    `loads` is `rounding.largest_load_stiffness`; `count` is less than a third of the free coordinates; `damped`: C ≠ 0.
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
                return Solution(λ, space.W.T @ shapes, found.rounding[:count])
            open_ = space.bent(dice, count + GUARD)
        if not space.grow(np.vstack([open_.real, open_.imag]) if np.iscomplexobj(open_) else open_):
            return None
    return None
