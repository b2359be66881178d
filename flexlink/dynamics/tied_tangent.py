"""Small motion of an arm with ties about a posture at rest: δq = Z δy, where J Z = 0 for exact rows.

    Zᵀ M Z δÿ + Zᵀ (D + Jᵀ d J) Z δẏ + Zᵀ (K + Jᵀ k J + Σ λ ∂J/∂q) Z δy = 0

k and d are the slopes of the law of a spring that is valid at the posture: 0 in its free range, beyond it k and c |λ|.
δy are coordinates of the arm, the stiffest that can be: ties then move joints rather than springs. For a point p of a
body and its joints i and j, i not outboard of j, ∂²p/∂q_i ∂q_j = ∂ω/∂q̇_i × ∂p/∂q_j.
"""

import warnings
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError, ConvergenceError, Diagnostic
from flexlink.common.products import cross
from flexlink.common.types import Array, Indices
from flexlink.describe.actions import Frame
from flexlink.describe.scene import Scene
from flexlink.dynamics.derivatives import ForwardDerivatives
from flexlink.dynamics.forces import turns_with_tip
from flexlink.dynamics.free_motion import basis, restricted, sums_of_squares
from flexlink.dynamics.placement import jacobian_columns
from flexlink.dynamics.rounding import largest_load_stiffness
from flexlink.dynamics.singularity import factored_mass
from flexlink.dynamics.tangent import LoadedState, Stiffness, load_torque, stiffness_matrix
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.ties import Ties, gaps, poses, springs, tie_rows
from flexlink.kernels.stepping.tie_rows import KIND


