"""Work-precision studies: CPU time for a given error in flexlink and in other programs."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from flexlink.chain.lumping import lump
from flexlink.common.errors import MissingDependencyError
from flexlink.describe.spec import Positive, Spec
from flexlink.engines.mujoco import quiet
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.store import Series, table
from validation.trade import contestants, with_flexlink, with_mujoco, with_pinocchio
from validation.trade.first_order import FirstOrder
from validation.trade.scenes import scenes, trade_scene
from validation.trade.with_flexlink import described, prepared
from validation.trade.work_precision import Cost, Point, cost

Ladders = dict[str, list[Point]]
COLUMNS = "method", "setting", "error", "CPU time [s]", "deflection error", "evaluations"
NOTES = {
    "measured": "",
    "order": "Beyond its smallest measured error, by its order.",
    "limit": "At its limit of stability, from a part of the run; its error is taken to be small enough.",
}
LAST_ERROR = 1e-8  # error at which the runs of a method end
RK4, MUJOCO, PINOCCHIO, SOLVERS = "RK4", "MuJoCo", "Pinocchio", "solvers"
ORDER_OF_RK4 = 4.0  # for extrapolation; also used for SciPy and CVODE unless their last points show a higher order
ORDERS_OF_OTHERS: Mapping[str, Mapping[str, float]] = {
    MUJOCO: with_mujoco.ORDER,
    PINOCCHIO: with_pinocchio.ORDER,
    "Exudyn": {"GeneralizedAlpha": 2.0, "TrapezoidalIndex2": 2.0},
}


class SpeedTradeSettings(Spec, frozen=True):
    """Scenes; errors, as fractions of the motion; methods; longest runs [s of CPU]; other programs and their scenes.

    `methods` use tolerances, `stepped` methods use fixed steps. `solvers` and `witnesses` that are not installed are
    skipped. `pinocchio` is the largest number of evaluations in a Pinocchio run.
    """

    scenes: tuple[str, ...]
    errors: tuple[Positive, ...]
    methods: tuple[str, ...]
    budget: Positive
    stepped: tuple[str, ...] = ()
    solvers: tuple[str, ...] = ()
    solver_scenes: tuple[str, ...] = ()
    solver_tolerances: tuple[Positive, ...] = ()
    witnesses: tuple[str, ...] = ()
    witness_scenes: tuple[str, ...] = ()
    pinocchio: int = 0
    pinocchio_tolerances: tuple[Positive, ...] = ()


class Aim(NamedTuple):
    """A target error of the tip ("error") or of the deflection ("deflection error")."""

    what: str
    error: float

    def facts(self, method: str) -> Facts:
        """The method and the error."""
        return {"method": method, self.what: self.error}

    def point(self, point: Point) -> Point:
        """The point with the error of this aim as its error."""
        return point if self.what == "error" or point.time_only else point._replace(error=point.bend)


@kind(timed=True)
def speed_trade(case: Case, settings: SpeedTradeSettings) -> Iterator[Measured | Series]:
    """Work-precision study: time for a given error with flexlink, MuJoCo, Pinocchio, SciPy, CVODE, Drake and Exudyn.

    Times are CPU times of the thread during the runs, without set-up and compilation. Other programs' times are
    interpolated between their runs and extrapolated by order; a run that would take too long at the stability limit
    counts as free of error. For flexlink only runs that met the error count. Pinocchio's time is that of its
    evaluations only (`with_pinocchio`).

    Yield times, evaluations, ratios to flexlink's cheapest run, and a series of all runs.
    """
    for name in settings.scenes:
        ours, others = _ours(name, settings), _others(name, settings)
        for aim in (Aim(what, error) for what in ("error", "deflection error") for error in settings.errors):
            rows = _rows(name, aim, ours, others)
            yield from (row for row in rows if not case.has_separate_limit(name, row.quantity.removesuffix(HARD_SCENE)))
        drawn = {f"{group} {key}": points for group in others if group != RK4 for key, points in others[group].items()}
        yield _series(name, ours | others[RK4] | drawn)


def _ours(name: str, settings: SpeedTradeSettings) -> Ladders:
    found = {each: with_flexlink.by_tolerance(name, each, settings.budget, LAST_ERROR) for each in settings.methods}
    return found | {each: with_flexlink.by_step(name, each, settings.budget, LAST_ERROR) for each in settings.stepped}


def _others(name: str, settings: SpeedTradeSettings) -> dict[str, Ladders]:
    scene = trade_scene(name)
    found: dict[str, Ladders] = {
        RK4: {with_flexlink.LIMIT: with_flexlink.by_step(name, "RK4", settings.budget, LAST_ERROR)},
        MUJOCO: {} if scene.motion else with_mujoco.points(name, scene, settings.budget, LAST_ERROR),
        SOLVERS: _solvers(name, settings) if name in settings.solver_scenes else {},
    }
    if settings.pinocchio:
        found[PINOCCHIO] = with_pinocchio.points(name, settings.pinocchio_tolerances, settings.pinocchio, LAST_ERROR)
    for engine in settings.witnesses if name in settings.witness_scenes else ():
        with contextlib.suppress(MissingDependencyError):
            found[contestants.WITNESSES[engine]] = contestants.witnessed(engine, name, settings.budget, LAST_ERROR)
    return found


def _solvers(name: str, settings: SpeedTradeSettings) -> Ladders:
    form, found = FirstOrder(trade_scene(name)).compiled(), dict[str, list[Point]]()
    for solver in settings.solvers:
        with contextlib.suppress(MissingDependencyError):  # CVODE is optional; SciPy's best solver is present
            found[solver] = contestants.refined(name, form, solver, settings.solver_tolerances)
    return found


def _rows(name: str, aim: Aim, ours: Ladders, others: dict[str, Ladders]) -> Iterator[Measured]:
    ours, others = _seen(aim, ours), {group: _seen(aim, ladders) for group, ladders in others.items()}
    for method in ours:
        if own := with_flexlink.cheapest({method: ours[method]}, aim.error):
            yield Measured("CPU time", 1e3 * own[1].seconds, name, varied=aim.facts(method), timed=True)
            yield Measured("evaluations", own[1].evaluations, name, varied=aim.facts(method), timed=True)
    for group, ladders in others.items():
        costs = {each: known for each, points in ladders.items() if (known := _cost(group, each, points, aim.error))}
        for each, known in costs.items():
            time, facts = 1e3 * known.seconds, aim.facts(each)
            yield Measured("CPU time", time, name, group, facts, note=NOTES[known.kind], timed=True)
            work = [point._replace(seconds=float(point.evaluations)) for point in ladders[each]]
            if (evaluations := _cost(group, each, work, aim.error)) and evaluations.seconds:
                yield Measured("evaluations", round(evaluations.seconds), name, group, facts, timed=True)
        if costs:
            best = with_flexlink.cheapest(ours if group == RK4 else ours | others[RK4], aim.error)
            yield from _ratios(name, group, aim, costs, best)


def _seen(aim: Aim, ladders: Ladders) -> Ladders:
    return {name: [aim.point(point) for point in points] for name, points in ladders.items()}


def _ratios(
    name: str, group: str, aim: Aim, costs: Mapping[str, Cost], best: tuple[str, Point] | None
) -> Iterator[Measured]:
    """Yield the cost of a group's cheapest run relative to flexlink's; 0 if flexlink does not reach the error."""
    least = min(costs, key=lambda each: costs[each].seconds)
    ratio = costs[least].seconds / best[1].seconds if best else 0.0
    note = f"{least}: {1e3 * costs[least].seconds:.4g} ms; {_run_in_words(best)}. {NOTES[costs[least].kind]}".strip()
    quantity = f"{group} / flexlink, {aim.what} {aim.error:g}"
    named = (quantity, f"{name}, {quantity}") + ((f"{quantity}{HARD_SCENE}",) if _is_damped_or_spatial(name) else ())
    for each in named:
        yield Measured(each, ratio, name, group, {aim.what: aim.error}, note=note, timed=True)


HARD_SCENE = ", damped or spatial"


def _is_damped_or_spatial(name: str) -> bool:
    """Whether the springs of a scene have dampers, or its hinge axes are not all parallel."""
    chain = lump(trade_scene(name))
    dampers = [chain.hinges["damping"][k] for k, c in enumerate(chain.coordinates) if c.segment > 0]
    return max(dampers, default=0.0) > 0.0 or not chain.is_planar


def _cost(group: str, name: str, points: Sequence[Point], error: float) -> Cost | None:
    return cost(points, error, ORDERS_OF_OTHERS.get(group, {}).get(name, ORDER_OF_RK4))


def _run_in_words(best: tuple[str, Point] | None) -> str:
    if best is None:
        return "flexlink does not reach this error"
    return f"{best[0]}, setting {best[1].setting:.2g}: {1e3 * best[1].seconds:.4g} ms"


def _series(name: str, ladders: Ladders) -> Series:
    rows = [
        (method, point.setting, point.error, point.seconds, point.bend, point.evaluations)
        for method, points in ladders.items()
        for point in points
        if point.error < math.inf
    ]
    title = f"{name}: {scenes()[name].about}"
    columns, (_, _, x, y, *_) = table(COLUMNS, rows), COLUMNS
    return Series("work", title, columns, x, x, y, "log", "log", group="method", scene=name)


ROUNDS, REPEATS = 3, 5
RIGID, OF_ORDER = ", rigid", 1e-4  # suffix for arms without springs, at errors up to 1e-4
CLOCKS = {"prepared": prepared, "description": described}
ORDERS: Mapping[str, Mapping[str, float]] = {"MuJoCo": with_mujoco.ORDER, "Pinocchio": with_pinocchio.ORDER}


@kind(timed=True)
def speed_whole(
    case: Case,
    scenes: tuple[str, ...],
    errors: tuple[Positive, ...],
    methods: tuple[str, ...],
    budget: Positive,
    pinocchio: int,
    pinocchio_tolerances: tuple[Positive, ...],
) -> Iterator[Measured]:
    """Time for a given error in complete calls by a user: flexlink against MuJoCo and Pinocchio.

    prepared      flexlink repeats a run, which includes its tips, energies and checks; of other programs only the
                  steps of a loaded model are timed
    description   from the text of the description (a scene file, an MJCF, a URDF) to the result

    Times are CPU times of the thread with everything compiled, the fastest of several rounds. Other programs' times are
    interpolated between their runs and extrapolated by order; for flexlink only runs that met the error count.
    Pinocchio's time is that of its evaluations in a C++ loop only.

    Yield times of both kinds of calls by method, and ratios of other programs' shortest times to flexlink's.

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
                yield from _whole_rows(name, what, error, ladders, others)


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


def _whole_rows(
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
