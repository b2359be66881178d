"""Compare the terms of the equation of motion in two engines at many states, relative to the rounding bound.

    M(q) q̈ + T_GC(q, q̇) + T_FL(q) + T_FR(q̇) = T_EX

Two correct programs differ by at most 1 bound (`dynamics.rounding`). Accelerations are compared by the torque M Δq̈.

With rounding errors ρ of torques and σ of g̈, mostly of flexlink's J̇ q̇ (`tied_motion`), exact ties have

    M δq̈ = (1 − P) ρ + K σ        Jᵀ δλ = P ρ − K σ        K = Jᵀ (J M⁻¹ Jᵀ)⁺,  P = K J M⁻¹
"""

import contextlib
import dataclasses
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, cast

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError, SingularMassError
from flexlink.common.memo import keep_last
from flexlink.common.types import Array, Indices
from flexlink.common.wording import plural
from flexlink.describe.scene import Scene
from flexlink.dynamics import rounding
from flexlink.dynamics.accelerations import forward_dynamics
from flexlink.dynamics.rounding import in_units
from flexlink.dynamics.singularity import factored_mass
from flexlink.dynamics.terms import elastic_torque, gravity_torque, mass_matrix
from flexlink.dynamics.tied_motion import rods_of, tied_acceleration
from flexlink.dynamics.ties import Ties, closed, gaps, number_of_rows, poses, springs, tie_rows
from flexlink.engines.base import Engine, Tied
from flexlink.motion.inputs.initial_state import initial_state

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
    t: float = 0.0  # of ties whose lengths move

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
    names: Sequence[str] = ()  # of the values, if they are not of joints


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


def _closed(ties: Ties, chain: Chain, start: State, state: State) -> State:
    """The state with ties closed; if that is singular, or a piston out of its cylinder, halfway to the start, …."""
    exact, last = np.isinf(ties[0]["stiffness"]), max(ties[1].knots, default=0.0)
    for share in 0.5 ** np.arange(9.0):
        t = start.t + share * last
        with contextlib.suppress(FlexlinkError), warnings.catch_warnings(action="ignore"):  # that joints move
            q, qd = closed(ties, chain, start.q + share * (state.q - start.q), state.qd, t)
            factored_mass(chain, q, np.arange(chain.n))
            g, J, _ = gaps(ties, chain, q, t)
            sizes, λ = np.linalg.svd(J[exact])[1] / chain.size, springs(ties, t, g, 0 * g)[0]
            if np.isfinite(λ).all() and not ((sizes > 1e-12) & (sizes < 1e-3)).any():
                return state._replace(q=q, qd=qd, t=t)
    return start


def with_ties(scene: Scene, chain: Chain, states: Sequence[State]) -> tuple[list[State], dict[str, Term]]:
    """The states with ties closed, and quantities: also q̈ with ties, their torques, and ġ and g or λ of all rows."""
    ties = cast(Ties, tie_rows(scene, chain))
    ours = keep_last(1)(partial(_of_ties, ties, rods_of(scene, chain), chain.without_forces()))  # as in files
    start = State(*initial_state(scene, chain), np.zeros(chain.n), np.zeros(6), scene.initial.time)

    def term(k: int) -> Term:
        def evaluate(engine: Any, s: State) -> Array:
            free = QUANTITIES["q̈"].evaluate(engine, s)
            found: Tied = ours(s)[0] if engine.name == "native" else engine.tied(s.t, s.q, s.qd, free)
            return mass_matrix(chain, s.q) @ found[0] if k == 0 else found[k]

        return _bounded(evaluate, lambda _, s: ours(s)[1][k])

    rows = [f"tie {tie.name}" for tie in scene.ties for _ in range(number_of_rows(tie))]
    terms = {"q̈ with ties": term(0), "torques of ties": term(1), "g, ġ, λ of ties": term(2)._replace(names=rows)}
    return [_closed(ties, chain, start, state) for state in states], QUANTITIES | terms


