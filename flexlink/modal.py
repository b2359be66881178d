"""Modes of small motion of a chain about a posture.

    M δq̈ + (D + G) δq̇ + K δq = 0,        δq = φ exp(λt)

K is the tangent of T_GC + T_FL (elastic, gravity, load and centrifugal stiffness), G the gyroscopic matrix, D the
slope of T_FR at rest.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import linalg

from flexlink.chain import Chain
from flexlink.checks import flag, given, vector, wrench_vector
from flexlink.dynamics import frames, mass_matrix
from flexlink.errors import ArgumentError, SingularMassError
from flexlink.tangent import gyroscopic_matrix, point_jacobian, stiffness_matrix, unlocked

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclasses.dataclass(frozen=True)
class Modes:
    """Modes of small motion about a posture, slowest first.

    Attributes
    ----------
    eigenvalues
        λ [1/s], shape (modes,): one of each conjugate pair, and every real one that is not paired by symmetry.
    shapes
        φ, shape (modes, n): largest entry 1, zero on locked coordinates; complex where damping or rotation makes
        the joints move out of phase.
    paths
        Displacement of the body origins and the tip that goes with φ, frame 0, shape (modes, bodies, 3) [m].
    points
        Body origins and tip at the posture itself, frame 0, shape (bodies, 3) [m].
    """

    eigenvalues: Complex
    shapes: NDArray[np.inexact]
    paths: NDArray[np.inexact]
    points: Array

    @property
    def frequencies(self) -> Array:
        """Natural angular frequencies |λ| [rad/s], shape (modes,); nan for a motion that just falls, λ real > 0."""
        λ = self.eigenvalues
        return np.where((λ.imag == 0) & (λ.real > 0), np.nan, np.abs(λ))

    @property
    def hertz(self) -> Array:
        """`frequencies` / 2π [Hz]."""
        return self.frequencies / (2 * np.pi)

    @property
    def damping_ratios(self) -> Array:
        """ζ = −Re λ / |λ|, shape (modes,): 0 undamped, 1 creeping back, negative growing; 0 for λ = 0."""
        size = np.abs(self.eigenvalues)
        return -self.eigenvalues.real / np.where(size > 0, size, 1.0)

    @property
    def stable(self) -> bool:
        """Nothing grows: no ζ below the rounding of the eigenvalues, 1e-8."""
        return bool((self.damping_ratios > -1e-8).all())


def modes(
    chain: Chain,
    q: ArrayLike | None = None,
    *,
    locked: Sequence[int] = (),
    tip_wrench: ArrayLike | None = None,
    follower: bool = False,
    qd: ArrayLike | None = None,
) -> Modes:
    """Modes of small motion about a posture, which should be an equilibrium (`solve_static`).

    M δq̈ + (D + G) δq̇ + K δq = 0,  δq = φ exp(λt):  K = ∂(T_GC + T_FL)/∂q, G = ∂T_GC/∂q̇, D the slope of T_FR at rest.

    Parameters
    ----------
    chain
        The chain. Its gravity counts: hanging stiffens, standing softens.
    q
        Posture [rad], shape (n,); default: springs slack, joints at zero.
    locked
        Sequential indices of the coordinates that do not move, such as servo-held joints. Prescribed joints never do.
    tip_wrench
        Constant force and moment on the tip [N, N m], shape (6,), axes of frame 0.
    follower
        The wrench is given in axes of the tip frame and turns with it.
    qd
        Rates of steady rotation [rad/s], shape (n,), such as Ω on a joint that is also `locked` (held at that
        rate): centrifugal stiffness and gyroscopic coupling.

    Returns
    -------
    Modes
        Eigenvalues [1/s], shapes, paths [m], slowest first.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    SingularMassError
        A coordinate moves no inertia of its own at this posture.
    """
    n, follower = given("chain", chain, Chain).n, flag("follower", follower)
    q = chain.rest.copy() if q is None else vector("q", q, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    wrench = wrench_vector(tip_wrench)
    free = unlocked(chain, locked)
    block = np.ix_(free, free)
    M = regular_mass(chain, q, free)
    K = stiffness_matrix(chain, q, rates, wrench, follower)[block]
    C = (gyroscopic_matrix(chain, q, rates) + np.diag(damping_slope(chain)))[block]
    λ, vectors = _general(M, C, K) if C.any() else _undamped(M, K)
    shapes = np.zeros((len(λ), n), dtype=vectors.dtype)
    largest = vectors[np.abs(vectors).argmax(axis=0), np.arange(len(λ))]
    shapes[:, free] = (vectors / largest).T
    points = frames(chain, q).points
    return Modes(λ, shapes, np.einsum("mk,bkx->mbx", shapes, point_jacobian(chain, q)), points)


def natural_frequencies(
    chain: Chain,
    q: ArrayLike | None = None,
    *,
    locked: Sequence[int] = (),
    tip_wrench: ArrayLike | None = None,
    follower: bool = False,
    qd: ArrayLike | None = None,
) -> Array:
    """Natural angular frequencies [rad/s], shape (modes,), slowest first, nan for a motion that just falls.

    They are `modes(...).frequencies`; arguments and errors as there.
    """
    return modes(chain, q, locked=locked, tip_wrench=tip_wrench, follower=follower, qd=qd).frequencies


def _undamped(M: Array, K: Array) -> tuple[Complex, NDArray[np.inexact]]:
    """K φ = μ M φ, λ = √−μ: of each pair the one with Im λ > 0, or the growing one of two real ones."""
    if not np.isfinite(K).all():
        raise ArgumentError("the loads lead to a stiffness beyond float64")
    if np.abs(K - K.T).max() <= 1e-12 * np.abs(K).max():  # conservative loads; the bound is rounding of K
        μ, vectors = linalg.eigh((K + K.T) / 2, M)
    else:
        μ, vectors = linalg.eig(K, M)
    order = np.argsort(μ.real, kind="stable")
    λ = np.sqrt(-μ[order].astype(complex))
    return np.where(λ.imag < 0, -λ, λ), vectors[:, order]


def regular_mass(chain: Chain, q: Array, free: NDArray[np.intp]) -> Array:
    """M of the free coordinates, of which each must move inertia of its own.

    Cholesky's pivot is the inertia of a coordinate while those before it are free to give way; it must exceed the
    rounding of M, n eps M_ii. (The diagonal of Cholesky's factor holds the square roots of the pivots.)
    """
    M = mass_matrix(chain, q)[np.ix_(free, free)]
    factor, stopped = linalg.lapack.dpotrf(M, lower=1)
    good = np.diag(factor) > np.sqrt(len(M) * np.finfo(float).eps * np.diag(M))  # False for nan, too
    if stopped or not good.all():
        k = free[stopped - 1 if stopped else int(np.argmin(good))]
        raise SingularMassError(
            f"{chain.name}: joint {chain.joint_name(int(k))!r} moves no inertia of its own at this posture, or one "
            "beyond float64; M must be positive definite"
        )
    return np.asarray(M)


def _general(M: Array, C: Array, K: Array) -> tuple[Complex, Complex]:
    """(λ² M + λ C + K) φ = 0 through the linear problem in (φ, λφ); one of each conjugate pair."""
    λ, vectors = linalg.eig(first_order_matrix(M, C, K))
    kept = λ.imag >= 0
    order = np.argsort(np.abs(λ[kept]), kind="stable")
    return λ[kept][order], vectors[: len(M), kept][:, order]


def first_order_matrix(M: Array, C: Array, K: Array) -> Array:
    """A of d/dt (q, q̇) = A (q, q̇), shape (2n, 2n)."""
    factor = linalg.cho_factor(M)
    lower = [-linalg.cho_solve(factor, right, check_finite=False) for right in (K, C)]
    A = np.block([[np.zeros_like(M), np.eye(len(M))], lower])
    if not np.isfinite(A).all():
        raise ArgumentError("stiffness, damping, loads or rates lead to accelerations beyond float64")
    return A


def damping_slope(chain: Chain) -> Array:
    """Slope of T_FR at rest, d + coulomb / coulomb_width, shape (n,)."""
    return np.asarray(chain.damping + chain.hinges["coulomb"] / chain.hinges["coulomb_width"])
