"""Derivatives of inverse and forward dynamics at a state, exact and O(n²) (see `terms` for shapes and units)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.chain.arguments import beyond_float64, given, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.batches import each, is_batch
from flexlink.kernels.derivatives.forward_derivatives import forward_derivatives
from flexlink.kernels.derivatives.inverse_derivatives import all_inverse_derivatives
from flexlink.kernels.derivatives.planar_derivatives import planar_derivatives

Array = NDArray[np.float64]


class InverseDerivatives(NamedTuple):
    """Slopes of τ = M q̈ + T_GC: row i belongs to τ_i, column j to the coordinate that changes."""

    dq: Array  # ∂τ/∂q, (…, n, n) [N m/rad]
    dqd: Array  # ∂τ/∂q̇, (…, n, n) [N m s/rad]
    dqdd: Array  # ∂τ/∂q̈ = M, (…, n, n) [kg m²]

    def __repr__(self) -> str:
        return f"<InverseDerivatives: {' × '.join(map(str, self.dq.shape))}>"


class ForwardDerivatives(NamedTuple):
    """Slopes of q̈: row i belongs to q̈_i, column j to the coordinate or torque that changes."""

    dq: Array  # ∂q̈/∂q, (…, n, n) [1/s²]
    dqd: Array  # ∂q̈/∂q̇, (…, n, n) [1/s]
    dtau: Array  # ∂q̈/∂T_EX = M⁻¹, (…, n, n) [1/(kg m²)]; in columns of prescribed joints ∂q̈/∂q̈_given [1]

    def __repr__(self) -> str:
        return f"<ForwardDerivatives: {' × '.join(map(str, self.dq.shape))}>"


def inverse_dynamics_derivatives(
    chain: Chain, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> InverseDerivatives:
    """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ = M(q) q̈ + T_GC(q, q̇), `inverse_dynamics`: without springs and friction.

    By recursion, O(n²), without a step size (Carpentier & Mansard 2018; Singh, Russell & Wensing 2022). The tip wrench
    keeps its direction in frame 0.

    Parameters
    ----------
    chain
        The chain.
    q, qd, qdd
        Angles [rad], rates [rad/s] and accelerations [rad/s²], shape (n,), or (b, n) for b states.
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Returns
    -------
    InverseDerivatives
        `dq`, `dqd`, `dqdd`, shape (n, n), or (b, n, n). The last one is M.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a derivative is beyond float64.
    """
    if is_batch(q, qd, qdd):
        state = {"q": q, "qd": qd, "qdd": qdd}
        return each(inverse_dynamics_derivatives, chain, state, tip_wrench=tip_wrench)
    n = given("chain", chain, Chain).n
    q, qd, qdd = vector("q", q, n, many=True), vector("qd", qd, n, many=True), vector("qdd", qdd, n, many=True)
    wrench = wrench_vector(tip_wrench)
    found = np.empty((3, n, n))
    if not all_inverse_derivatives(*chain.arrays, wrench, q, qd, qdd, found):
        raise beyond_float64(_of("torques", chain), q=q, qd=qd, qdd=qdd, tip_wrench=wrench, gravity=chain.gravity)
    return InverseDerivatives(found[0], found[1], found[2])


def forward_dynamics_derivatives(
    chain: Chain, q: ArrayLike, qd: ArrayLike, tau: ArrayLike, *, tip_wrench: ArrayLike | None = None
) -> ForwardDerivatives:
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX of M q̈ = T_EX − T_GC − T_FL − T_FR, `forward_dynamics`.

    ∂q̈/∂(q, q̇) = −M⁻¹ ∂(M q̈ + T_GC + T_FL + T_FR)/∂(q, q̇) at constant q̈, every column by articulated bodies, O(n);
    O(n²) in all. Friction counts with its slope d + c/w sech²(q̇/w) at this rate. Right to 1e-12 of the largest element
    of each, of random arms of 2 to 14 joints to 3e-13; as q̈ itself, off by more where M is almost singular.

    Joints with prescribed motion keep their rate, as in `forward_dynamics`; what moves them is not a torque but an
    acceleration, so that their columns of `dtau` hold ∂q̈/∂q̈_given, 1 at the joint itself.

    Parameters
    ----------
    chain
        The chain.
    q, qd, tau
        Angles [rad], rates [rad/s] and drive torques T_EX [N m], shape (n,), or (b, n) for b states.
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m]; it keeps its direction there.

    Returns
    -------
    ForwardDerivatives
        `dq`, `dqd`, `dtau`, shape (n, n), or (b, n, n).

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not real or not finite, or a derivative is beyond float64.
    SingularMassError
        A joint moves no inertia of its own here.
    """
    if is_batch(q, qd, tau):
        return each(forward_dynamics_derivatives, chain, {"q": q, "qd": qd, "tau": tau}, tip_wrench=tip_wrench)
    n = given("chain", chain, Chain).n
    q, qd = vector("q", q, n, many=True, finite=False), vector("qd", qd, n, many=True, finite=False)
    tau = vector("tau", tau, n, many=True, finite=False)
    wrench = wrench_vector(tip_wrench)
    found, kernel = np.empty((3, n, n)), planar_derivatives if chain.is_planar else forward_derivatives
    if not kernel(*chain.arrays, wrench, q, qd, tau, found):
        forward_dynamics(
            chain, q, qd, tau, tip_wrench=tip_wrench
        )  # raises where a number is not finite, or there is no q̈
        raise beyond_float64(_of("accelerations", chain), q=q, qd=qd, tau=tau, tip_wrench=wrench, gravity=chain.gravity)
    return ForwardDerivatives(found[0], found[1], found[2])  # twice as fast as `*found`


def _of(what: str, chain: Chain) -> str:
    return f"a derivative of the {what} of {chain.name!r}"
