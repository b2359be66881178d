"""Linear dynamics of a chain about a posture: frequencies, modes and the largest stable step.

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
from flexlink.dynamics import frames, mass_matrix, vector
from flexlink.errors import SceneError, SingularMassError
from flexlink.tableaus import Tableau, tableau
from flexlink.tangent import gyroscopic_matrix, point_jacobian, stiffness_matrix, unlocked

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

GROWTH = 1e-6
"""Growth of the amplitude per step that still counts as stable: a factor e in a million steps. Exactly zero would
call RK2 unstable at every step, since its amplitude grows by (ω h)⁴/8."""


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

    Parameters
    ----------
    chain
        The chain. Its gravity counts: hanging stiffens, standing softens.
    q
        Posture [rad], shape (n,); default: springs slack, joints at zero.
    locked
        Sequential indices of the coordinates that do not move, such as servo-held joints.
    tip_wrench
        Constant force and moment on the tip [N, N m], shape (6,), axes of frame 0.
    follower
        The wrench is given in axes of the tip frame and turns with it.
    qd
        Rates of steady rotation [rad/s], shape (n,), such as Ω on a joint that is also `locked` (held at that
        rate): centrifugal stiffness and gyroscopic coupling.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape or is not finite, or `locked` names no coordinate.
    """
    n = chain.n
    q = chain.rest.copy() if q is None else vector("q", q, n)
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    wrench = np.zeros(6) if tip_wrench is None else vector("tip_wrench", tip_wrench, 6)
    free = unlocked(chain, locked)
    block = np.ix_(free, free)
    M = mass_matrix(chain, q)[block]
    K = stiffness_matrix(chain, q, rates, wrench, follower)[block]
    C = (gyroscopic_matrix(chain, q, rates) + np.diag(_damping(chain)))[block]
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
    """Natural angular frequencies [rad/s], slowest first: `modes(...).frequencies`, arguments and errors as there."""
    return modes(chain, q, locked=locked, tip_wrench=tip_wrench, follower=follower, qd=qd).frequencies


def _undamped(M: Array, K: Array) -> tuple[Complex, NDArray[np.inexact]]:
    """K φ = μ M φ, λ = √−μ: of each pair the one with Im λ > 0, or the growing one of two real ones."""
    if np.abs(K - K.T).max() <= 1e-12 * np.abs(K).max():  # conservative loads; the bound is rounding of K
        μ, vectors = _eigh((K + K.T) / 2, M)
    else:
        μ, vectors = linalg.eig(K, M)
    order = np.argsort(μ.real, kind="stable")
    λ = np.sqrt(-μ[order].astype(complex))
    return np.where(λ.imag < 0, -λ, λ), vectors[:, order]


def _eigh(K: Array, M: Array) -> tuple[Array, Array]:
    try:
        μ, vectors = linalg.eigh(K, M)
    except linalg.LinAlgError:
        raise SingularMassError("the mass matrix is singular at this posture: some joint moves no inertia") from None
    return μ, vectors


def _general(M: Array, C: Array, K: Array) -> tuple[Complex, Complex]:
    """(λ² M + λ C + K) φ = 0 through the linear problem in (φ, λφ); one of each conjugate pair."""
    zero, one = np.zeros_like(M), np.eye(len(M))
    A = np.block([[zero, one], [-linalg.solve(M, K, assume_a="pos"), -linalg.solve(M, C, assume_a="pos")]])
    λ, vectors = linalg.eig(A)
    kept = λ.imag >= 0
    order = np.argsort(np.abs(λ[kept]), kind="stable")
    return λ[kept][order], vectors[: len(M), kept][:, order]


def _damping(chain: Chain) -> Array:
    """Slope of T_FR at rest, d + coulomb / coulomb_width, shape (n,)."""
    return np.asarray(chain.damping + chain.hinges["coulomb"] / chain.hinges["coulomb_width"])


def eigenvalues(chain: Chain, q: ArrayLike) -> Complex:
    """Eigenvalues λ of the springs and the friction about posture `q`, gravity left out, shape (2n,) [1/s].

    λ² M + λ D + K = 0 with D the slope of T_FR at rest. |Im λ| ≈ ω of lightly damped modes.

    Raises
    ------
    ArgumentError
        `q` has the wrong shape, is not real or not finite.
    """
    q = vector("q", q, chain.n)
    M = mass_matrix(chain, q)
    D = _damping(chain)
    if not D.any():
        ω = np.sqrt(np.maximum(_eigh(np.diag(chain.stiffness), M)[0], 0.0))
        return np.concatenate([1j * ω, -1j * ω])
    zero, one = np.zeros_like(M), np.eye(chain.n)
    A = np.block([[zero, one], [-linalg.solve(M, np.diag(chain.stiffness)), -linalg.solve(M, np.diag(D))]])
    values: Complex = linalg.eigvals(A)
    return values


def largest_frequency(chain: Chain, q: ArrayLike) -> float:
    """Largest |λ| of `eigenvalues` [rad/s]: what the step of an explicit method has to follow."""
    return float(np.abs(eigenvalues(chain, q)).max())


def stability_polynomial(method: Tableau) -> Array:
    """Coefficients of R(z) = 1 + z b·(1 − zA)⁻¹·1 = Σ r_k z^k, r_0 first (Hairer & Wanner, II, eq. IV.2.11)."""
    A, b, _ = method.arrays
    coefficients, power = [1.0], np.ones(method.stages)
    for _ in range(method.stages):
        coefficients.append(float(b @ power))
        power = A @ power
    return np.array(coefficients)


def stable_step(chain: Chain, method: str = "RK4", q: ArrayLike | None = None) -> float:
    """Largest step [s] at which `method` does not blow up on this chain about posture `q` (default: straight).

    The largest h with |R(h'λ)| ≤ 1 + 1e-6 for all eigenvalues λ of the chain and all h' ≤ h. Fast large motion
    shifts the eigenvalues; stay a few per cent below.

    Raises
    ------
    ArgumentError
        Unknown method, or `q` with a wrong shape.
    """
    λ = eigenvalues(chain, np.zeros(chain.n) if q is None else q)
    λ = λ[np.abs(λ) > 1e-9 * max(np.abs(λ).max(), 1e-300)]
    if len(λ) == 0:
        return np.inf
    r = stability_polynomial(tableau(method))
    fastest = float(np.abs(λ).max())

    def unstable(x: float) -> bool:
        return bool((np.abs(np.polynomial.polynomial.polyval(x / fastest * λ, r)) > 1 + GROWTH).any())

    grid = np.arange(1, 4001) * 0.01  # h |λ|; no explicit method with 40 stages or fewer reaches 40
    high = next((x for x in grid if unstable(x)), None)
    if high is None:
        raise SceneError(f"{method!r}: stable beyond h |λ| = {grid[-1]}; not an explicit Runge-Kutta method")
    low = high - 0.01
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (low, middle) if unstable(middle) else (middle, high)
    return float(low / fastest)
