"""Stability of Runge-Kutta methods on a chain: its eigenvalues about a state, and the largest stable step.

    λ² M + λ (D + G) + K = 0        K = ∂(T_GC + T_FL)/∂q + k_p,  G = ∂T_GC/∂q̇,  D = ∂T_FR/∂q̇ at rest + k_d

Springs, gravity, wrench, centrifugal forces and drive gains all add stiffness or damping, so all are included. Dry
friction enters with its largest derivative, c/w at rest, since sooner or later a joint comes to rest.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Complex
from flexlink.describe.actions import Frame
from flexlink.describe.schemes import methods
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.forces import Gains, about, damping_along, damping_matrix, force_slopes, turns_with_tip
from flexlink.dynamics.free_motion import DENSE, restricted
from flexlink.dynamics.rounding import EPS, scales
from flexlink.dynamics.singularity import factored_mass
from flexlink.dynamics.tangent import LoadedState, load_matrices, load_torque
from flexlink.dynamics.terms import inverse_dynamics
from flexlink.dynamics.vibration.eigenproblem import first_order_matrix, too_large
from flexlink.dynamics.vibration.extremes import inertia_alone
from flexlink.dynamics.vibration.stability_function import stable_half_disc, stable_reach
from flexlink.kernels.tools.finite import is_finite

NUDGE = 1e-4
"""Step of the central difference along a direction [rad], for sliding joints relative to the arm's length. Its error,
of order NUDGE², is far below the tolerance of the Lanczos method, 1e-4."""


def _along(slope: Array, φ: Array) -> Array:
    """Product of φ and the symmetric part of a gain, which is given as a vector or a matrix."""
    return slope * φ if slope.ndim == 1 else np.asarray(slope @ φ + slope.T @ φ) / 2


def eigenvalues(
    chain: Chain, q: ArrayLike, qd: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", gains: Gains | None = None,
) -> Complex:  # fmt: skip
    """Eigenvalues λ [1/s] of small motion about a state, two per free joint; held joints are excluded.

    λ² M + λ (D + G) + K = 0 with K = ∂(T_GC + T_FL)/∂q + k_p and D = ∂T_FR/∂q̇ at rest + k_d, the gains of a drive.
    Arguments and errors as in `stable_step`.
    """
    return _all_eigenvalues(chain, _about(chain, q, qd, tip_wrench, frame), gains)


def fastest_eigenvalues(
    chain: Chain, q: ArrayLike, qd: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", gains: Gains | None = None,
) -> Complex:  # fmt: skip
    """Eigenvalues that limit the step of an explicit method [1/s]; for more than 100 joints, estimated in O(n).

    The Lanczos method finds the largest ω² of K φ = ω² M φ and the largest δ of D φ = δ M φ; inverse and forward
    dynamics multiply by M and M⁻¹. `bounding_eigenvalues` combines ω and δ. Arguments and errors as in `eigenvalues`.
    """
    state = _about(chain, q, qd, tip_wrench, frame)
    if chain.n <= DENSE or chain.shapes is not None:
        return _all_eigenvalues(chain, state, gains)
    kp, kd = Gains(*np.zeros((2, chain.n))) if gains is None else gains
    square = max(0.0, _largest_ratio(chain, state, lambda φ: _stiffness_along(chain, state, kp, φ)))
    δ = _largest_ratio(chain, state, lambda φ: damping_along(chain, φ) + _along(kd, φ))
    return bounding_eigenvalues(np.sqrt(square), δ)


def eigenvalue_bounds(abouts: Sequence[tuple[Chain, Array, Array]], acting: Sequence[Mapping[str, Any]]) -> list[float]:
    """Upper bounds on |λ| of the `eigenvalues` [1/s] of several chains of equal size, at a fraction of the cost.

    A mode φ satisfies φ*M φ λ² + φ*C φ λ + φ*K φ = 0. With M = L Lᵀ,

        |λ|² ≤ c |λ| + k        c = ‖L⁻¹ C L⁻ᵀ‖, k = ‖L⁻¹ K L⁻ᵀ‖

    in the Frobenius norm, which exceeds the largest ω² of an undamped chain by at most a factor √n. `abouts` contains
    chains and states q, q̇; `acting` the other arguments of `eigenvalues`. The bound is inf if unknown, that is, with
    more than 100 joints, shapes or a singular mass matrix.
    """
    n, count = abouts[0][0].n if abouts else 0, len(abouts)
    if n > DENSE or not n or any(chain.shapes is not None for chain, _, _ in abouts):
        return [np.inf] * count
    K, C, M = np.zeros((3, count, n, n))
    held, each = np.array([chain.held for chain, _, _ in abouts]), np.arange(n)
    for k, ((chain, q, qd), acts) in enumerate(zip(abouts, acting, strict=True)):
        K[k], C[k], M[k] = _matrices(chain, _about(chain, q, qd, acts["tip_wrench"], acts["frame"]), acts["gains"])
    if held.any():
        for A in (C, K, M):
            A[held] = A.swapaxes(1, 2)[held] = 0.0
        M[:, each, each] += held
    try:
        with np.errstate(all="ignore"):  # overflow means that there is no bound
            L = np.linalg.cholesky(M)
            pivots, least = L[:, each, each], np.sqrt(n * EPS * M[:, each, each])
            W = np.linalg.inv(L)
            c, k = (np.linalg.norm(W @ A @ W.swapaxes(1, 2), axis=(1, 2)) for A in (C, K))
            bounds = (c + np.sqrt(c**2 + 4 * k)) / 2
    except np.linalg.LinAlgError:
        return [np.inf] * count
    found: list[float] = np.where((pivots > least).all(axis=1) & np.isfinite(bounds), bounds, np.inf).tolist()
    return found


def _about(chain: Chain, q: ArrayLike, qd: ArrayLike | None, tip_wrench: ArrayLike | None, frame: Frame) -> LoadedState:
    n = require_type("chain", chain, Chain).n
    rates = np.zeros(n) if qd is None else vector("qd", qd, n)
    return LoadedState(vector("q", q, n), rates, wrench_vector(tip_wrench), turns_with_tip(frame), chain.free)


def _matrices(chain: Chain, state: LoadedState, gains: Gains | None) -> tuple[Array, Array, Array]:
    """K, D + G and M of all joints, including drive gains."""
    q, qd, *_ = state
    K, C, M = load_matrices(chain, *state[:4])
    K += about(chain, q).matrix("stiffness")
    if chain.forces:
        of_angle, of_rate = force_slopes(chain, q, qd)
        K, C = K + of_angle, C + of_rate
    C += damping_matrix(chain)
    if gains is not None:
        kp, kd = gains.matrices()
        K, C = K + kp, C + kd
    return K, C, M


def _all_eigenvalues(chain: Chain, state: LoadedState, gains: Gains | None) -> Complex:
    M, _ = factored_mass(chain, state.q, state.free)
    K, C = (restricted(A, chain, state.free) for A in _matrices(chain, state, gains)[:2])
    if C.any() or np.abs(K - K.T).max(initial=0.0) > 1e-12 * np.abs(K).max(initial=0.0):  # rounding error of K
        values: Complex = scipy.linalg.eigvals(first_order_matrix(M, C, K))
        return values
    ω = np.sqrt(_squares((K + K.T) / 2, M).astype(complex))
    return np.concatenate([1j * ω, -1j * ω])


def _squares(K: Array, M: Array) -> Array:
    """SciPy's `eigh(K, M, eigvals_only=True)` without its checks of the input, which take three times as long."""
    if not K.size:  # no free coordinate
        return np.zeros(0)
    squares, _, failed = scipy.linalg.lapack.dsygvd(K, M, jobz="N", uplo="L")
    if failed or not is_finite(squares):
        raise too_large("numbers")
    return np.asarray(squares)


