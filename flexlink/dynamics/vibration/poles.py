"""Poles of an arm under PD control of its joints, to which input shapers are tuned."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import require_type, vector, wrench_vector
from flexlink.chain.chain import Chain
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array, Complex
from flexlink.dynamics.tangent import load_torque
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.vibration.linear import linearize


def pd_poles(
    chain: Chain, q: ArrayLike, *, kp: ArrayLike, kd: ArrayLike, tip_wrench: ArrayLike | None = None
) -> Complex:
    """Poles of an arm at rest with its driven joints under T_EX = kp (target − q) − kd q̇ + holding torque.

    They are eigenvalues of A − B (kp, kd) with A and B from `linearize`, in a state where all torques balance. A
    reference filtered by an input shaper for the slowest poles, `InputShaper.at(pd_poles(…)[:2])`, excites almost no
    vibration.

    Parameters
    ----------
    chain
        The chain. Joints with prescribed motion are held.
    q
        Angles [rad], shape (n,), of the arm bent under gravity, as returned by `solve_static`.
    kp, kd
        Gains [N m/rad] and [N m s/rad], ≥ 0: one number for all driven joints, or one per joint, shape (d,).
    tip_wrench
        Force and moment on the tip, frame 0, shape (6,) [N, N m].

    Returns
    -------
    Array
        Complex poles λ = −σ + iω_d with ω_d > 0 [1/s], sorted by |λ|; conjugates and aperiodic poles are left out.

    Raises
    ------
    ArgumentError
        An argument has the wrong shape, is not finite, or is negative.
    SingularMassError
        A joint has no inertia attached in this configuration.

    Examples
    --------
    >>> slow = fl.small_motion.pd_poles(chain, q, kp=(2e4, 1e4), kd=(600.0, 250.0))
    >>> print((abs(slow[:2]) / (2 * np.pi)).round(2))  # Hz
    [ 4.28 26.51]
    """
    n = require_type("chain", chain, Chain).n
    driven = chain.active
    q, wrench = vector("q", q, n), wrench_vector(tip_wrench)
    balance = load_torque(chain, q, np.zeros(n), wrench) + elastic_torque(chain, q)
    model = linearize(chain, q, tau=balance, tip_wrench=wrench, outputs=("state",))
    moving = ~chain.held[driven]
    B, picked = model.B[:, moving], np.eye(n)[driven[moving]]
    gains = [_gains(name, value, len(driven))[moving, None] * picked for name, value in (("kp", kp), ("kd", kd))]
    poles = np.linalg.eigvals(model.A - B @ (np.hstack(gains) @ model.C))
    vibrations = poles[poles.imag > 0]
    return np.asarray(vibrations[np.argsort(np.abs(vibrations), kind="stable")], dtype=np.complex128)


def _gains(name: str, value: ArrayLike, size: int) -> Array:
    gains = vector(name, np.broadcast_to(value, (size,)) if np.ndim(value) == 0 else value, size)
    if np.any(gains < 0):
        raise ArgumentError(f"{name}[{np.argmin(gains)}] = {gains.min()!r}: must be >= 0", id="out-of-range")
    return gains
