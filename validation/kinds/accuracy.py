"""q̈ against 50-digit arithmetic beside the engines, on the same states: speed must not cost digits."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpmath import mp
from numpy.typing import NDArray

from flexlink import engines
from flexlink.chain import Chain
from flexlink.compare import EPS, State, random_states
from flexlink.dynamics import mass_matrix
from flexlink.spec import Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import SpatialChain, numbers
from validation.timing.families import Family

Array = NDArray[np.float64]


class Settings(Spec, frozen=True):
    """Families of chains by name, the engines, number of states and seed."""

    chain: dict[str, Family]
    engines: tuple[str, ...]
    samples: int
    seed: int = 0


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Errors of every engine, and ours over theirs: of the worst state, and of the geometric mean of all."""
    for name, family in settings.chain.items():
        for segments in family.segments:
            chain = family.scene(case, segments).chain()
            states = random_states(chain, settings.samples, settings.seed)
            truth = _exact(chain, states)
            facts: Facts = {"chain": name, "n": chain.n, "states": settings.samples}
            errors = {each: _errors(each, chain, states, truth) for each in ("native", *settings.engines)}
            ours = errors["native"]
            units = np.array([10 * EPS * np.linalg.cond(mass_matrix(chain, s.q)) for s in states])
            yield Measured("q̈", float((ours / units).max()), varied=facts)
            for engine, error in errors.items():
                yield Measured("worst error of q̈", float(error.max()), "", engine, facts)
                yield Measured("mean error of q̈", _mean(error), "", engine, facts)
                if engine != "native":
                    worst, mean = float(ours.max() / error.max()), _mean(ours) / _mean(error)
                    yield Measured(f"{name}: worst error, native / {engine}", worst, "", engine, facts)
                    yield Measured(f"{name}: mean error, native / {engine}", mean, "", engine, facts)


def _exact(chain: Chain, states: list[State]) -> list[Array]:
    oracle = SpatialChain(chain)
    with mp.workdps(DIGITS):
        exact = [oracle.forward_dynamics(numbers(s.q), numbers(s.qd), numbers(s.tau)) for s in states]
        return [np.array(values, dtype=np.float64) for values in exact]  # rounds once


def _errors(name: str, chain: Chain, states: list[State], truth: list[Array]) -> Array:
    """max |Δq̈| / max |q̈| of each state."""
    engine = engines.load(name, chain)
    got = [engine.forward_dynamics(s.q, s.qd, s.tau) for s in states]
    return np.array([np.abs(a - b).max() / np.abs(b).max() for a, b in zip(got, truth, strict=True)])


def _mean(error: Array) -> float:
    """Geometric mean; an error of zero counts as half a unit in the last place."""
    return float(np.exp(np.log(np.maximum(error, EPS / 2)).mean()))
