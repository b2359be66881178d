"""Terms and complete motions against Drake and Exudyn, which compute springs, dampers and Runge-Kutta steps themselves.

Motions use the same tableau and step, so only rounding errors differ. An engine that is not installed is skipped and
reported.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink import engines
from flexlink.chain.lumping import lump
from flexlink.common.errors import MissingDependencyError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive
from flexlink.diagnosis.quantities import QUANTITIES, random_states
from validation.case import Case, Measured
from validation.kinds import kind
from validation.runs import run_facts

RELATIVE_QUANTITIES = ("M", "T_GC", "T_GC with tip wrench", "T_FL", "T_FR")


@kind(long=True)
def run(
    case: Case,
    methods: dict[str, tuple[str, ...]],
    motions: tuple[str, ...],
    duration: Positive,
    samples: int,
    seed: int = 0,
) -> Iterator[Measured]:
    """Yield the largest difference for each engine, scene and method, and the number of engines not installed.

    `methods` lists the methods that each engine shares with flexlink; `motions` are scenes to run for `duration` [s].
    """
    scenes, missing = case.load_scenes(), []
    for name, shared in methods.items():
        try:
            engines.load(name, lump(scenes[0]))
        except MissingDependencyError as error:
            missing.append(f"not run: {error}")
            continue
        for scene in scenes:
            yield from _terms(scene, name, samples, seed)
            if scene.name in motions:
                for method in shared:
                    yield from _motion(scene.varied({"run.method": method, "run.duration": duration}), name)
    yield Measured("witnesses left out", len(missing), note="; ".join(missing))


def _terms(scene: Scene, name: str, samples: int, seed: int) -> Iterator[Measured]:
    """Yield the largest |Δ| over the states, relative to the largest element of a state (q̈ in units of rounding)."""
    chain, facts = lump(scene), {"states": samples}
    ours, theirs = engines.load("native", chain), engines.load(name, chain)
    states = random_states(chain, samples, seed=seed)
    for quantity in RELATIVE_QUANTITIES:
        evaluate = QUANTITIES[quantity].evaluate
        worst = max(_relative(evaluate(theirs, state), evaluate(ours, state)) for state in states)
        yield Measured(quantity, worst, scene.name, name, facts)
    evaluate, error, _ = QUANTITIES["q̈"]
    worst = max(float(error(chain, state, evaluate(theirs, state), evaluate(ours, state)).max()) for state in states)
    yield Measured("q̈", worst, scene.name, name, facts)


def _relative(theirs: Array, ours: Array) -> float:
    largest = float(np.abs(ours).max())
    return float(np.abs(theirs - ours).max()) / largest if largest else float(np.abs(theirs).max())


def _motion(scene: Scene, name: str) -> Iterator[Measured]:
    chain, facts = lump(scene), run_facts(scene.run)
    (_, q, qd), (_, q2, qd2) = (engines.load(each, chain).integrate(scene) for each in ("native", name))
    yield Measured("max |Δq|", float(np.abs(q2 - q).max()), scene.name, name, facts)
    yield Measured("max |Δq̇|", float(np.abs(qd2 - qd).max()), scene.name, name, facts)
