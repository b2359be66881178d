"""flexlink: adaptive methods with finer and finer tolerances, others with finer steps.

Explicit methods begin with their largest stable step, implicit methods with the time between outputs.

`timed_run` times the steps and the interpolation of samples, which is comparable to MuJoCo's `mj_step`; `prepared` and
`described` also time set-up, tips, energies and the check of samples.
"""

from __future__ import annotations

import math
import tempfile
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import flexlink as fl
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.memo import Memo
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from flexlink.results.tip_motion import tip_travel
from flexlink.results.trajectory import Trajectory
from validation.runs import stable_steps
from validation.trade.contestants import TooDearError, attempt, by_steps
from validation.trade.scenes import OUTPUTS, reference, trade_scene
from validation.trade.work_precision import Point, Run

COARSEST, FINER = 0.3, 10**-0.25  # first tolerance, fraction of the motion; ratio of successive tolerances
OF_STABLE = 0.98  # fraction of the largest stable step at the initial state
TOO_DEAR = 2.0  # times the budget; a run that takes longer is aborted
LIMIT = "RK4 at its limit"
PROBLEMS = Memo(4)

Clock = Callable[[Scene, float], Run]
"""Makes and times a run; may raise a TooDearError after the given number of seconds."""


def timed_run(scene: Scene, longest: float = math.inf) -> Run:
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
    return Run(monitor.record.q, seconds, run.steps.steps.evaluations)


def prepared(scene: Scene, _longest: float) -> Run:
    """Time a complete call that runs a problem which has run before."""

    def run_once() -> fl.Problem:
        problem = fl.Problem(scene)
        _quietly(problem.simulate)
        return problem

    return _timed(PROBLEMS(scene, None, run_once).simulate)


def described(scene: Scene, _longest: float) -> Run:
    """Time reading a scene file, lumping a new chain and running it."""
    with tempfile.TemporaryDirectory() as folder:
        path = scene.save(Path(folder) / "scene.toml")
        return _timed(lambda: fl.simulate(fl.load_scene(path)))


def _timed(run: Callable[[], Trajectory]) -> Run:
    begun = time.thread_time()
    trajectory = _quietly(run)
    seconds = time.thread_time() - begun
    return Run(trajectory.q, seconds, 0 if trajectory.steps is None else trajectory.steps.evaluations)


def _quietly(run: Callable[[], Trajectory]) -> Trajectory:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # about doubtful results; here a reference measures the error
        return run()


class Flexlink:
    """A scene in flexlink; a run counts by the fastest of several, more if they are short."""

    def __init__(self, scene: Scene, longest: float = math.inf, clock: Clock = timed_run) -> None:
        self.scene, self.chain, self.longest, self.clock = scene, lump(scene), longest, clock

    def run(self, method: str, setting: float) -> Run:
        """Run with a tolerance."""
        return self.fastest({"run.method": method, "run.tolerance": setting})

    def fastest(self, changes: Mapping[str, object]) -> Run:
        """The fastest of several runs with these changes of the scene."""
        scene = self.scene.varied(changes)
        runs = [self.clock(scene, self.longest)]
        more = 4 if runs[0].seconds < 0.01 else 1 if runs[0].seconds < 0.2 else 0
        runs += [self.clock(scene, math.inf) for _ in range(more)]
        return min(runs, key=lambda run: run.seconds)


class Stepped(Flexlink):
    """The same with fixed steps."""

    def run(self, method: str, setting: float) -> Run:
        """Run with a number of steps between samples."""
        step = self.scene.run.spacing / setting
        return self.fastest({"run.method": method, "run.unstable": "allow", "run.step": step})


def by_tolerance(name: str, method: str, budget: float, smallest: float, clock: Clock = timed_run) -> list[Point]:
    """Run a method with finer and finer tolerances, until both errors are ≤ `smallest` or a run exceeds the budget.

    If a finer tolerance needs no more evaluations, stability limits the steps; three tolerances are then skipped.
    """
    points, motion, rung = list[Point](), tip_travel(reference(name).tip), 0
    ours = Flexlink(trade_scene(name), TOO_DEAR * budget, clock)
    while rung < 48:  # the last tolerance is 5e-13 of the motion, below rounding error
        try:
            points.append(attempt(name, ours, method, COARSEST * motion * FINER**rung))
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


def by_step(name: str, method: str, budget: float, smallest: float) -> list[Point]:
    """Run a method with its largest stable step and finer ones; only time it if the first run exceeds the budget."""
    scene = trade_scene(name)
    sample, first = scene.run.spacing, stable_steps(scene, method, OF_STABLE)
    changes = {"run.method": method, "run.unstable": "allow", "run.step": sample / first, "run.duration": sample}
    beginning = scene.varied(changes)
    try:
        whole = OUTPUTS * min(timed_run(beginning, budget).seconds for _ in range(2))
    except TooDearError:
        return []
    except FlexlinkError:  # the steps are too long for the implicit iteration; finer ones follow
        whole = 0.0
    if whole > budget:
        return [Point(sample / first, math.nan, whole)]
    return by_steps(name, Stepped(scene), method, first, budget, smallest)


def cheapest(ladders: Mapping[str, Sequence[Point]], target: float) -> tuple[str, Point] | None:
    """The method and run that met an error in the least time; None if none did."""
    met = [
        (point.seconds, name, point) for name, points in ladders.items() for point in points if point.error <= target
    ]
    return min(met)[1:] if met else None
