"""The terms of the equation of motion, engine against engine at many states, in units of what rounding explains.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

So 1 is the most that two right programs may differ by (`dynamics.rounding`). Accelerations are compared as the torques
M Δq̈ that the difference stands for.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.diagnosis.states import State
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import in_units
from flexlink.engines.base import Engine

Array = NDArray[np.float64]

PIECES = 200  # progress is reported about this often


class Term(NamedTuple):
    """How one term of the equation of motion is evaluated, and two values compared: (n,) or (n, n), 1 is allowed."""

    evaluate: Callable[[Engine, State], Array]
    error: Callable[[Chain, State, Array, Array], Array]


QUANTITIES: dict[str, Term] = {
    "M": Term(
        lambda e, s: e.mass_matrix(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_mass_matrix(c, s.q)),
    ),
    "T_G": Term(
        lambda e, s: e.gravity_torque(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, np.zeros(c.n))),
    ),
    "T_GC": Term(
        lambda e, s: e.bias_torque(s.q, s.qd),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, s.qd)),
    ),
    "T_GC with tip wrench": Term(
        lambda e, s: e.bias_torque(s.q, s.qd, tip_wrench=s.wrench),
        lambda c, s, one, other: in_units(one - other, rounding.of_bias_torque(c, s.q, s.qd, tip_wrench=s.wrench)),
    ),
    "T_FL": Term(
        lambda e, s: e.elastic_torque(s.q),
        lambda c, s, one, other: in_units(one - other, rounding.of_elastic_torque(c, s.q)),
    ),
    "T_FR": Term(
        lambda e, s: e.friction_torque(s.qd),
        lambda c, s, one, other: in_units(one - other, rounding.of_friction_torque(c, s.qd)),
    ),
    "q̈": Term(
        lambda e, s: e.forward_dynamics(s.q, s.qd, s.tau, tip_wrench=s.wrench),
        lambda c, s, one, other: rounding.acceleration_error(
            c, s.q, s.qd, s.tau, solutions=(one, other), tip_wrench=s.wrench
        ),
    ),
}


@dataclasses.dataclass(frozen=True)
class Difference:
    """Largest difference of one quantity between one engine and the native dynamics.

    Attributes
    ----------
    engine, quantity
        What was compared.
    error
        Largest error over the states and joints, in units of what rounding explains.
    joint
        Name of the joint (of M: of the row) where it is largest.
    worst
        The state with the largest error.
    """

    engine: str
    quantity: str
    error: float
    joint: str
    worst: State = dataclasses.field(repr=False)

    @property
    def passed(self) -> bool:
        """Rounding explains the error (never nan)."""
        return self.error <= 1


def compare_engines(
    chain: Chain,
    native: Engine,
    engines: Sequence[Engine],
    states: Sequence[State],
    *,
    quantities: Iterable[str] = tuple(QUANTITIES),
    progress: Callable[[float], None] | None = None,
) -> tuple[Difference, ...]:
    """Quantities of every engine against `native` at the given states."""
    names = list(quantities)
    worst: dict[tuple[int, str], _Worst] = {}
    for number, state in enumerate(states):
        for name in names:
            quantity = QUANTITIES[name]
            expected = quantity.evaluate(native, state)
            for each, engine in enumerate(engines):
                error = quantity.error(chain, state, quantity.evaluate(engine, state), expected)
                found = _largest(error.reshape(chain.n, -1), state)
                worst[each, name] = max(worst.get((each, name), found), found, key=lambda one: one.rank)
        if progress is not None and (number + 1) % max(1, len(states) // PIECES) == 0:
            progress((number + 1) / len(states))
    return tuple(
        Difference(engine.name, name, w.error, chain.joint_name(w.k), w.state)
        for each, engine in enumerate(engines)
        for name in names
        for w in (worst[each, name],)
    )


class _Worst(NamedTuple):
    error: float
    k: int
    state: State

    @property
    def rank(self) -> float:
        """Numbers that are not finite are the worst of all."""
        return math.inf if math.isnan(self.error) else self.error


def _largest(error: Array, state: State) -> _Worst:
    """Of (n, …) errors, with its row."""
    rows = np.where(np.isnan(error), np.inf, error).max(axis=1)
    k = int(np.argmax(rows))
    return _Worst(float(error[k].max()), k, state)
