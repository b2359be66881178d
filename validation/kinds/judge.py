"""flexlink and other engines against 50-digit arithmetic on planar chains, which decides which engine is right."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from mpmath import mp, mpf

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.diagnosis.quantities import QUANTITIES, State, random_states
from flexlink.engines import load
from validation.case import Case, Measured
from validation.oracles.planar_chain import DIGITS, PlanarChain


def run(case: Case, engines: tuple[str, ...], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest error of M, T_GC and q̈ by scene and engine over its states, in units of the rounding bound."""
    for scene in case.load_scenes():
        chain = lump(scene)
        oracle = PlanarChain(chain)
        states = [s._replace(wrench=np.zeros(6)) for s in random_states(chain, samples, seed=seed)]
        with mp.workdps(DIGITS):
            exact = [_exact(oracle, s) for s in states]
        for name in engines:
            engine = load(name, chain)
            for quantity in exact[0]:
                term = QUANTITIES[quantity]
                errors = [
                    term.error(chain, s, term.evaluate(engine, s), truth[quantity]).max()
                    for s, truth in zip(states, exact, strict=True)
                ]
                yield Measured(quantity, float(max(errors)), scene.name, name, {"states": samples})


def _exact(oracle: PlanarChain, state: State) -> dict[str, Array]:
    q, qd, tau = ([mpf(float(x)) for x in part] for part in (state.q, state.qd, state.tau))
    return {
        "M": _array(oracle.mass_matrix(q).tolist()),
        "T_GC": _array(oracle.bias_torque(q, qd)),
        "q̈": _array(oracle.forward_dynamics(q, qd, tau)),
    }


def _array(values: Any) -> Array:
    return np.array(values, dtype=np.float64)  # rounds once
