"""flexlink and other engines against 50-digit arithmetic, which decides which engine is right."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
import numpy as np
from mpmath import mp, mpf
from numpy.typing import NDArray

import flexlink as fl
from flexlink import engines as programs
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import QUANTITIES, State, random_states
from flexlink.dynamics.rounding import EPS, ROUNDINGS, acceleration_error
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.oracles.planar_chain import DIGITS, PlanarChain
from validation.oracles.spatial_chain import SpatialChain, accelerations, derivatives, exactly
from validation.random_arms import random_arm, random_tree
from validation.speed.families import Family

DERIVATIVES = "∂q̈/∂q", "∂q̈/∂q̇", "∂q̈/∂T_EX"
CLOSE_TO = 1e-12


@kind
def judge(case: Case, engines: tuple[str, ...], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest error of M, T_GC and q̈ on planar chains by scene and engine, in units of rounding."""
    for scene in case.load_scenes():
        chain = lump(scene)
        oracle = PlanarChain(chain)
        states = [s._replace(wrench=np.zeros(6)) for s in random_states(chain, samples, seed=seed)]
        with mp.workdps(DIGITS):
            exact = [_of_plane(oracle, s) for s in states]
        for name in engines:
            engine = programs.load(name, chain)
            for quantity in exact[0]:
                term = QUANTITIES[quantity]
                errors = [
                    term.error(chain, s, term.evaluate(engine, s), truth[quantity]).max()
                    for s, truth in zip(states, exact, strict=True)
                ]
                yield Measured(quantity, float(max(errors)), scene.name, name, {"states": samples})


def _of_plane(oracle: PlanarChain, state: State) -> dict[str, Array]:
    q, qd, tau = ([mpf(float(x)) for x in part] for part in (state.q, state.qd, state.tau))
    found: dict[str, Any] = {
        "M": oracle.mass_matrix(q).tolist(), "T_GC": oracle.bias_torque(q, qd),
        "q̈": oracle.forward_dynamics(q, qd, tau),
    }  # fmt: skip
    return {name: np.array(values, dtype=np.float64) for name, values in found.items()}  # rounds once


