"""Files written by `flexlink export`, compared at random states in the engines that read them, and read back."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.diagnosis.quantities import State, random_states
from flexlink.dynamics.rounding import acceleration_error
from flexlink.engines import Engine, load
from flexlink.formats import FORMATS
from validation.case import Case, Measured
from validation.facts import Facts


def run(case: Case, engines: dict[str, str], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Yield the largest error of each quantity by scene and engine, and the number of values read back differently.

    `engines` maps each format to the engine that reads it.
    """
    facts: Facts = {"states": samples}
    for scene in case.load_scenes():
        chain = lump(scene.varied({"motion": ()}))
        states = random_states(chain, samples, seed=seed)
        native = load("native", chain)
        for format, name in engines.items():
            if (read := FORMATS[format].read) is not None:  # only MuJoCo reads MJCF
                back = read(FORMATS[format].write(chain))
                yield Measured("read back", _differences(chain, back), scene.name, name, {"form": format})
            engine = load(name, chain)
            errors = np.array([list(_errors(chain, native, engine, state).values()) for state in states])
            worst = np.where(np.isnan(errors), np.inf, errors).max(axis=0)
            for quantity, error in zip(_errors(chain, native, engine, states[0]), worst, strict=True):
                yield Measured(quantity, float(error), scene.name, name, {"form": format, **facts})


def _errors(chain: Chain, native: Engine, engine: Engine, state: State) -> dict[str, float]:
    """Errors at one state: M, T_GC relative to the largest element; number of wrong T_FL; q̈ in units of rounding."""
    (q, qd, tau, wrench), pair = state, (native, engine)
    M, other_M = (one.mass_matrix(q) for one in pair)
    bias, other_bias = (one.bias_torque(q, qd, tip_wrench=wrench) for one in pair)
    springs, other_springs = (one.elastic_torque(q) for one in pair)
    qdd = tuple(one.forward_dynamics(q, qd, tau, tip_wrench=wrench) for one in pair)
    return {
        "M": float(np.abs(M - other_M).max() / np.abs(M).max()),
        "T_GC": float(np.abs(bias - other_bias).max() / np.abs(bias).max()),
        "T_FL": float(np.count_nonzero(springs != other_springs)),
        "q̈": float(acceleration_error(chain, q, qd, tau, solutions=(qdd[0], qdd[1]), tip_wrench=wrench).max()),
    }


def _differences(chain: Chain, back: Chain) -> float:
    """Number of values that differ between a chain and the one read back from its file."""
    different = int(back.coordinates != chain.coordinates) + int(back.link_names != chain.link_names)
    different += int(np.count_nonzero(back.gravity != chain.gravity))
    for array, other in ((chain.bodies, back.bodies), (chain.hinges, back.hinges)):
        different += int(sum(np.count_nonzero(array[field] != other[field]) for field in array.dtype.names or ()))
    return float(different)