def _stiffness_along(chain: Chain, state: LoadedState, kp: Array, φ: Array) -> Array:
    """K φ [N m/rad], where the load stiffness is a central difference along φ."""
    size = np.abs(φ / scales(chain)).max()
    if size == 0:
        return np.zeros_like(φ)
    step = NUDGE / size * φ
    ahead, behind = (load_torque(chain, state.q + s * step, *state[1:4]) for s in (1, -1))
    held = about(chain, state.q).times("stiffness", φ) + _along(kp, φ)
    return np.asarray(held + (ahead - behind) * (size / (2 * NUDGE)))


def _largest_ratio(chain: Chain, state: LoadedState, apply: Callable[[Array], Array]) -> float:
    """Largest μ of A φ = μ M φ over the joints that are not held; `apply` multiplies by A."""
    from scipy.sparse.linalg import LinearOperator, eigsh  # noqa: PLC0415  0.1 s; only long chains need it

    free, zero = np.zeros(chain.n), np.zeros(chain.n)
    free[state.free] = 1.0
    first = np.ones(chain.n)
    if not (free * apply(free * first)).any():
        return 0.0
    bare = inertia_alone(chain)
    shape = (chain.n, chain.n)
    found = eigsh(
        LinearOperator(shape, lambda φ: free * apply(free * φ.ravel()), dtype=np.float64),
        k=1,
        M=LinearOperator(shape, lambda φ: inverse_dynamics(bare, state.q, zero, φ.ravel()), dtype=np.float64),
        Minv=LinearOperator(shape, lambda τ: forward_dynamics(bare, state.q, zero, τ.ravel()), dtype=np.float64),
        which="LA", tol=1e-4,  # relative; small compared with the margin of a few per cent of a stable step
        v0=first, return_eigenvectors=False,
    )  # fmt: skip
    return float(found[0])


