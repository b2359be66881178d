"""What an error costs with flexlink: its methods with a ladder of tolerances, RK4 with one of steps from its limit on.

The clock runs while steps are taken and the states of samples filled in, as MuJoCo's runs in `mj_step`; setting a run
up, and tips, energies and the judgement of its samples, cost another few milliseconds, whatever its length.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence

import flexlink as fl
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import deferred
from flexlink.describe.scene import Scene
from flexlink.motion.single import SingleRun
from flexlink.motion.start import initial_state
from validation.benchmarks.trade import OUTPUTS, motion_of, reference, tip_error, trade_scene
from validation.timing.mujoco_runs import Timed
from validation.timing.work_precision import Point, ladder

COARSEST, FINER = 0.3, 10**-0.25  # of the motion, the first tolerance; each is so much of the one before
OF_STABLE = 0.98  # of the largest stable step at the start
SHORT = 0.01  # s
TOO_DEAR = 2.0  # budgets: a run that takes longer is not waited for
LIMIT = "RK4 at its limit"


def timed_run(scene: Scene, longest: float = math.inf) -> Timed:
    """A run of a scene: the time of its steps alone; errors as in `simulate`, and of one longer than `longest` [s]."""
    run = SingleRun(scene)
    begun = time.thread_time()
    for _ in run.steps:
        if time.thread_time() - begun > longest:
            raise TooDearError(f"{scene.name}: {scene.run.method} takes more than {longest:g} s")
    seconds = time.thread_time() - begun
    with deferred() as stop:
        return Timed(SingleRun(scene).finish(stop).tip, seconds)


class TooDearError(FlexlinkError):
    """A run takes longer than it may."""


def by_tolerance(name: str, method: str, budget: float, smallest: float) -> list[Point]:
    """Runs of a method with finer and finer tolerances, until the error is met or a run passes the budget."""
    scene, points, tolerance = trade_scene(name), list[Point](), COARSEST * motion_of(reference(name))
    while not points or (points[-1].error > smallest and points[-1].seconds < budget):
        try:
            run = scene.varied({"run.method": method, "run.tolerance": tolerance})
            points.append(_point(name, run, tolerance, TOO_DEAR * budget))
        except TooDearError:  # finer ones would be, too
            break
        tolerance *= FINER
    return points


def _point(name: str, scene: Scene, setting: float, longest: float = math.inf) -> Point:
    """The fastest of some runs, more of them if they are short; an error of infinity if it ends in one.

    Raises
    ------
    TooDearError
        A run takes more than `longest` [s].
    """
    try:
        runs = [timed_run(scene, longest), timed_run(scene)]
        runs += [timed_run(scene) for _ in range(3 if runs[0].seconds < SHORT else 0)]
    except TooDearError:
        raise
    except FlexlinkError:
        return Point(setting, math.inf, 0.0)
    return Point(setting, tip_error(name, runs[0].tip), min(run.seconds for run in runs))


def rk4(name: str, budget: float, smallest: float) -> list[Point]:
    """Runs of RK4 from its largest stable step on; one without error (nan), told by its beginning, if it is longer."""
    scene = trade_scene(name)
    chain, sample = lump(scene), scene.run.sample
    stable = fl.stable_step(chain, *initial_state(scene, chain), method="RK4")
    first = math.ceil(sample / (OF_STABLE * stable))
    stepped = {"run.method": "RK4", "run.unstable": "allow"}
    beginning = scene.varied(stepped | {"run.step": sample / first, "run.duration": sample})
    whole = OUTPUTS * min(timed_run(beginning).seconds for _ in range(2))
    if whole > budget:
        return [Point(sample / first, math.nan, whole)]

    def run(steps: int) -> Point:
        return _point(name, scene.varied(stepped | {"run.step": sample / steps}), sample / steps)

    return ladder(run, first, budget, smallest)


def cheapest(ladders: Mapping[str, Sequence[Point]], target: float) -> tuple[str, Point] | None:
    """The method and the run that met an error in the least time; None if none did."""
    met = [
        (point.seconds, name, point) for name, points in ladders.items() for point in points if point.error <= target
    ]
    return min(met)[1:] if met else None
