"""q̈ against 50-digit arithmetic beside the engines, on the same states: speed must not cost digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpmath import mp
from numpy.typing import NDArray

from flexlink import engines
from flexlink.chain import Chain
from flexlink.rounding import EPS, acceleration_error
from flexlink.spec import Spec
from flexlink.states import State, random_states
from validation.case import Case, Measured
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import SpatialChain, numbers
from validation.timing.families import Family

Array = NDArray[np.float64]


class Arms(Family, frozen=True):
    """A family with the range of its states.

    Attributes
    ----------
    bend
        Angles of passive hinges are up to this [rad], their rates in proportion.
    from_lock
        Every second hinge group of three axes is at so many radians from gimbal lock, each in turn.
    """

    bend: float = np.pi
    from_lock: tuple[float, ...] = ()

    def states(self, chain: Chain, samples: int, seed: int) -> list[State]:
        """Random states; of chains near gimbal lock so many at every distance from it."""
        passive = np.ones(chain.n, bool)
        passive[chain.active] = False
        share = np.where(passive, self.bend / np.pi, 1.0)
        states = [s._replace(q=s.q * share, qd=s.qd * share) for s in random_states(chain, samples, seed)]
        return [_locked(chain, s, distance) for distance in self.from_lock for s in states] or states


def _locked(chain: Chain, state: State, distance: float) -> State:
    sizes = np.repeat(*[chain.bodies["stop"] - chain.bodies["first"]] * 2)
    middle = np.flatnonzero((sizes == 3) & (chain.hinges["axis"] == 1))[::2]
    q = state.q.copy()
    q[middle] = np.copysign(np.pi / 2 - distance, q[middle])
    return state._replace(q=q)


class Settings(Spec, frozen=True):
    """Families of chains by name, the engines, number of states and seed."""

    chain: dict[str, Arms]
    engines: tuple[str, ...]
    samples: int
    seed: int = 0


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Errors of every engine, and ours over theirs: of the worst state, and of the geometric mean of all."""
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = family.scene(case, segments).chain()
            states = family.states(chain, settings.samples, settings.seed)
            truth = _exact(chain, states)
            label, setting = f"{name}, n = {chain.n}", f"{settings.samples} random states"
            found = {each: _accelerations(each, chain, states) for each in ("native", *settings.engines)}
            errors = {each: _errors(qdd, truth) for each, qdd in found.items()}
            ours = errors["native"]
            solutions = zip(states, found["native"], truth, strict=True)
            residuals = [acceleration_error(chain, s.q, s.qd, s.tau, (one, exact)) for s, one, exact in solutions]
            yield Measured("q̈", float(np.max(residuals)), label, setting=setting)
            yield Measured(f"{name}: worst error", float(ours.max()), label, setting=setting)
            for engine, error in errors.items():
                yield Measured("worst error of q̈", float(error.max()), label, engine, setting)
                yield Measured("mean error of q̈", _mean(error), label, engine, setting)
                if engine != "native":
                    worst, mean = float(ours.max() / error.max()), _mean(ours) / _mean(error)
                    yield Measured(f"{name}: worst error, native / {engine}", worst, label, engine, setting)
                    yield Measured(f"{name}: mean error, native / {engine}", mean, label, engine, setting)


def _exact(chain: Chain, states: list[State]) -> list[Array]:
    oracle = SpatialChain(chain)
    with mp.workdps(2 * DIGITS):  # M itself loses up to 36 at gimbal lock
        exact = [oracle.forward_dynamics(numbers(s.q), numbers(s.qd), numbers(s.tau)) for s in states]
        return [np.array(values, dtype=np.float64) for values in exact]  # rounds once


def _accelerations(name: str, chain: Chain, states: list[State]) -> list[Array]:
    engine = engines.load(name, chain)
    return [engine.forward_dynamics(s.q, s.qd, s.tau) for s in states]


def _errors(got: list[Array], truth: list[Array]) -> Array:
    """max |Δq̈| / max |q̈| of each state."""
    return np.array([np.abs(a - b).max() / np.abs(b).max() for a, b in zip(got, truth, strict=True)])


def _mean(error: Array) -> float:
    """Geometric mean; an error of zero counts as half a unit in the last place."""
    return float(np.exp(np.log(np.maximum(error, EPS / 2)).mean()))
