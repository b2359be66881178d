"""Compare the terms of the equation of motion in two engines at many states, relative to the rounding bound.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Two correct programs differ by at most 1 bound (`dynamics.rounding`). Accelerations are compared by the torque M Δq̈.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import SingularMassError
from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.dynamics import rounding
from flexlink.dynamics.rounding import in_units
from flexlink.dynamics.singularity import factored_mass
from flexlink.dynamics.terms import elastic_torque, gravity_torque
from flexlink.engines.base import Engine

# States for comparing arms: random, balanced, and stretched out.
#
# Angles [rad] and positions of prismatic joints [m], active and passive, are uniform in (−π, π). If M is not positive
# definite there (negative twist rotors of a lumping rule with `matched_twist`, gimbal lock), the deflection is halved
# until M is positive definite.


RANGE = 10.0  # largest |q̇| [rad/s], |T_EX| of active joints [N m], tip force [N] and moment [N m] of random states
IMBALANCE = 1e-6  # relative difference between T_EX and T_G + T_FL in balanced states
TRIES = 20


class State(NamedTuple):
    """A state with its loads."""

    q: Array
    qd: Array
    tau: Array
    wrench: Array

    def __repr__(self) -> str:
        return f"<State: {plural(len(self.q), 'joint')}>"


def random_states(chain: Chain, samples: int, *, seed: int = 0) -> list[State]:
    """Return independent uniform states: angles in (−π, π); rates, drive torques and tip wrench up to `RANGE`."""
    random = np.random.default_rng(seed)
    return [_random(chain, random) for _ in range(samples)]


def mixed_states(chain: Chain, samples: int, *, seed: int = 0) -> list[State]:
    """Return states: half random, a quarter balanced, an eighth stretched out at rest, an eighth stretched and moving.

    In balanced states the arm is at rest, T_EX = T_G + T_FL within `IMBALANCE`, and all spring torques are similar;
    accelerations are so small that an error of 1e-9 in one spring is visible. In stretched states, springs are relaxed,
    active joints are at multiples of 90°, and there are no loads; the arm hangs, is upright, folded or horizontal.
    """
    random = np.random.default_rng(seed)
    kinds = (_random, _balanced, _random, _stretched, _random, _balanced, _random, _moving)
    return [kinds[k % len(kinds)](chain, random) for k in range(samples)]


def _random(chain: Chain, random: np.random.Generator) -> State:
    q, qd = _regular(chain, _uniform(chain, random)), random.uniform(-RANGE, RANGE, chain.n)
    tau = np.zeros(chain.n)
    tau[chain.active] = random.uniform(-RANGE, RANGE, len(chain.active))
    return State(q, qd, tau, random.uniform(-RANGE, RANGE, 6))


def _balanced(chain: Chain, random: np.random.Generator) -> State:
    k = chain.stiffness
    soft = k.min(where=k > 0, initial=np.inf)
    reach = np.divide(soft, k, out=np.ones(chain.n), where=k > 0)  # deflections with similar spring torques
    q = _regular(chain, (chain.rest + reach * deflection for deflection in _uniform(chain, random)))
    static = gravity_torque(chain, q) + elastic_torque(chain, q)
    return State(q, np.zeros(chain.n), static * (1 + IMBALANCE * random.uniform(-1, 1, chain.n)), np.zeros(6))


def _stretched(chain: Chain, random: np.random.Generator) -> State:
    def candidates() -> Iterator[Array]:
        for _ in range(TRIES):
            q = chain.rest.copy()
            q[chain.active] = random.integers(-1, 3, len(chain.active)) * (np.pi / 2)
            q[chain.slides] = chain.rest[chain.slides]
            yield q
        yield from _uniform(chain, random)

    return State(_regular(chain, candidates()), np.zeros(chain.n), np.zeros(chain.n), np.zeros(6))


def _moving(chain: Chain, random: np.random.Generator) -> State:
    state = _stretched(chain, random)
    state.qd[chain.active] = random.uniform(-RANGE, RANGE, len(chain.active))
    return state


def _uniform(chain: Chain, random: np.random.Generator) -> Iterator[Array]:
    return (random.uniform(-np.pi, np.pi, chain.n) for _ in range(TRIES))


def _regular(chain: Chain, candidates: Iterator[Array]) -> Array:
    """Return the first configuration, with halved deflections if necessary, at which M is positive definite."""
    free = np.arange(chain.n)
    for q in candidates:
        for _ in range(8):
            try:
                factored_mass(chain, q, free)
            except SingularMassError as error:
                reason, passive = error, np.setdiff1d(free, chain.active)
                q[passive] = (q[passive] + chain.rest[passive]) / 2
            else:
                return q
    raise reason


class Term(NamedTuple):
    """Function that evaluates a term, and function that divides the difference of two values by the rounding bound."""

    evaluate: Callable[[Engine, State], Array]
    error: Callable[[Chain, State, Array, Array], Array]


def _bounded(evaluate: Callable[[Engine, State], Array], bound: Callable[[Chain, State], Array | float]) -> Term:
    return Term(evaluate, lambda c, s, one, other: in_units(one - other, bound(c, s)))


QUANTITIES: dict[str, Term] = {
    "M": _bounded(lambda e, s: e.mass_matrix(s.q), lambda c, s: rounding.of_mass_matrix(c, s.q)),
    "T_G": _bounded(lambda e, s: e.gravity_torque(s.q), lambda c, s: rounding.of_bias_torque(c, s.q, np.zeros(c.n))),
    "T_GC": _bounded(lambda e, s: e.bias_torque(s.q, s.qd), lambda c, s: rounding.of_bias_torque(c, s.q, s.qd)),
    "T_GC with tip wrench": _bounded(
        lambda e, s: e.bias_torque(s.q, s.qd, tip_wrench=s.wrench),
        lambda c, s: rounding.of_bias_torque(c, s.q, s.qd, tip_wrench=s.wrench),
    ),
    "T_FL": _bounded(lambda e, s: e.elastic_torque(s.q), lambda c, s: rounding.of_elastic_torque(c, s.q)),
    "T_FR": _bounded(lambda e, s: e.friction_torque(s.qd), lambda c, s: rounding.of_friction_torque(c, s.qd)),
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

    @property
    def rank(self) -> float:
        """The error, infinite if it is nan."""
        return math.inf if math.isnan(self.error) else self.error


def compare_engines(
    chain: Chain, native: Engine, engines: Sequence[Engine], states: Sequence[State], *,
    quantities: Iterable[str] = tuple(QUANTITIES), progress: Callable[[float], None] | None = None,
) -> tuple[Difference, ...]:  # fmt: skip
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
                worst[each, name] = max(worst.get((each, name), new), new, key=lambda one: one.rank)
        if progress is not None and (number + 1) % max(1, len(states) // reports) == 0:
            progress((number + 1) / len(states))
    return tuple(worst[each, name] for each in range(len(engines)) for name in names)
