"""States at which arms are compared: at random, balanced, and stretched out.

Passive hinges are drawn over (−π, π) like the active joints, but only as far as the chain can take it: where M is not
positive definite (negative twist rotors of a lumping rule with `matched_twist`, gimbal lock) they are bent half as
far, and again, until it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.errors import SingularMassError
from flexlink.dynamics.terms import elastic_torque, gravity_torque
from flexlink.dynamics.vibration.modal import regular_mass

Array = NDArray[np.float64]

RATE, TORQUE, WRENCH = 10.0, 10.0, 10.0
"""Ranges of the random states: |q̇| [rad/s], |T_EX| on active joints [N m], tip force and moment [N, N m]."""
BALANCE = 1e-6
"""How far T_EX is from T_G + T_FL in balanced states, relative."""
TRIES, HALVINGS = 20, 8


class State(NamedTuple):
    """A state with its loads."""

    q: Array
    qd: Array
    tau: Array
    wrench: Array

    def __repr__(self) -> str:
        return f"<State: {len(self.q)} joints>"


def random_states(chain: Chain, samples: int, *, seed: int = 0) -> list[State]:
    """Independent uniform states: angles over (−π, π), rates, drive torques and wrench up to the ranges above.

    Raises
    ------
    SingularMassError
        M is positive definite at none of the postures tried.
    """
    random = np.random.default_rng(seed)
    return [_at_random(chain, random) for _ in range(samples)]


def mixed_states(chain: Chain, samples: int, *, seed: int = 0) -> list[State]:
    """Half at random, a quarter balanced, an eighth stretched out at rest and an eighth stretched out with rates.

    Balanced: T_EX = T_G + T_FL within `BALANCE` at every joint, at rest, every spring loaded alike; what is left to
    accelerate is so small that an error of 1e-9 in one spring shows. Stretched out: springs slack, active joints at
    multiples of 90°, no loads, so that arms hang, stand, fold back or reach out, and most terms cancel.

    Raises
    ------
    SingularMassError
        M is positive definite at none of the postures tried.
    """
    random = np.random.default_rng(seed)
    kinds = (_at_random, _balanced, _at_random, _stretched, _at_random, _balanced, _at_random, _whirling)
    return [kinds[k % len(kinds)](chain, random) for k in range(samples)]


def _at_random(chain: Chain, random: np.random.Generator) -> State:
    q, qd = _regular(chain, _anywhere(chain, random)), random.uniform(-RATE, RATE, chain.n)
    tau = np.zeros(chain.n)
    tau[chain.active] = random.uniform(-TORQUE, TORQUE, len(chain.active))
    return State(q, qd, tau, random.uniform(-WRENCH, WRENCH, 6))


def _balanced(chain: Chain, random: np.random.Generator) -> State:
    k = chain.stiffness
    soft = k.min(where=k > 0, initial=np.inf)
    reach = np.divide(soft, k, out=np.ones(chain.n), where=k > 0)  # springs are loaded alike: none drowns the others
    q = _regular(chain, (chain.rest + reach * draw for draw in _anywhere(chain, random)))
    held = gravity_torque(chain, q) + elastic_torque(chain, q)
    return State(q, np.zeros(chain.n), held * (1 + BALANCE * random.uniform(-1, 1, chain.n)), np.zeros(6))


def _stretched(chain: Chain, random: np.random.Generator) -> State:
    def draws() -> Iterator[Array]:
        for _ in range(TRIES):
            q = chain.rest.copy()
            q[chain.active] = random.integers(-1, 3, len(chain.active)) * (np.pi / 2)
            yield q
        yield from _anywhere(chain, random)

    return State(_regular(chain, draws()), np.zeros(chain.n), np.zeros(chain.n), np.zeros(6))


def _whirling(chain: Chain, random: np.random.Generator) -> State:
    state = _stretched(chain, random)
    state.qd[chain.active] = random.uniform(-RATE, RATE, len(chain.active))
    return state


def _anywhere(chain: Chain, random: np.random.Generator) -> Iterator[Array]:
    return (random.uniform(-np.pi, np.pi, chain.n) for _ in range(TRIES))


def _regular(chain: Chain, draws: Iterator[Array]) -> Array:
    """The first of the postures, its passive hinges bent less if need be, at which M is positive definite."""
    free, passive = np.arange(chain.n), np.setdiff1d(np.arange(chain.n), chain.active)
    for q in draws:
        for _ in range(HALVINGS):
            try:
                regular_mass(chain, q, free)
            except SingularMassError as error:
                reason = error
                q[passive] = (q[passive] + chain.rest[passive]) / 2
            else:
                return q
    raise reason
