"""Work against precision: what an error of the tip costs with flexlink, RK4, MuJoCo's integrators, SciPy and CVODE.

CPU time of the thread, runs only, after set-up and compilation. Others are given the line between their runs, their own
order beyond them, and, where a run at the limit of stability would take too long, an error of nothing; flexlink has
only its runs that met the error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flexlink.common.errors import MissingDependencyError
from flexlink.describe.spec import Positive, Spec
from validation.benchmarks.trade import trade_scene
from validation.case import Case, Measured
from validation.facts import Facts
from validation.store import Series, table
from validation.timing import mujoco_trade, native_trade, solver_trade
from validation.timing.work_precision import Cost, Point, cost

TIMED = True

Ladders = dict[str, list[Point]]
LABELS = "method", "setting", "error", "CPU time [s]"
MARKS = {
    "measured": "",
    "order": "Beyond its smallest measured error, by its order.",
    "limit": "At its limit of stability, from a part of the run; its error is taken to be small enough.",
}


class Settings(Spec, frozen=True):
    """Scenes; errors, as parts of the motion; methods; the longest runs [s of CPU]; who else runs, and where."""

    scenes: tuple[str, ...]
    errors: tuple[Positive, ...]
    methods: tuple[str, ...]
    budget: Positive
    solvers: tuple[str, ...] = ()
    solver_scenes: tuple[str, ...] = ()
    solver_tolerances: tuple[Positive, ...] = ()


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Times, ratios to the cheapest run of flexlink, and all runs to draw."""
    for name in settings.scenes:
        ours = {each: native_trade.by_tolerance(name, each, settings.budget, SMALLEST) for each in settings.methods}
        rk4 = {native_trade.LIMIT: native_trade.rk4(name, settings.budget, SMALLEST)}
        mujoco = {} if trade_scene(name).motion else mujoco_trade.points(name, settings.budget, SMALLEST)
        solvers = _solvers(name, settings) if name in settings.solver_scenes else {}
        for error in settings.errors:
            rows = _rows(name, error, ours, {"RK4": rk4, "MuJoCo": mujoco, "solvers": solvers})
            yield from (row for row in rows if not _has_its_own(case, f"{name}, {row.quantity}"))
        yield _series(name, ours | rk4 | {f"MuJoCo {key}": points for key, points in mujoco.items()} | solvers)


def _has_its_own(case: Case, quantity: str) -> bool:
    """Whether a limit that holds for all scenes is given up for one, whose quantity says why."""
    return quantity in case.quantity and bool(case.quantity[quantity].given_up)


SMALLEST = 1e-8  # error at which a ladder ends


def _solvers(name: str, settings: Settings) -> Ladders:
    found: Ladders = {}
    for solver in settings.solvers:
        try:
            found[solver] = solver_trade.points(name, solver, settings.solver_tolerances)
        except MissingDependencyError:  # CVODE is optional: the best of SciPy's is there
            continue
    return found


def _rows(name: str, error: float, ours: Ladders, others: dict[str, Ladders]) -> Iterator[Measured]:
    for method in ours:
        if own := native_trade.cheapest({method: ours[method]}, error):
            yield _time(name, "native", method, error, Cost(own[1].seconds))
    for group, ladders in others.items():
        costs = {each: known for each, points in ladders.items() if (known := _cost(group, each, points, error))}
        for each, known in costs.items():
            yield _time(name, group, each, error, known)
        best = native_trade.cheapest(ours if group == "RK4" else ours | others["RK4"], error)
        if costs:
            least = min(costs, key=lambda each: costs[each].seconds)
            ratio = costs[least].seconds / best[1].seconds if best else 0.0
            note = f"{least}: {1e3 * costs[least].seconds:.4g} ms; {_told(best)}. {MARKS[costs[least].kind]}".strip()
            for quantity in (f"{group} / flexlink, error {error:g}", f"{name}, {group} / flexlink, error {error:g}"):
                yield Measured(quantity, ratio, name, group, {"error": error}, note=note, timed=True)


def _cost(group: str, name: str, points: Sequence[Point], error: float) -> Cost | None:
    if len(points) == 1 and math.isnan(points[0].error):
        return Cost(points[0].seconds, "limit")
    return cost(points, error, mujoco_trade.ORDER[name] if group == "MuJoCo" else HIGHEST)


HIGHEST = 4.0  # order with which RK4 goes on, and SciPy's and CVODE's tolerances, of which only what was run counts


def _told(best: tuple[str, Point] | None) -> str:
    if best is None:
        return "flexlink does not get there"
    return f"{best[0]}, tolerance {best[1].setting:.2g} m: {1e3 * best[1].seconds:.4g} ms"


def _time(name: str, engine: str, method: str, error: float, known: Cost) -> Measured:
    facts: Facts = {"method": method, "error": error}
    return Measured("CPU time", 1e3 * known.seconds, name, engine, facts, note=MARKS[known.kind], timed=True)


def _series(name: str, ladders: Ladders) -> Series:
    rows = [
        (method, point.setting, point.error, point.seconds)
        for method, points in ladders.items()
        for point in points
        if point.error < math.inf
    ]
    title = f"{name}: what an error costs"
    columns, (_, _, x, y) = table(LABELS, rows), LABELS
    return Series("work", title, columns, x, x, y, "log", "log", group="method", scene=name)
