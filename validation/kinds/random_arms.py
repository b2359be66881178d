"""Random serial and branched arms that use every key of a link, compared with other engines term by term."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.diagnosis.quantities import QUANTITIES, State, compare_engines, mixed_states
from flexlink.engines import Engine, load
from validation.case import Case, Measured
from validation.facts import Facts
from validation.random_arms import random_arm, random_tree

SHARES = {"M": "M", "T_GC": "T_GC with tip wrench"}
"""Quantity → the quantity by whose largest element over an arm's states the error is divided. Without a tip load, the
torque of a balanced arm would be only rounding error."""


def run(
    case: Case, engines: tuple[str, ...], arms: int, samples: int, seed: int = 0, trees: bool = False
) -> Iterator[Measured]:
    """Yield the largest error of each quantity over all arms, and the number of arms that an engine refused.

    `trees`: arms with branches, sliding joints and floating bases.
    """
    worst: dict[tuple[str, str], tuple[float, int]] = {}
    refused: dict[str, list[str]] = {name: [] for name in engines}
    for number in range(seed, seed + arms):
        chain = lump(random_tree(number) if trees else random_arm(number))
        native, states = load("native", chain), mixed_states(chain, samples, seed=number)
        for name in engines:
            try:
                engine = load(name, chain)
            except FlexlinkError as reason:
                refused[name].append(f"arm {number}: {reason}")
                continue
            for quantity, error in _errors(chain, native, engine, states):
                worst[name, quantity] = max(worst.get((name, quantity), (-1.0, number)), (error, number))
    facts: Facts = {"arms": arms, "states": samples}
    for (name, quantity), (error, number) in worst.items():
        yield Measured(quantity, error, "random arms", name, facts, note=f"Largest for arm {number}." if error else "")
    for name, reasons in refused.items():
        yield Measured("arms refused", len(reasons), "random arms", name, facts, note="; ".join(reasons[:3]))


def _errors(chain: Chain, native: Engine, engine: Engine, states: Sequence[State]) -> Iterator[tuple[str, float]]:
    """Yield the largest error of each quantity in units of the rounding bound, for `SHARES` also relative to size."""
    for row in compare_engines(chain, native, [engine], states):
        yield row.quantity, row.error
    for name, whole in SHARES.items():
        got, wanted = (np.array([QUANTITIES[name].evaluate(e, s) for s in states]) for e in (engine, native))
        largest = max(np.abs(QUANTITIES[whole].evaluate(native, s)).max() for s in states)
        yield f"{name}, share", float(np.abs(got - wanted).max() / largest)
