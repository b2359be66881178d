"""Time for a given error with flexlink: adaptive methods with finer and finer tolerances, others with finer steps.

Explicit methods begin with their largest stable step, implicit methods with the time between outputs.

`timed_run` times the steps and the interpolation of samples, which is comparable to MuJoCo's `mj_step`; `whole_calls`
also times set-up, tips, energies and the check of samples.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from flexlink.results.tip_motion import tip_travel
from validation.runs import stable_steps
from validation.trade.scenes import OUTPUTS, Seen, point, reference, seen, trade_scene
from validation.trade.work_precision import Point, ladder

COARSEST, FINER = 0.3, 10**-0.25  # first tolerance, fraction of the motion; ratio of successive tolerances
OF_STABLE = 0.98  # fraction of the largest stable step at the initial state
TOO_DEAR = 2.0  # times the budget; a run that takes longer is aborted
LIMIT = "RK4 at its limit"


class Timed(NamedTuple):
    """A run: its outputs, CPU seconds of its steps, evaluations."""

    seen: Seen
    seconds: float
    evaluations: int


def timed_run(scene: Scene, longest: float = math.inf) -> Timed:
    """Run a scene and time only its steps; raises `simulate`'s errors, and TooDearError if it exceeds `longest` [s]."""
    run = SingleRun(problem_of(scene))
    monitor, rows, begun = run.monitor, 1, time.thread_time()
    for rows, _ in run.steps:  # noqa: B007  the last value is used
        if run.steps.failure:
            break
        if time.thread_time() - begun > longest:
            raise TooDearError(f"{scene.name}: {scene.run.method} takes more than {longest:g} s")
    seconds = time.thread_time() - begun
    if not monitor.check(rows, run.steps.steps) or run.steps.failure:  # no second run: a reference measures the error
        raise monitor.diverged(run.steps.failure)
    return Timed(seen(monitor.record.chain, monitor.record.q), seconds, run.steps.steps.evaluations)


class TooDearError(FlexlinkError):
    """A run takes longer than its limit."""


Clock = Callable[[Scene, float], Timed]
"""Makes and times a run; may raise a TooDearError after the given number of seconds."""


def by_tolerance(name: str, method: str, budget: float, smallest: float, clock: Clock = timed_run) -> list[Point]:
    """Run a method with finer and finer tolerances, until both errors are ≤ `smallest` or a run exceeds the budget.

    If a finer tolerance needs no more evaluations, stability limits the steps; three tolerances are then skipped.
    """
    scene, points, motion, rung = trade_scene(name), list[Point](), tip_travel(reference(name).tip), 0
    while rung < 48:  # the last tolerance is 5e-13 of the motion, below rounding error
        tolerance = COARSEST * motion * FINER**rung
        try:
            run = scene.varied({"run.method": method, "run.tolerance": tolerance})
            points.append(_point(name, run, tolerance, TOO_DEAR * budget, clock))
        except TooDearError:  # finer tolerances would take even longer
            break
        if points[-1].worst <= smallest or points[-1].seconds >= budget:
            break
        rung += 4 if _bound_by_stability(points) else 1  # 4: a decade
    return points


def _bound_by_stability(points: Sequence[Point]) -> bool:
    """Whether stability limits the steps: the last two runs took nearly the same number of evaluations."""
    last, before = points[-1].evaluations, points[-2].evaluations if len(points) > 1 else 0
    return abs(last - before) < 0.02 * before


def _point(name: str, scene: Scene, setting: float, longest: float = math.inf, clock: Clock = timed_run) -> Point:
    """The fastest of several runs, more if they are short, as a point; its error is infinite if a run fails.

    Raises
    ------
    TooDearError
        A run takes more than `longest` [s].
    """
    best = fastest(scene, longest, clock)
    if best is None:
        return Point(setting, math.inf, 0.0)
    return point(name, best.seen, setting, best.seconds, best.evaluations)


def fastest(scene: Scene, longest: float = math.inf, clock: Clock = timed_run) -> Timed | None:
    """The fastest of several runs, more if they are short; None if a run fails.

    Raises
    ------
    TooDearError
        A run takes more than `longest` [s].
    """
    try:
        runs = [clock(scene, longest)]
        more = 4 if runs[0].seconds < 0.01 else 1 if runs[0].seconds < 0.2 else 0
        runs += [clock(scene, math.inf) for _ in range(more)]
    except TooDearError:
        raise
    except FlexlinkError:
        return None
    return min(runs, key=lambda run: run.seconds)


def by_step(name: str, method: str, budget: float, smallest: float) -> list[Point]:
    """Run a method with its largest stable step and finer ones; only time it if the first run exceeds the budget."""
    scene = trade_scene(name)
    sample, first = scene.run.spacing, stable_steps(scene, method, OF_STABLE)
    stepped = {"run.method": method, "run.unstable": "allow"}
    beginning = scene.varied(stepped | {"run.step": sample / first, "run.duration": sample})
    try:
        whole = OUTPUTS * min(timed_run(beginning, budget).seconds for _ in range(2))
    except TooDearError:
        return []
    except FlexlinkError:  # the steps are too long for the implicit iteration; finer ones follow
        whole = 0.0
    if whole > budget:
        return [Point(sample / first, math.nan, whole)]

    def run(steps: int) -> Point:
        return _point(name, scene.varied(stepped | {"run.step": sample / steps}), sample / steps)

    return ladder(run, first, budget, smallest)


def cheapest(ladders: Mapping[str, Sequence[Point]], target: float) -> tuple[str, Point] | None:
    """The method and run that met an error in the least time; None if none did."""
    met = [
        (point.seconds, name, point) for name, points in ladders.items() for point in points if point.error <= target
    ]
    return min(met)[1:] if met else None
