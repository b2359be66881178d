"""flexlink against 50-digit arithmetic on random trees with sliding joints and floating bases."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpmath import mp

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import QUANTITIES, State, random_states
from flexlink.engines import load
from validation.case import Case, Measured
from validation.oracles.planar_chain import DIGITS
from validation.oracles.spatial_chain import SpatialChain, accelerations, exactly
from validation.random_arms import random_tree


def run(case: Case, engines: tuple[str, ...], arms: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest errors of M, T_GC, q̈ by engine over all trees, in units of rounding and relative to size."""
    worst: dict[tuple[str, str], tuple[float, int]] = {}
    for number in range(seed, seed + arms):
        chain = lump(random_tree(number))
        (state,) = random_states(chain, 1, seed=number)
        state = state._replace(wrench=np.zeros(6))
        exact = _exact(chain, state)
        for name in engines:
            engine = load(name, chain)
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
