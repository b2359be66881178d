"""Compare the terms of the equation of motion in two engines at many states, relative to the rounding bound.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Two correct programs differ by at most 1 bound (`dynamics.rounding`). Accelerations are compared by the torque M Δq̈.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.diagnosis.states import State
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import in_units
from flexlink.engines.base import Engine


class Term(NamedTuple):
    """Function that evaluates a term, and function that divides the difference of two values by the rounding bound."""

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
    """Largest difference of a quantity between an engine and the native dynamics.

    Attributes
    ----------
    engine, quantity
        Names of the engine and the quantity.
    error
        Largest error over states and joints, relative to the rounding bound.
    joint
        Name of the joint (for M: of the row) with the largest error.
    worst
        State with the largest error.
    """

    engine: str
    quantity: str
    error: float
    joint: str
    worst: State = dataclasses.field(repr=False, compare=False)

    @property
    def passed(self) -> bool:
        """Whether the error is within the rounding bound; False for nan."""
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
    """Compare the quantities of every engine with the quantities of `native` at the given states."""
    names, reports = list(quantities), 200  # approximate number of calls of `progress`
    worst: dict[tuple[int, str], Difference] = {}
    for number, state in enumerate(states):
        for name in names:
            quantity = QUANTITIES[name]
            expected = quantity.evaluate(native, state)
            for each, engine in enumerate(engines):
                errors = quantity.error(chain, state, quantity.evaluate(engine, state), expected).reshape(chain.n, -1)
                k = int(np.argmax(np.where(np.isnan(errors), np.inf, errors).max(axis=1)))
                new = Difference(engine.name, name, float(errors[k].max()), chain.joint_name(k), state)
                worst[each, name] = max(worst.get((each, name), new), new, key=_rank)
        if progress is not None and (number + 1) % max(1, len(states) // reports) == 0:
            progress((number + 1) / len(states))
    return tuple(worst[each, name] for each in range(len(engines)) for name in names)


def _rank(difference: Difference) -> float:
    """The error of a difference, as a key for sorting in which nan ranks highest."""
    return math.inf if math.isnan(difference.error) else difference.error
