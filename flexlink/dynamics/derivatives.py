"""Exact derivatives of inverse and forward dynamics at a state, in O(n²) (see `terms` for shapes and units)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import NO_WRENCH, beyond_float64, require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.describe.actions import Frame
from flexlink.dynamics.accelerations import forward_dynamics, lanes_workspace, solver_for
from flexlink.dynamics.batches import each, is_batch, rows, wrench_rows
from flexlink.dynamics.bound import Bound, bound
from flexlink.dynamics.forces import about, force_slopes, turns_with_tip, world_wrench
from flexlink.dynamics.free_motion import basis
from flexlink.dynamics.result import Result
from flexlink.dynamics.tangent import stiffness_matrix
from flexlink.kernels.derivatives.forward_derivatives import forward_derivatives_workspace
from flexlink.kernels.derivatives.inverse_derivatives import derivatives_workspace
from flexlink.kernels.derivatives.of_states import derivatives, forward_derivatives_of_many, inverse_derivatives_of_many
from flexlink.kernels.derivatives.planar_derivatives import planar_derivatives_of_many, planar_derivatives_workspace
from flexlink.kernels.tools.address import bind


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class InverseDerivatives(Result):
    """Derivatives of τ = M q̈ + T_GC: row i belongs to τ_i, column j to the coordinate that changes."""

    dq: Array  # ∂τ/∂q, (…, n, n) [N m/rad]
    dqd: Array  # ∂τ/∂q̇, (…, n, n) [N m s/rad]
    dqdd: Array  # ∂τ/∂q̈ = M, (…, n, n) [kg m²]

    def __repr__(self) -> str:
        return f"<InverseDerivatives: {' × '.join(map(str, self.dq.shape))}>"


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class ForwardDerivatives(Result):
    """Derivatives of q̈: row i belongs to q̈_i, column j to the coordinate or torque that changes."""

    dq: Array  # ∂q̈/∂q, (…, n, n) [1/s²]
    dqd: Array  # ∂q̈/∂q̇, (…, n, n) [1/s]
    dtau: Array  # ∂q̈/∂T_EX = M⁻¹, (…, n, n) [1/(kg m²)]; in columns of prescribed joints ∂q̈/∂q̈_given [1]

    def __repr__(self) -> str:
        return f"<ForwardDerivatives: {' × '.join(map(str, self.dq.shape))}>"


def inverse_dynamics_derivatives(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
) -> InverseDerivatives:  # fmt: skip
    """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of `inverse_dynamics`, τ = M(q) q̈ + T_GC(q, q̇), without springs and friction.

    Found by an O(n²) recursion, without finite differences (Carpentier & Mansard 2018; Singh, Russell & Wensing 2022).

    Parameters
    ----------
    chain, q, qd, qdd
        The chain; angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", where their direction is
        constant, or of the "tip" frame, with which they turn.

    Returns
    -------
    InverseDerivatives
        `dq`, `dqd`, `dqdd`, shape (n, n), or (b, n, n); `dqdd` is M.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a derivative is beyond float64.

    Examples
    --------
    >>> slopes = fl.inverse_dynamics_derivatives(chain, q, qd, qdd)
    >>> print(slopes.dq[0, 0].round(2))  # N m/rad: change of the holding torque with the first angle
    -9.3
    """
    if type(chain) is Chain and tip_wrench is None and type(frame) is str and frame == "world":
        found = np.empty((3, chain.n, chain.n))
        if inverse_derivatives(chain)(NO_WRENCH, q, qd, qdd, found):
            found.setflags(write=False)  # also makes its parts read-only
            return InverseDerivatives.of_read_only(dq=found[0], dqd=found[1], dqdd=found[2])
    if is_batch(q, qd, qdd):
        state = {"q": q, "qd": qd, "qdd": qdd}
        write = functools.partial(inverse_derivatives_of_many, require_type("chain", chain, Chain).arrays)
        many = _of_many(write, chain.n, state, tip_wrench, frame)
        if many is None:
            return each(inverse_dynamics_derivatives, chain, state, tip_wrench=tip_wrench, frame=frame)
        return InverseDerivatives(*many)
    n = require_type("chain", chain, Chain).n
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    wrench = world_wrench(chain, q, tip_wrench, frame)
    found = np.empty((3, n, n))
    if not inverse_derivatives(chain)(wrench, q, qd, qdd, found):
        what = f"a derivative of the torques of {chain.name!r}"
        raise beyond_float64(what, q=q, qd=qd, qdd=qdd, tip_wrench=wrench, gravity=chain.gravity)
    if frame == "tip":
        found[0] += _of_turning(chain, q, qd, wrench, tip_wrench)
    found.setflags(write=False)
    return InverseDerivatives(found[0], found[1], found[2])


def forward_dynamics_derivatives(
    chain: Chain, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None,
    frame: Frame = "world",
) -> ForwardDerivatives:  # fmt: skip
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX of `forward_dynamics`, M q̈ = T_EX − T_GC − T_FL − T_FR − T_DRAG.

    ∂q̈/∂(q, q̇) = −M⁻¹ ∂(M q̈ + T_GC + T_FL + T_FR + T_DRAG)/∂(q, q̇) at constant q̈. The articulated-body algorithm
    takes O(n) per column, so O(n²) for all. Friction enters with its derivative d + c/w sech²(q̇/w) at the given rate.
    The error is below 1e-12 times each matrix's largest element (3e-13 measured, random arms of 2 to 14 joints). Like
    the error of q̈, it is larger if M is almost singular.

    Joints with prescribed motion have constant rates, as in `forward_dynamics`. Their input is an acceleration, not a
    torque, so their columns of `dtau` contain ∂q̈/∂q̈_given, with 1 for the joint itself.

    Parameters
    ----------
    chain, q, qd, tau
        The chain; angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,), or (b, n) for b states.
    tip_wrench, frame
        Force and moment on the tip, shape (6,) [N, N m], in axes of frame 0, "world", where their direction is
        constant, or of the "tip" frame, with which they turn.

    Returns
    -------
    ForwardDerivatives
        `dq`, `dqd`, `dtau`, shape (n, n), or (b, n, n).

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a derivative is beyond float64.
    SingularMassError
        A joint has no inertia attached in this configuration.

    Examples
    --------
    >>> slopes = fl.forward_dynamics_derivatives(chain, q, qd, tau)
    >>> M = fl.mass_matrix(chain, q)
    >>> print(slopes.dq.shape, np.allclose(slopes.dtau @ M, np.eye(chain.n)))
    (6, 6) True
    """
    if type(chain) is Chain and chain.shapes is None and tip_wrench is None and type(frame) is str and frame == "world":
        found = np.empty((3, chain.n, chain.n))
        if forward_derivatives(chain)(NO_WRENCH, q, qd, tau, found):
            found.setflags(write=False)  # also makes its parts read-only
            return ForwardDerivatives.of_read_only(dq=found[0], dqd=found[1], dtau=found[2])
    if is_batch(q, qd, tau):
        state, many = {"q": q, "qd": qd, "tau": tau}, None
        if not require_type("chain", chain, Chain).forces and chain.shapes is None:
            write = functools.partial(forward_derivatives_of_many, chain.arrays)
            if chain.is_planar:
                work = lanes_workspace(solver_for(chain, "articulated"), [chain])
                write = functools.partial(planar_derivatives_of_many, chain.arrays, work)
            many = _of_many(write, chain.n, state, tip_wrench, frame)
        if many is None:
            return each(forward_dynamics_derivatives, chain, state, tip_wrench=tip_wrench, frame=frame)
        return ForwardDerivatives(*many)
    n = require_type("chain", chain, Chain).n
    q, qd = vector("q", q, n, many=True, finite=False), vector("qd", qd, n, many=True, finite=False)
    tau = vector("tau", tau, n, many=True, finite=False)
    wrench = world_wrench(chain, q, tip_wrench, frame)
    found = np.empty((3, n, n))
    if chain.shapes is not None:
        written = _shaped_derivatives(chain, wrench, q, qd, tau, found)
    else:
        written = forward_derivatives(chain)(wrench, q, qd, tau, found)
    if not written:
        forward_dynamics(chain, q, qd, tau, tip_wrench=tip_wrench, frame=frame)  # raises an error if q̈ does not exist
        what = f"a derivative of the accelerations of {chain.name!r}"
        raise beyond_float64(what, q=q, qd=qd, tau=tau, tip_wrench=wrench, gravity=chain.gravity)
    if frame == "tip":
        free = chain.free
        found[0] -= found[2][:, free] @ _of_turning(chain, q, qd, wrench, tip_wrench)[free]
    found.setflags(write=False)
    return ForwardDerivatives(found[0], found[1], found[2])


