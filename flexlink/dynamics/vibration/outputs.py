"""Outputs of a linear model: derivatives of positions, rates and sensor signals with respect to state and torques."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.dynamics.filters import LinearFilter, linear_filter
from flexlink.dynamics.placement import jacobian, tip_position


class Output(NamedTuple):
    """Outputs y = gain · s + bias of signals s, with their derivatives; filters and a delay may follow."""

    names: tuple[str, ...]
    signal: Array  # (p,) s
    q: Array  # (p, n) ∂s/∂q
    qd: Array  # (p, n) ∂s/∂q̇
    qdd: Array | None = None  # (p, n) ∂s/∂q̈; None: zero
    tau: Array | None = None  # (p, n) ∂s/∂T_EX; None: zero
    gain: float = 1.0
    bias: float = 0.0
    filter: LinearFilter = linear_filter(())
    delay: float = 0.0  # [s]

    @property
    def values(self) -> Array:
        """Outputs y (p,) for constant signals."""
        return self.gain * self.filter.gain * self.signal + self.bias


class OutputSource(Protocol):
    """An object that provides outputs, such as the sensors of a scene."""

    def outputs(self, chain: Chain, q: Array, qd: Array, qdd: Array, tau: Array) -> Sequence[Output]:
        """Return its outputs at a state (n,)."""


def joints_as(chain: Chain, joints: Sequence[int] | NDArray[np.intp], pattern: str) -> tuple[str, ...]:
    """Names of joints with their units, by a pattern such as "q {} [{}]"."""
    return tuple(pattern.format(chain.joint_name(int(k)), chain.joint_units[k]) for k in joints)


def _tip(chain: Chain, q: Array, qd: Array) -> Output:
    J = jacobian(chain, q).linear
    return Output(tuple(f"tip {axis} [m]" for axis in "xyz"), tip_position(chain, q), J, np.zeros_like(J))


def _tip_rate(chain: Chain, q: Array, qd: Array) -> Output:
    """v = Σ_k q̇_k J_k; a rotation about hinge j turns the terms k ≥ j, and moves the tip in the terms k < j.

    ∂v/∂q_j = e_j × Σ_{k ≥ j} q̇_k J_k + Σ_{k < j} q̇_k e_k × J_j
    """
    tip = jacobian(chain, q)
    J, e = tip.linear, tip.angular
    turning, moving = e * qd, J * qd
    before = np.cumsum(turning, axis=1) - turning
    beyond = np.cumsum(moving[:, ::-1], axis=1)[:, ::-1]
    slope = np.cross(e, beyond, axis=0) + np.cross(before, J, axis=0)
    return Output(tuple(f"tip rate {axis} [m/s]" for axis in "xyz"), J @ qd, slope, J)


def _joints(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return Output(joints_as(chain, chain.active, "q {} [{}]"), q[chain.active], pick, np.zeros_like(pick))


def _joint_rates(chain: Chain, q: Array, qd: Array) -> Output:
    pick = np.eye(chain.n)[chain.active]
    return Output(joints_as(chain, chain.active, "qd {} [{}/s]"), qd[chain.active], np.zeros_like(pick), pick)


def _state(chain: Chain, q: Array, qd: Array) -> Output:
    every, unit = range(chain.n), np.eye(2 * chain.n)
    names = joints_as(chain, every, "q {} [{}]") + joints_as(chain, every, "qd {} [{}/s]")
    return Output(names, np.concatenate([q, qd]), unit[:, : chain.n], unit[:, chain.n :])


OUTPUTS: dict[str, Callable[[Chain, Array, Array], Output]] = {
    "tip": _tip, "tip_rate": _tip_rate, "joints": _joints, "joint_rates": _joint_rates, "state": _state,
}  # fmt: skip
