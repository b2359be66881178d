"""Other engines at equal states and in equal motions, and the files that they read."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.diagnosis.comparison import compare
from flexlink.diagnosis.quantities import QUANTITIES, State, compare_engines, mixed_states, random_states
from flexlink.dynamics.rounding import acceleration_error
from flexlink.engines import Engine, load
from flexlink.formats import FORMATS
from flexlink.motion.simulate import simulate
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.random_arms import random_arm, random_tree
from validation.runs import motion_series, points_of, run_facts
from validation.store import Series


@kind
def pointwise(case: Case, engines: tuple[str, ...], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Every term of the equation of motion against other engines, in random, balanced and stretched-out states.

    Yield the largest error of each quantity, engine and scene, with a diagnosis if it is too large.
    """
    for scene in case.load_scenes():
        comparison = compare(scene, engines=engines, samples=samples, seed=seed)
        why = {diagnosis.engine: str(diagnosis) for diagnosis in comparison.diagnoses}
        for row in comparison.rows:
            note = f"Largest at joint {row.joint!r}." if row.passed else why[row.engine]
            facts: Facts = {"states": samples}
            yield Measured(row.quantity, row.error, scene.name, row.engine, facts, note=note)


SHARES = {"M": "M", "T_GC": "T_GC with tip wrench"}
"""Quantity → the quantity by whose largest element over an arm's states the error is divided. Without a tip load, the
torque of a balanced arm would be only rounding error."""


@kind
def random_arms(
    case: Case, engines: tuple[str, ...], arms: int, samples: int, seed: int = 0, trees: bool = False
) -> Iterator[Measured]:
    """Random serial and branched arms that use every key of a link, compared with other engines term by term.

    Yield the largest error of each quantity over all arms, and the number of arms that an engine refused.

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
            for quantity, error in _errors_of_arm(chain, native, engine, states):
                worst[name, quantity] = max(worst.get((name, quantity), (-1.0, number)), (error, number))
    facts: Facts = {"arms": arms, "states": samples}
    for (name, quantity), (error, number) in worst.items():
        yield Measured(quantity, error, "random arms", name, facts, note=f"Largest for arm {number}." if error else "")
    for name, reasons in refused.items():
        yield Measured("arms refused", len(reasons), "random arms", name, facts, note="; ".join(reasons[:3]))


def _errors_of_arm(
    chain: Chain, native: Engine, engine: Engine, states: Sequence[State]
) -> Iterator[tuple[str, float]]:
    """Yield the largest error of each quantity in units of the rounding bound, for `SHARES` also relative to size."""
    for row in compare_engines(chain, native, [engine], states):
        yield row.quantity, row.error
    for name, whole in SHARES.items():
        got, wanted = (np.array([QUANTITIES[name].evaluate(e, s) for s in states]) for e in (engine, native))
        largest = max(np.abs(QUANTITIES[whole].evaluate(native, s)).max() for s in states)
        yield f"{name}, share", float(np.abs(got - wanted).max() / largest)


@kind(long=True)
def trajectory(case: Case, engines: tuple[str, ...]) -> Iterator[Measured | Series]:
    """Complete motions against other engines with the same method and step.

    Yield the largest differences of joint angles and rates over the run, and the panels of figure 5.
    """
    for scene in case.load_scenes():
        ours = simulate(scene)
        yield from motion_series(scene, ours)
        differences = {"time [s]": ours.t}
        for name in engines:
            t, q, qd = load(name, ours.chain).integrate(scene)
            yield from motion_series(scene, points_of(scene, ours.chain, t, q, qd), name)
            differences[name] = np.abs(q - ours.q).max(axis=1)
            yield Measured("max |Δq|", float(differences[name].max()), scene.name, name, run_facts(scene.run))
            yield Measured("max |Δq̇|", float(np.abs(qd - ours.qd).max()), scene.name, name, run_facts(scene.run))
        title = f"{scene.name}: difference from flexlink, same method and step"
        yield Series(
            "difference", title, differences, "time [s]", "time [s]", "max |Δq| [rad]", y_scale="log", scene=scene.name
        )


@kind
def generated_files(case: Case, engines: dict[str, str], samples: int, seed: int = 0) -> Iterator[Measured]:
    """Files written by `flexlink export`, compared at random states in the engines that read them, and read back.

    Yield the largest error of each quantity by scene and engine, and the number of values read back differently.

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
            errors = np.array([list(_errors_of_file(chain, native, engine, state).values()) for state in states])
            worst = np.where(np.isnan(errors), np.inf, errors).max(axis=0)
            for quantity, error in zip(_errors_of_file(chain, native, engine, states[0]), worst, strict=True):
                yield Measured(quantity, float(error), scene.name, name, {"form": format, **facts})


def _errors_of_file(chain: Chain, native: Engine, engine: Engine, state: State) -> dict[str, float]:
    """Errors at one state: M, T_GC relative to the largest element; number of wrong T_FL; q̈ in units of rounding."""
    (q, qd, tau, wrench, _), pair = state, (native, engine)
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