@kind
def judge_trees(case: Case, engines: tuple[str, ...], arms: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest errors of M, T_GC, q̈ by engine over random trees, in units of rounding and relative to size.

    The trees have sliding joints and floating bases.
    """
    worst: dict[tuple[str, str], tuple[float, int]] = {}
    for number in range(seed, seed + arms):
        chain = lump(random_tree(number))
        (state,) = random_states(chain, 1, seed=number)
        state = state._replace(wrench=np.zeros(6))
        exact = _exact(chain, state)
        for name in engines:
            engine = programs.load(name, chain)
            for quantity, truth in exact.items():
                found = QUANTITIES[quantity].evaluate(engine, state)
                errors = {
                    quantity: float(QUANTITIES[quantity].error(chain, state, found, truth).max()),
                    f"{quantity}, share": float(np.abs(found - truth).max() / np.abs(truth).max()),
                }
                for measure, error in errors.items():
                    worst[name, measure] = max(worst.get((name, measure), (-1.0, number)), (error, number))
    for (name, measure), (error, number) in worst.items():
        yield Measured(measure, error, "random trees", name, {"arms": arms}, note=f"Largest for tree {number}.")


def _exact(chain: Chain, state: State) -> dict[str, Array]:
    with mp.workdps(2 * DIGITS):
        M, bias = SpatialChain(chain).equations(exactly(state.q), exactly(state.qd))
        (qdd,) = accelerations(chain, (state.q, state.qd, state.tau))
        return {"M": np.array(M.tolist(), float), "T_GC": np.array(bias, float), "q̈": qdd}


@kind
def exact_derivatives(case: Case, arms: int, joints: tuple[int, int], seed: int = 0) -> Iterator[Measured]:
    """Derivatives of random arms against finite differences in 60 digits.

    For each derivative, yield the largest error, also relative to rounding, and the share of arms within `CLOSE_TO`.
    Only arms whose number of joints is in the range `joints` count; `seed` is the first seed.
    """
    errors, seeds, conditions, sizes = [], [], [], []
    for number, chain in _arms(arms, joints, seed):
        rng = np.random.default_rng(number)
        q, qd = rng.uniform(-np.pi, np.pi, chain.n), rng.uniform(-10.0, 10.0, chain.n)
        q = np.where(np.isin(np.arange(chain.n), chain.active), q, q / 6)  # passive hinge angles are up to 30°
        tau, wrench = rng.normal(size=chain.n), rng.normal(size=6)
        found = fl.forward_dynamics_derivatives(chain, q, qd, tau, tip_wrench=wrench)
        exact = derivatives(chain, q, qd, tau, wrench)
        pairs = zip((found.dq, found.dqd, found.dtau), exact, strict=True)
        errors.append([_relative(ours, theirs) for ours, theirs in pairs])
        conditions.append(np.linalg.cond(fl.mass_matrix(chain, q)))
        sizes.append(chain.n)
        seeds.append(number)
    facts: Facts = {"arms": arms}
    for name, column in zip(DERIVATIVES, np.transpose(errors), strict=True):
        k = int(np.argmax(column))
        note = f"Largest for arm {seeds[k]}, with cond(M) = {conditions[k]:.1e}."
        yield Measured(name, float(column[k]), "random arms", "native", facts, note=note)
        explained = column / (ROUNDINGS * EPS * np.sqrt(sizes) * conditions)
        yield Measured(f"{name}, by rounding", float(explained.max()), "random arms", "native", facts)
        yield Measured(f"{name}, share", float(np.mean(column <= CLOSE_TO)), "random arms", "native", facts)


def _arms(arms: int, joints: tuple[int, int], seed: int) -> Iterator[tuple[int, Chain]]:
    fewest, most = joints
    for _ in range(arms):
        while not fewest <= (chain := lump(random_arm(seed))).n <= most:
            seed += 1
        yield seed, chain
        seed += 1


def _relative(ours: NDArray[np.float64], exact: NDArray[np.float64]) -> float:
    """Largest error relative to the largest element; absolute if all elements are zero to the last digit."""
    largest = np.abs(exact).max()
    return float(np.abs(ours - exact).max() / (largest if largest > 1e-30 else 1.0))


class Arms(Family, frozen=True):
    """A family with the payloads of its arms and the range of their states.

    Attributes
    ----------
    loads
        Tip masses [kg] that replace the scene's; if they are large, single rounding errors of m c and I dominate.
    bend
        Largest angle of passive hinges [rad]; their rates are scaled by the same factor.
    from_lock
        Distances from gimbal lock [rad], applied to every second hinge group of three axes.
    times
        Factor on the case's number of states; above 1 for short chains, whose worst error of few states is random.
    """

    loads: tuple[float, ...] = ()
    bend: float = np.pi
    from_lock: tuple[float, ...] = ()
    times: Annotated[int, msgspec.Meta(ge=1)] = 1

    def chains(self, case: Case, segments: int) -> list[Chain]:
        """The arm with `segments` segments per link, with each of the loads."""
        scene = self.scene(case, segments)
        return [lump(scene.varied({"tip.mass": load})) for load in self.loads or (scene.arm.tip.mass,)]

    def states(self, chain: Chain, samples: int, seed: int) -> list[State]:
        """Random states; if `from_lock` is set, the same states at each of these distances from gimbal lock."""
        share = np.full(chain.n, self.bend / np.pi)
        share[chain.active] = 1.0
        states = [
            s._replace(q=s.q * share, qd=s.qd * share) for s in random_states(chain, self.times * samples, seed=seed)
        ]
        return [_near_lock(chain, s, distance) for distance in self.from_lock for s in states] or states


def _near_lock(chain: Chain, state: State, distance: float) -> State:
    triples = chain.bodies["first"][chain.bodies["stop"] - chain.bodies["first"] == 3]
    middle, q = triples[::2] + 1, state.q.copy()
    q[middle] = np.copysign(np.pi / 2 - distance, q[middle])
    return state._replace(q=q)


@kind
def accuracy(
    case: Case, chain: dict[str, Arms], engines: tuple[str, ...], samples: int, seed: int = 0
) -> Iterator[Measured]:
    """Yield each engine's worst and geometric mean error of q̈ over the states, and flexlink's error relative to it.

    `chain` are families by name.
    """
    for name, family in chain.items():
        for segments in family.segments:
            arms = [
                (arm, states, accelerations(arm, *(state[:3] for state in states)))
                for arm in family.chains(case, segments)
                for states in (family.states(arm, samples, seed),)
            ]
            every = ("native", *engines)
            found = {each: [_accelerations(each, arm, states) for arm, states, _ in arms] for each in every}
            errors = {
                each: np.concatenate([_errors(got, truth) for got, (_, _, truth) in zip(lists, arms, strict=True)])
                for each, lists in found.items()
            }
            ours = errors["native"]
            residuals = [
                acceleration_error(arm, s.q, s.qd, s.tau, solutions=(one, exact))
                for (arm, states, truth), got in zip(arms, found["native"], strict=True)
                for s, one, exact in zip(states, got, truth, strict=True)
            ]
            facts: Facts = {"chain": name, "n": arms[0][0].n, "states": len(ours)}
            yield Measured("q̈", float(np.max(residuals)), varied=facts)
            yield Measured(f"{name}: worst error", float(ours.max()), varied=facts)
            for engine, error in errors.items():
                yield Measured("worst error of q̈", float(error.max()), "", engine, facts)
                yield Measured("mean error of q̈", _mean(error), "", engine, facts)
                if engine != "native":
                    worst, mean = float(ours.max() / error.max()), _mean(ours) / _mean(error)
                    yield Measured(f"{name}: worst error, native / {engine}", worst, "", engine, facts)
                    yield Measured(f"{name}: mean error, native / {engine}", mean, "", engine, facts)


def _accelerations(name: str, chain: Chain, states: list[State]) -> list[Array]:
    engine = programs.load(name, chain)
    return [engine.forward_dynamics(s.q, s.qd, s.tau) for s in states]


def _errors(got: list[Array], truth: list[Array]) -> Array:
    """max |Δq̈| / max |q̈| for each state."""
    return np.array([np.abs(a - b).max() / np.abs(b).max() for a, b in zip(got, truth, strict=True)])


def _mean(error: Array) -> float:
    """Geometric mean of errors; an error of zero counts as half a unit in the last place."""
    return float(np.exp(np.log(np.maximum(error, EPS / 2)).mean()))
