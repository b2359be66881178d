"""q̈ by flexlink and by other engines, compared with 50-digit arithmetic at the same states."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import msgspec
import numpy as np

from flexlink import engines
from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import State, random_states
from flexlink.dynamics.rounding import EPS, acceleration_error
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles import spatial_chain
from validation.speed.families import Family


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


def run(
    case: Case, chain: dict[str, Arms], engines: tuple[str, ...], samples: int, seed: int = 0
) -> Iterator[Measured]:
    """Yield each engine's worst and geometric mean error over the states, and the ratio of flexlink's error to it.

    `chain` are families by name.
    """
    for name, family in chain.items():
        for segments in family.segments:
            arms = [
                (arm, states, spatial_chain.accelerations(arm, *(state[:3] for state in states)))
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
    engine = engines.load(name, chain)
    return [engine.forward_dynamics(s.q, s.qd, s.tau) for s in states]


def _errors(got: list[Array], truth: list[Array]) -> Array:
    """max |Δq̈| / max |q̈| for each state."""
    return np.array([np.abs(a - b).max() / np.abs(b).max() for a, b in zip(got, truth, strict=True)])


def _mean(error: Array) -> float:
    """Geometric mean of errors; an error of zero counts as half a unit in the last place."""
    return float(np.exp(np.log(np.maximum(error, EPS / 2)).mean()))