def _of_ties(ties: Ties, rods: tuple[Indices, Array], chain: Chain, s: State) -> tuple[Tied, Tied]:
    """What ties do by flexlink, whose J̇ q̇ is a difference over 2e-5 / `fastest`; and rounding errors, of M q̈ for q̈."""
    rows, exact, (R, p) = ties[0], np.isinf(ties[0]["stiffness"]), poses(chain, s.q)
    free, (g, J, moves) = forward_dynamics(chain, s.q, s.qd, s.tau, tip_wrench=s.wrench), gaps(ties, chain, s.q, s.t)
    (qdd, λ), M = tied_acceleration(ties, chain, s.t, s.q, s.qd, free), mass_matrix(chain, s.q)
    reach = chain.size + sum(np.abs(x).max() for x in (p, rows["point_a"], rows["point_b"]))
    ends = p[rods[0] - 1] + np.einsum("kij,kj->ki", R[rods[0] - 1], rods[1])
    far = np.linalg.norm(ends[::2] - ends[1::2], axis=1).min(initial=reach)
    turn, δ, fastest = reach / far, np.sqrt(chain.n) * rounding.of_reach(reach), max(np.abs(s.qd).max(), 1e-300)
    rate, gd = turn * np.abs(s.qd).sum(), J @ s.qd + moves  # of a direction, ġ
    σ = δ * (turn * np.abs(qdd).sum() + 1e5 * rate * fastest) + 2e-11 * reach * (rate**2 / fastest) ** 2
    less, more = (springs(ties, s.t, g + x, gd + x * rate)[0] for x in (-δ, δ))
    press = more - less + 1e-14 * (np.abs(λ) + (np.abs(rows["areas"]) * rows["pressures"]).sum(axis=1))
    ρ = rounding.of_residual(chain, s.q, s.qd, np.abs(free) + np.abs(qdd), s.tau, tip_wrench=s.wrench)
    ρ = ρ + np.abs(J).T @ press + δ * turn * np.abs(λ).sum()
    Y = np.linalg.solve(M, J[exact].T)
    K = J[exact].T @ np.linalg.pinv(J[exact] @ Y, rcond=1e-10)  # as flexlink's multipliers
    P, both = K @ Y.T, ρ + np.abs(K).sum(axis=1) * σ
    of_rows = np.stack([np.where(exact, δ, press), np.full(len(rows), δ * rate)], axis=1)
    errors = both + np.abs(np.eye(chain.n) - P) @ ρ, both + np.abs(P) @ ρ, of_rows
    return (qdd, J.T @ λ, np.stack([np.where(exact, g, λ), gd], axis=1)), errors


@dataclasses.dataclass(frozen=True)
class Difference:
    """Largest difference of a quantity between an engine and the native dynamics."""

    engine: str
    quantity: str
    error: float  # largest one over states and joints, relative to the rounding bound
    joint: str  # joint with this error, for M of the row; or its tie
    worst: State = dataclasses.field(repr=False, compare=False)  # state with this error

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
    quantities: Mapping[str, Term] = QUANTITIES, progress: Callable[[float], None] | None = None,
) -> tuple[Difference, ...]:  # fmt: skip
    """Compare the quantities of every engine with the quantities of `native` at the given states."""
    worst: dict[tuple[int, str], Difference] = {}
    for number, state in enumerate(states):
        for name, quantity in quantities.items():
            expected = quantity.evaluate(native, state)
            for each, engine in enumerate(engines):
                errors = quantity.error(chain, state, quantity.evaluate(engine, state), expected)
                errors, names = errors.reshape(len(errors), -1), quantity.names or chain.joint_names
                k = int(np.argmax(np.where(np.isnan(errors), np.inf, errors).max(axis=1)))
                new = Difference(engine.name, name, float(errors[k].max()), names[k], state)
                worst[each, name] = max(worst.get((each, name), new), new, key=lambda one: one.rank)
        if progress is not None and (number + 1) % max(1, len(states) // 200) == 0:  # about 200 calls
            progress((number + 1) / len(states))
    return tuple(worst[each, name] for each in range(len(engines)) for name in quantities)
