"""Derivatives of the torques about a state, for modal analysis and for Newton's method in statics."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.chain.layout import Joints, spans_of
from flexlink.chain.shapes import shaped_hinges
from flexlink.common.errors import ArgumentError
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.dynamics import rounding
from flexlink.dynamics.forces import about, force_slopes, force_torque, linearised
from flexlink.dynamics.free_motion import DENSE, first_joints, restricted, sums_of_squares
from flexlink.dynamics.placement import slid_apart
from flexlink.dynamics.small_motion import K_ALONE, SmallMotion
from flexlink.dynamics.terms import bias_torque
from flexlink.kernels.derivatives.inverse_derivatives import load_slopes
from flexlink.kernels.geometry.kinematics import forward_kinematics, turned_with_tip


class LoadedState(NamedTuple):
    """The state about which small motion occurs: configuration, steady rates, tip wrench, and the free coordinates."""

    q: Array
    qd: Array
    wrench: Array
    follower: bool  # whether the wrench turns with the tip
    free: NDArray[np.intp]


class Stiffness(NamedTuple):
    """K of the free coordinates, with the data needed to distinguish zero eigenvalues from rounding errors."""

    K: Array  # tangent stiffness [N m/rad], (n, n); for sliding joints N in place of N m, and m in place of rad
    S: Array  # square root of the magnitude of each row's terms, (n,), so K̂ = S⁻¹ K S⁻¹ is of order 1
    conservative: bool  # whether the loads have a potential, that is, K is symmetric up to rounding
    rounding: float  # bound of the rounding error of K̂'s eigenvalues

    @property
    def symmetric(self) -> Array:
        """Symmetric part of K; for conservative loads, the lower triangle mirrored, as its entries sum fewer terms."""
        return np.tril(self.K) + np.tril(self.K, -1).T if self.conservative else (self.K + self.K.T) / 2

    @property
    def scaled(self) -> Array:
        """K̂ computed from the symmetric part of K."""
        return np.asarray(self.symmetric / np.outer(self.S, self.S))

    @property
    def falls(self) -> bool:
        """Whether an eigenvalue of K̂ has a negative real part beyond rounding."""
        if self.conservative:
            return bool((np.linalg.eigvalsh(self.scaled) < -self.rounding).any())
        return bool((np.linalg.eigvals(self.K / np.outer(self.S, self.S)).real < -self.rounding).any())


def unlocked(chain: Chain, locked: Joints) -> NDArray[np.intp]:
    """Sequential indices of the free coordinates, at least one: those that are not `locked`, held or internal."""
    moves, held = ~chain.held, chain.joint_indices("locked", locked)
    if chain.shapes is not None and len(together := np.intersect1d(held, shaped_hinges(chain))):
        why = f"locked: hinge {chain.joint_name(int(together[0]))!r} moves by the shapes of its link"
        raise ArgumentError(f"{why}; lock joints, or set the link rigid", id="locked-shape")
    moves[held] = moves[chain.internal] = False
    free = np.flatnonzero(moves)
    if not len(free):
        why = "no joint is free to move (prescribed joints are not free either); lock fewer joints"
        raise ArgumentError(f"locked = {truncated(locked)}: {why}", id="nothing-to-move")
    return free


def load_torque(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool = False) -> Array:
    """T_GC plus `force_torque`, shape (n,) [N m]; in (relative) equilibrium it equals T_EX − T_FL.

    `wrench` (6,) [N, N m] acts on the tip in axes of frame 0 and keeps its direction there. With `follower` it is given
    in axes of the tip frame and turns with the tip.
    """
    if follower:
        wrench = turned_with_tip(chain.arrays, wrench, q)
    load = bias_torque(chain, q, qd, tip_wrench=wrench)
    return load + force_torque(chain, q, qd) if chain.forces else load


def stiffness_matrix(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool = False) -> Array:
    """K = ∂(T_GC + T_FL + T of force elements)/∂q at constant rates, shape (n, n) [N m/rad], exact up to rounding.

    It is the sum of elastic, gravity, load and centrifugal stiffness, and not symmetric under a follower wrench or a
    spatial moment.
    """
    K = about(chain, q).matrix("stiffness")
    K += load_matrices(chain, q, qd, wrench, follower)[0]
    return K + force_slopes(chain, q, qd)[0] if chain.forces else K


def load_matrices(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool = False) -> Array:
    """∂T_GC/∂q [N m/rad], ∂T_GC/∂q̇ [N m s/rad] and M [kg m²] at constant rates, shape (3, n, n)."""
    found = np.empty((3, chain.n, chain.n))
    load_slopes(chain.arrays, np.array(wrench), follower, q, qd, np.zeros(chain.n), found)
    return found


def tangent(chain: Chain, q: Array, qd: Array, wrench: Array, follower: bool, free: NDArray[np.intp]) -> Stiffness:
    """`stiffness_matrix` of the coordinates `free`, with the magnitudes that bound its rounding error."""
    K = restricted(stiffness_matrix(chain, q, qd, wrench, follower), chain, free)
    load, entry = rounding.largest_load_stiffness(chain, qd, wrench), rounding.of_load_stiffness(chain)
    S = np.sqrt(sums_of_squares(np.abs(linearised(chain, q).stiffness) + load, chain, free))
    S[S == 0] = 1.0  # zero rows
    scale = rounding.scales(chain)[first_joints(chain, free)]
    left, moment = np.abs(K - K.T) * np.outer(scale, scale), sums_of_squares(load, chain, free) * scale**2
    return Stiffness(K, S, bool((left <= entry * np.add.outer(moment, moment)).all()), len(free) * entry)


def falls(chain: Chain, state: LoadedState, motion: SmallMotion | None = None) -> bool:
    """Whether a posture is unstable, in O(n): by signs of pivots if loads have a potential, else by Arnoldi's method.

    `motion` is the small motion of this chain under these loads; its configuration is changed to that of the state.
    """
    q, qd, wrench, follower, free = state
    moment = wrench[3:].any() and not chain.is_planar  # has no potential in space, as a force that turns with the tip
    potential = not (moment or (follower and wrench[:3].any()) or qd.any())
    if chain.shapes is not None or (not potential and len(free) <= DENSE):
        return tangent(chain, *state).falls
    if motion is None:
        motion = SmallMotion(chain, *state)
    else:
        motion.set_position(q)
    square = np.abs(linearised(chain, q).stiffness) + rounding.largest_load_stiffness(chain, qd, wrench)
    square[square == 0] = 1.0
    if potential:
        return motion.falling(K_ALONE, motion.rounding * square) > 0
    least = _least_eigenvalue(motion, np.sqrt(square), free)
    return tangent(chain, *state).falls if np.isnan(least) else least < -motion.rounding


def _least_eigenvalue(motion: SmallMotion, S: Array, free: NDArray[np.intp]) -> float:
    """Smallest real part of the eigenvalues of K̂, most of which are close to 1; nan if the iteration fails."""
    from scipy.sparse.linalg import ArpackError, LinearOperator, eigs  # noqa: PLC0415  0.1 s; only long chains need it

    def times(φ: Array) -> Array:
        x = np.zeros((1, len(S)))
        x[0, free] = φ.ravel() / S[free]
        return np.asarray(motion.times(K_ALONE, x)[0, free] / S[free])

    scaled, first = LinearOperator((len(free),) * 2, times, dtype=np.float64), np.ones(len(free))
    try:
        return float(eigs(scaled, k=1, which="SR", v0=first, tol=1e-6, return_eigenvectors=False)[0].real)
    except ArpackError:
        return np.nan


def gyroscopic_matrix(chain: Chain, q: Array, qd: Array) -> Array:
    """G = ∂(T_GC + T of force elements)/∂q̇, shape (n, n) [N m s/rad]; at rest only gyrators contribute."""
    G = np.zeros((chain.n, chain.n))
    if qd.any():
        G += load_matrices(chain, q, qd, np.zeros(6))[1]
    if chain.forces:
        G += force_slopes(chain, q, qd)[1]
    return G


def displacements(chain: Chain, q: Array, φ: NDArray[np.inexact]) -> NDArray[np.inexact]:
    """Displacements of body origins and tips for small angles φ (m, n), in frame 0, shape (m, bodies, 3) [m].

    Each body turns by the sum of φ_k e_k over the hinges inboard of it, which moves the origins of its child bodies. A
    sliding joint shifts its body by φ_k e_k.
    """
    _, points, axes = forward_kinematics(chain.arrays, q)
    steps, first, stop = φ[:, :, None] * axes, chain.bodies["first"], chain.bodies["stop"]
    slid = slid_apart(chain, steps.swapaxes(0, 1)).swapaxes(0, 1)
    turned, moved, rest = np.zeros_like(slid), np.zeros_like(slid), np.zeros((len(φ), 3))
    for parent, begin, end in spans_of(chain.bodies):
        turn, move, origin = rest, rest, np.zeros(3)
        if parent >= 0:
            turn, move, origin = turned[:, parent], moved[:, parent], points[parent]
        ahead = np.cumsum(np.concatenate([turn[:, None], steps[:, first[begin] : stop[end - 1]]], axis=1), axis=1)
        turned[:, begin:end] = ahead[:, stop[begin:end] - first[begin]]
        before = np.concatenate([turn[:, None], turned[:, begin : end - 1]], axis=1)
        levers = np.diff(points[begin:end], axis=0, prepend=origin[None])
        shifts = cross(before, levers) + slid[:, begin:end]
        moved[:, begin:end] = np.cumsum(np.concatenate([move[:, None], shifts], axis=1), axis=1)[:, 1:]
    return moved