def stable_step(
    chain: Chain, q: ArrayLike | None = None, qd: ArrayLike | None = None, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world", gains: Gains | None = None, method: str = "RK4",
) -> float:  # fmt: skip
    """Largest step [s] at which `method` is stable on this chain about a state.

    It is the largest h with |R(h'λ)| ≤ 1 + 1e-6 for all `eigenvalues` λ of the chain and all h' ≤ h. An unstable
    motion, Re λ > 0, is treated as an oscillation with angular frequency |λ|. The eigenvalues change with configuration
    and rates, so stay a few per cent below this step. For A-stable methods (Radau IIA, Gauss) the result is inf.

    Parameters
    ----------
    chain, q, qd
        The chain; configuration [rad] and rates [rad/s], shape (n,); default: springs slack, joints at zero, as in
        `modes`, at rest.
    tip_wrench, frame
        Constant force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", or of the "tip" frame;
        in the latter they turn with the tip.
    gains
        Gains of a drive, k_p [N m/rad] and k_d [N m s/rad], shape (n,) or (n, n) each.
    method
        Name or file of a Runge-Kutta method.

    Returns
    -------
    float
        The step [s]; inf if no joint has stiffness or damping.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite; or the method is unknown.
    DataFileError
        The file of the method is not valid.
    SingularMassError
        A coordinate has no inertia attached in this configuration.

    Examples
    --------
    >>> print(f"{fl.stable_step(chain, q):.2g} s by RK4, {fl.stable_step(chain, q, method='RK10'):.2g} s by RK10")
    0.00095 s by RK4, 0.0009 s by RK10
    >>> print(fl.stable_step(chain, q, method="Radau5"))  # implicit
    inf
    """
    q = require_type("chain", chain, Chain).rest if q is None else q
    return stable_step_of(fastest_eigenvalues(chain, q, qd, tip_wrench=tip_wrench, frame=frame, gains=gains), method)


def bounding_eigenvalues(ω: float, δ: float) -> Complex:
    """λ [1/s] that limit an explicit method's step, given the fastest oscillation ω [rad/s] and fastest decay δ [1/s].

    They are the roots of λ² + δ λ + ω² = 0, which assume that the stiffest mode is also the most damped one (true for
    Kelvin-Voigt damping), and ±iω and −δ, in case these are separate modes.
    """
    return np.concatenate([np.roots([1.0, δ, ω * ω]).astype(complex), [1j * ω, -1j * ω, -δ]])


def stable_step_of(λ: Complex, method: str) -> float:
    """Stable step [s] for eigenvalues λ [1/s]; inf if no joint has stiffness or damping.

    The stability limit along the direction of an eigenvalue is computed only if needed: an eigenvalue is skipped if the
    stable half disc already allows it a step at least equal to the smallest so far.
    """
    moving, rule, least = λ[λ != 0], methods.method(method), np.inf
    rates = np.abs(moving)
    if not moving.real.any():  # undamped oscillations only
        return float((stable_reach(rule, np.array([1j])) / rates).min(initial=np.inf))
    directions = np.where(moving.real > 0, 1j, moving.real / rates + 1j * np.abs(moving.imag) / rates)  # R(z̄) = R(z)̄
    within = stable_half_disc(rule)
    for k in np.argsort(-rates).tolist():
        if within / rates[k] >= least:
            break
        least = min(least, float(stable_reach(rule, directions[k : k + 1])[0] / rates[k]))
    return least
