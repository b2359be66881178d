"""Time for a given error in complete calls by a user: flexlink against MuJoCo and Pinocchio.

prepared      flexlink repeats a run, which includes its tips, energies and checks; of other programs only the steps of
              a loaded model are timed
description   from the text of the description (a scene file, an MJCF, a URDF) to the result

Times are CPU times of the thread with everything compiled, the fastest of several rounds. Other programs' times are
interpolated between their runs and extrapolated by order; for flexlink only runs that met the error count. Pinocchio's
time is that of its evaluations in a C++ loop only.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence

from flexlink.chain.lumping import lump
from flexlink.describe.spec import Positive
from flexlink.engines.mujoco import quiet
from validation.case import Case, Measured
from validation.facts import Facts
from validation.trade import with_flexlink, with_mujoco, with_pinocchio
from validation.trade.scenes import trade_scene
from validation.trade.with_flexlink import described, prepared
from validation.trade.work_precision import Point, cost

TIMED = True

Ladders = dict[str, list[Point]]
ROUNDS, REPEATS = 3, 5
RIGID, OF_ORDER = ", rigid", 1e-4  # suffix for arms without springs, at errors up to 1e-4
CLOCKS = {"prepared": prepared, "description": described}
ORDERS: Mapping[str, Mapping[str, float]] = {"MuJoCo": with_mujoco.ORDER, "Pinocchio": with_pinocchio.ORDER}


def run(
    case: Case,
    scenes: tuple[str, ...],
    errors: tuple[Positive, ...],
    methods: tuple[str, ...],
    budget: Positive,
    pinocchio: int,
    pinocchio_tolerances: tuple[Positive, ...],
) -> Iterator[Measured]:
    """Yield times of both kinds of calls by method, and ratios of other programs' shortest times to flexlink's.

    `errors` are fractions of the motion, `budget` is the longest run [s of CPU], `pinocchio` the largest number of
    evaluations in a Pinocchio run.
    """
    smallest = min(errors)

    def mujoco(name: str) -> Ladders:
        return with_mujoco.points(name, trade_scene(name), budget, smallest)

    def native(name: str, clock: with_flexlink.Clock) -> Ladders:
        return {each: with_flexlink.by_tolerance(name, each, budget, smallest, clock) for each in methods}

    for name in scenes:
        chain = lump(trade_scene(name))
        rounds = [(mujoco(name), *(native(name, clock) for clock in CLOCKS.values())) for _ in range(ROUNDS)]
        of_mujoco, *ours = (_fastest(ladders) for ladders in zip(*rounds, strict=True))
        of_pinocchio = with_pinocchio.points(name, pinocchio_tolerances, pinocchio, smallest)
        with quiet():
            others = {
                "MuJoCo": (of_mujoco, least_seconds(with_mujoco.loading(chain))),
                "Pinocchio": (of_pinocchio, least_seconds(with_pinocchio.loading(chain))),
            }
        for what, ladders in zip(CLOCKS, ours, strict=True):
            for error in errors:
                yield from _rows(name, what, error, ladders, others)


def least_seconds(call: Callable[[], object]) -> float:
    """Least CPU time of several calls [s]."""

    def seconds() -> float:
        begun = time.thread_time()
        call()
        return time.thread_time() - begun

    return min(seconds() for _ in range(REPEATS))


def _fastest(rounds: Sequence[Ladders]) -> Ladders:
    """The fastest of equal runs over several rounds."""
    return {
        method: [
            min(same, key=lambda point: point.seconds) for same in zip(*(each[method] for each in rounds), strict=False)
        ]
        for method in rounds[0]
    }


def _rows(
    name: str, what: str, error: float, ours: Ladders, others: dict[str, tuple[Ladders, float]]
) -> Iterator[Measured]:
    for method, points in ours.items():
        if own := with_flexlink.cheapest({method: points}, error):
            facts: Facts = {"method": method, "error": error}
            yield Measured(f"CPU time, {what}", 1e3 * own[1].seconds, name, varied=facts, timed=True)
    best, rigid = with_flexlink.cheapest(ours, error), "" if lump(trade_scene(name)).stiffness.any() else RIGID
    for group, (ladders, loading) in others.items():
        costs = {
            each: known.seconds
            for each, points in ladders.items()
            if (known := cost(points, error, ORDERS[group][each])) is not None
        }
        if not costs:
            continue
        least = min(costs, key=lambda each: costs[each])
        seconds = costs[least] + (loading if what == "description" else 0.0)
        cheapest: Facts = {"method": least, "error": error}
        yield Measured(f"CPU time, {what}", 1e3 * seconds, name, group, cheapest, timed=True)
        note = f"{least}: {1e3 * seconds:.4g} ms"
        note += f"; {best[0]}: {1e3 * best[1].seconds:.4g} ms" if best else "; flexlink does not reach this error"
        ratio = seconds / best[1].seconds if best else 0.0
        quantity = f"{group} / flexlink, {what}, error {error:g}{rigid if error <= OF_ORDER else ''}"
        yield Measured(quantity, ratio, name, group, {"error": error}, note=note, timed=True)