class TiedState(NamedTuple):
    """The ties of an arm at a posture at rest."""

    ties: Ties
    J: Array  # (r, n) of all rows
    exact: NDArray[np.bool_]  # (r,)
    λ: Array  # (r,) [N, N m]
    k: Array  # (r,) slopes of λ of springs [N/m, N m/rad], and their dampers [N s/m, N m s/rad]; 0 for exact rows
    d: Array
    bends: Array  # (r, n, n) ∂J/∂q
    Z: Array  # (f, m) motion of the free coordinates per unit of δy
    kept: Indices  # (m,) the free coordinates that are y

    @property
    def turning(self) -> Array:
        """Σ λ ∂J/∂q (n, n)."""
        return np.tensordot(self.λ, self.bends, 1)

    @property
    def stiffness(self) -> Array:
        """Jᵀ k J + Σ λ ∂J/∂q (n, n)."""
        return self.J.T @ (self.k[:, None] * self.J) + self.turning

    @property
    def damping(self) -> Array:
        """Jᵀ d J (n, n)."""
        return self.J.T @ (self.d[:, None] * self.J)

    def energies(self, shapes: NDArray[np.inexact], rates: Array) -> Array:
        """φ* Jᵀ (k + |λ| d) J φ (modes,) of mode shapes (modes, n), with the eigenvalues' magnitudes `rates`."""
        square = np.abs(shapes @ self.J.T) ** 2
        return np.asarray(square @ self.k + rates * (square @ self.d))

    def reduced(
        self, M: Array, C: Array, K: Stiffness, chain: Chain, free: Indices
    ) -> tuple[Array, Array, Array, Stiffness]:
        """Zᵀ M Z = L Lᵀ, L, Zᵀ C Z, Zᵀ K Z with ties, from matrices (f, f) of the free coordinates without them."""
        Z, own = self.Z, restricted(self.stiffness, chain, free)
        S = np.sqrt((Z**2).T @ K.S**2 + np.einsum("im,ij,jm->m", np.abs(Z), np.abs(own), np.abs(Z)))
        M, C = Z.T @ M @ Z, Z.T @ (C + restricted(self.damping, chain, free)) @ Z
        return M, scipy.linalg.cholesky(M, lower=True), C, K._replace(K=Z.T @ (K.K + own) @ Z, S=S)

    def slopes(self, free: ForwardDerivatives, M: Array, qdd: Array, B: Array) -> ForwardDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX with ties, from those without them at T_EX − Jᵀ λ; all motions are δq = B δz.

        J δq̈ = −(∂J/∂q δq) q̈ holds for δq̈ = P δq̈⁰ − (1 − P) J⁺ (∂J/∂q q̈) δq, with P = Z (Zᵀ M Z)⁻¹ Zᵀ M.
        """
        N = B @ self.Z
        P = N @ np.linalg.solve(N.T @ M @ N, N.T @ M)
        G = B @ np.linalg.lstsq(self.J[self.exact] @ B, self.bends[self.exact] @ qdd, rcond=1e-10)[0]
        dq, dqd = free.dq - free.dtau @ self.stiffness, free.dqd - free.dtau @ self.damping
        return ForwardDerivatives(P @ (dq + G) - G, P @ dqd, P @ free.dtau)


def tied_state(
    scene: Scene | None, chain: Chain, state: LoadedState, tau: Array | float = 0.0, *, moves: bool = True
) -> TiedState | None:
    """The ties of a scene at a posture at rest, under drive torques (n,); None without ties. λ are those of q̈.

    A state with rates, and with `moves` ties that allow no motion, are refused; other errors as in `tie_rows`.
    """
    ties = tie_rows(scene, chain)
    if scene is None or ties is None:
        return None
    q, qd, wrench, follower, free = state
    if qd.any():
        raise ArgumentError("qd: ties is also given, for arms at rest; specify only one", id="both-given")
    rows, t = ties[0], scene.initial.time
    g, J, _ = gaps(ties, chain, q, t)
    λ, k = springs(ties, t, g, np.zeros(len(rows)))
    d = rows["damping"] + rows["dissipation"] * np.abs(λ)
    exact, B = np.isinf(rows["stiffness"]), basis(chain, free)
    A = J[exact] @ B
    torque = load_torque(chain, q, qd, wrench, follower) + elastic_torque(chain, q) + J.T @ λ - tau
    L = factored_mass(chain, q, free)[1]
    A_L, b = (scipy.linalg.solve_triangular(L, part, lower=True) for part in (A.T, B.T @ torque))
    λ[exact] = -np.linalg.lstsq(A_L, b, rcond=1e-9)[0]
    S = np.sqrt(sums_of_squares(np.abs(chain.stiffness) + largest_load_stiffness(chain, qd, wrench), chain, free))
    Z, kept = _allowed(A, np.where(S > 0.0, S, 1.0))
    if moves and not len(kept):
        why = "ties: no motion is left; lock fewer joints, or give a tie a stiffness"
        raise ArgumentError(why, id="nothing-to-move")
    if len(A) and _takes_back(ties, chain, q, t, g, B @ Z @ np.cos(np.arange(len(kept))), B):
        why = "singular posture of exact ties, as of links in one line: only those that act there are counted"
        text = f"{chain.name}: {why}; move the arm off it"
        warnings.warn(Diagnostic(text, "singular-ties"), RuntimeWarning, stacklevel=5)
    return TiedState(ties, J, exact, λ, k, d, bends(ties, chain, q), Z, kept)


def _takes_back(ties: Ties, chain: Chain, q: Array, t: float, g: Array, motion: Array, B: Array) -> bool:
    """Whether exact ties that keep their g take back a small motion that J allows at q, as where links are in line."""
    exact, ahead = np.isinf(ties[0]["stiffness"]), 1e-3 * motion / (np.linalg.norm(motion) or 1.0)
    near = q + ahead
    for _ in range(3):
        now, J, _ = gaps(ties, chain, near, t)
        near = near - B @ np.linalg.lstsq(J[exact] @ B, (now - g)[exact], rcond=1e-5)[0]
    return bool(np.linalg.norm(near - q - ahead) > 0.1 * np.linalg.norm(ahead))


def _allowed(J: Array, S: Array) -> tuple[Array, Indices]:
    """Z (f, m) with J Z = 0, and the coordinates (m,) in which it is the identity; those with small S (f,) depend."""
    r = int(np.linalg.matrix_rank(J, tol=1e-9)) if len(J) else 0
    order = scipy.linalg.qr(J / S, mode="r", pivoting=True)[1] if r else np.arange(len(S))
    first, kept = order[:r], np.sort(order[r:])
    Z = np.eye(len(S))[:, kept]
    Z[first] = -np.linalg.lstsq(J[:, first], J[:, kept])[0]
    return Z, kept


def bends(ties: Ties, chain: Chain, q: Array) -> Array:
    """∂²g/∂q² (r, n, n) of all rows."""
    (R, p), found = poses(chain, q), np.zeros((len(ties[0]), chain.n, chain.n))
    for k, row in enumerate(ties[0]):
        if row["kind"] == KIND.joint:
            continue
        a, b, distance = row["a"], row["b"], row["kind"] == KIND.distance
        apart = p[a] + R[a] @ row["point_a"] - p[b] - R[b] @ row["point_b"]
        far, on_b = float(np.linalg.norm(apart)) or np.inf, row["point_b"] + (0.0 if distance else R[b].T @ apart)
        u = apart / far if distance else R[b] @ row["along"]
        (e_a, v_a), (e_b, v_b) = _moves(chain, q, a, row["point_a"]), _moves(chain, q, b, on_b)
        v = v_a - v_b
        turned = cross(e_b, u) @ v.T  # u turns with body b, or with the points
        own = v @ (np.eye(3) - np.outer(u, u)) @ v.T / far if distance else turned + turned.T
        found[k] = _bend(e_a, v_a, u) - _bend(e_b, v_b, u) + own
    return found


def _moves(chain: Chain, q: Array, body: int, point: Array) -> Array:
    """∂ω/∂q̇ of a body and ∂p/∂q of its point, given in its axes, (2, n, 3); 0 for frame 0."""
    found = np.zeros((2, 3, chain.n))
    if body >= 0:
        jacobian_columns(chain)(int(body), np.array(point), q, found)
    return found[::-1].swapaxes(1, 2)


def _bend(e: Array, v: Array, u: Array) -> Array:
    """u · ∂²p/∂q² (n, n)."""
    H = e @ cross(v, u).T
    return np.asarray(np.triu(H) + np.triu(H, 1).T)


# Equilibrium of an arm with ties: Newton's method for q and the multipliers λ of exact rows, dense.
#
#     T_GC(q) + T_FL(q) + Jᵀ λ = T_EX     on all coordinates that are not held
#     exact rows: g(q) = 0                springs: λ by their law at rest
#
# The matrix is K + Σ k Jᵀ J + Σ λ ∂J/∂q, bordered by J of the exact rows.


def tied_equilibrium(
    ties: Ties, chain: Chain, q: Array, held: Indices, wrench: Array, frame: Frame, t: float, tau: Array | float = 0.0
) -> Array:
    """The equilibrium (n,) near q with these joints held, under a tip wrench (6,), at time t [s] of lengths that move.

    `tau` (n,): drive torques T_EX [N m]. If there is no stable equilibrium near q, it raises a ConvergenceError.
    """
    passes, largest, settled = 200, 0.1, 1e-12  # Newton steps; largest and last change of a coordinate [rad, m]
    start, still = q, np.zeros(chain.n)
    λ = np.zeros(len(ties[0]))
    B = basis(chain, np.setdiff1d(chain.free, held))
    exact, follower = np.isinf(ties[0]["stiffness"]), turns_with_tip(frame)
    for _ in range(passes):
        g, J, _ = gaps(ties, chain, q, t)
        own, slopes = springs(ties, t, g, np.zeros(len(g)))
        λ[~exact] = own[~exact]
        torque = load_torque(chain, q, still, wrench, follower) + elastic_torque(chain, q) + J.T @ λ - tau
        K = stiffness_matrix(chain, q, still, wrench, follower) + J.T @ (slopes[:, None] * J)
        K += np.tensordot(λ, bends(ties, chain, q), 1)
        if not np.isfinite(K).all():
            break
        reduced, border = B.T @ K @ B, J[exact] @ B
        r, f, least = len(border), len(reduced), _least(reduced, border)
        stable = least >= -1e-9 * np.abs(reduced).max(initial=0.0)
        if not stable:  # away from unstable equilibria
            reduced = reduced - 2.0 * least * np.eye(f)
        stiff = np.abs(reduced).max(initial=0.0) or 1.0  # in these units rows near a singular posture are not lost
        matrix = np.block([[reduced / stiff, border.T], [border, np.zeros((r, r))]])
        right = -np.concatenate([B.T @ torque / stiff, g[exact]])
        change = np.linalg.lstsq(matrix, right, rcond=1e-14)[0]
        part = min(1.0, largest / max(np.abs(change[:f]).max(initial=0.0), 1e-300))
        q, λ[exact] = q + part * (B @ change[:f]), λ[exact] + part * stiff * change[f:]
        if stable and np.abs(change[:f]).max(initial=0.0) <= settled * max(1.0, chain.size):
            return np.asarray(q)
    why = f"{chain.name}: no stable equilibrium of the tied arm near its start; start nearer to it, or hold more joints"
    remedy = "a run starts anywhere with initial.passive = 'zero'"
    raise ConvergenceError(f"{why}; {remedy}", q=start, load=0.0, id="no-equilibrium")


def _least(K: Array, J: Array) -> float:
    """Least eigenvalue of K (f, f) on motions that exact rows J (r, f) allow; inf if they allow none."""
    free = np.linalg.svd(J)[2][np.linalg.matrix_rank(J, tol=1e-9) :] if len(J) else np.eye(len(K))
    return float(np.linalg.eigvalsh(free @ (K + K.T) @ free.T / 2.0).min(initial=np.inf))