@bound
def inverse_derivatives(chain: Chain) -> Bound:
    """Derivatives of a chain's inverse dynamics, a function of (wrench, q, qd, qdd, found)."""
    return derivatives_by(chain, derivatives_workspace(chain.arrays))


@bound
def forward_derivatives(chain: Chain) -> Bound:
    """Derivatives of a chain's forward dynamics, a function of (wrench, q, qd, tau, found)."""
    arrays = chain.arrays
    work = planar_derivatives_workspace(arrays) if chain.is_planar else forward_derivatives_workspace(arrays)
    return derivatives_by(chain, work)


def derivatives_by(chain: Chain, work: Any) -> Bound:
    """The derivatives that the type of the scratch `work` selects."""
    n = chain.n
    return bind(derivatives, (chain.arrays, work), np.zeros(6), *np.zeros((3, n)), np.zeros((3, n, n)))


def _shaped_derivatives(chain: Chain, wrench: Array, q: Array, qd: Array, tau: Array, found: Array) -> bool:
    """Write the derivatives of q̈ = B z̈ with Bᵀ M B z̈ = Bᵀ (…), (3, n, n); returns whether they are finite.

    At constant q̈, −B (Bᵀ M B)⁻¹ Bᵀ times the derivatives of M q̈ + T_GC + T_FL + T_FR + T_DRAG.
    """
    free, given = (np.flatnonzero(chain.held == given) for given in (False, True))
    if not inverse_derivatives(chain)(wrench, q, qd, forward_dynamics(chain, q, qd, tau, tip_wrench=wrench), found):
        return False
    by_q, by_qd, M = found.copy()
    width = chain.hinges["coulomb_width"]
    slope = chain.hinges["coulomb"] / width * (1.0 - np.tanh(qd / width) ** 2)
    by_q += about(chain, q).matrix("stiffness")
    by_qd += chain.matrix("damping") + np.diag(slope)
    if chain.forces:
        of_angle, of_rate = force_slopes(chain, q, qd)
        by_q, by_qd = by_q + of_angle, by_qd + of_rate
    B = basis(chain, free)
    P = B @ np.linalg.solve(B.T @ M @ B, B.T)
    found[0], found[1], found[2] = -P @ by_q, -P @ by_qd, P
    found[2][:, given] = np.eye(chain.n)[:, given] - P @ M[:, given]
    return bool(np.isfinite(found).all())


def _of_many(
    write: Callable[..., bool], n: int, state: dict[str, ArrayLike], tip_wrench: ArrayLike | None, frame: Frame
) -> Array | None:
    """Derivatives at b states, (3, b, n, n); None if one is not finite, or if the wrench turns with the tip."""
    many = [part.copy() for part in rows(n, state)]
    found = np.empty((3, len(many[0]), n, n))
    if turns_with_tip(frame) or not write(wrench_rows(tip_wrench, len(many[0])), *many, found):
        return None
    return found


def _of_turning(chain: Chain, q: Array, qd: Array, wrench: Array, tip_wrench: ArrayLike | None) -> Array:
    """Contribution to ∂T_GC/∂q of a wrench that turns with the tip, shape (n, n); `wrench` is in frame 0."""
    along_tip = stiffness_matrix(chain, q, qd, wrench_vector(tip_wrench), True)
    return along_tip - stiffness_matrix(chain, q, qd, wrench, False)
