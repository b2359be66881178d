"""Time for a given error with Pinocchio's ABA in RK4, and in SciPy's DOP853 and Radau.

Runs are made from Python, but only the number of evaluations × the time of one ABA counts. The time of one ABA is the
least of repeated calls of `abaInParallel` on one thread, a C++ loop over many states, with the fastest type of joints.
The interpreter, SciPy's linear algebra, springs, friction, drives and prescribed motions therefore cost nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import pinocchio as pin

from flexlink.chain.chain import Chain
from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.engines.pinocchio import PinocchioEngine
from validation.runs import stable_steps
from validation.speed.families import timed_states
from validation.speed.pinocchio_models import build_all
from validation.trade.first_order import FirstOrder, Solved
from validation.trade.scenes import OUTPUTS, point, seen, trade_scene
from validation.trade.work_precision import Point, ladder

ORDER = {"RK4": 4.0, "DOP853": 8.0, "Radau": 5.0}
EVALUATIONS_OF_A_STEP = {"RK4": 4, "DOP853": 12}
BATCH, REPEATS = 256, 60


class PinocchioForm(FirstOrder):
    """A scene as y' = f(t, y) with Pinocchio's accelerations, and a limit on the number of evaluations.

    Raises
    ------
    FlexlinkError
        A run exceeds this limit.
    """

    def __init__(self, scene: Scene, most: float = math.inf) -> None:
        super().__init__(scene)
        self.engine, self.most = PinocchioEngine(self.chain), most
        self.pull = self.wrench if self.wrench.any() else None

    def _accelerations(self, q: Array, qd: Array, tau: Array) -> Array:
        if self.evaluations > self.most:
            raise FlexlinkError(f"{self.scene.name}: more than {self.most:,} evaluations in Pinocchio")
        if q.ndim == 1:
            return self.engine.forward_dynamics(q, qd, tau, tip_wrench=self.pull)
        return np.array([self._accelerations(*row) for row in zip(q, qd, tau, strict=True)])


def seconds_of_aba(chain: Chain) -> float:
    """Least CPU seconds of an ABA in a C++ loop on this thread, over all joint types that fit the chain.

    Raises
    ------
    FlexlinkError
        This build of Pinocchio has no such loop.
    """
    if not pin.WITH_OPENMP:
        raise FlexlinkError("this Pinocchio is built without OpenMP: it has no C++ loop of ABA to time")
    states, best = timed_states(chain, BATCH), math.inf
    for model, sign in build_all(chain).values():
        pool = pin.ModelPool(model, 1)
        q, qd, tau, qdd = (np.asfortranarray((part * sign).T) for part in states)
        for _ in range(REPEATS):
            begun = time.thread_time()
            pin.abaInParallel(1, pool, q, qd, tau, qdd)
            best = min(best, (time.thread_time() - begun) / BATCH)
    return best


def points(name: str, tolerances: Sequence[float], most: int, smallest: float) -> dict[str, list[Point]]:
    """Run RK4 with stable steps, and SciPy's solvers; the time of explicit runs that would be too long is estimated.

    `most` limits the evaluations of a run, because runs are slow in Python. `tolerances` are the solvers' relative
    tolerances; the absolute ones are a hundredth of them.
    """
    form = PinocchioForm(trade_scene(name), most)
    aba, found = seconds_of_aba(form.chain), dict[str, list[Point]]()
    for method, a_step in EVALUATIONS_OF_A_STEP.items():
        first = stable_steps(form.scene, method)
        evaluations = a_step * OUTPUTS * first
        if evaluations > most:
            too_long = Point(form.scene.run.spacing / first, math.nan, evaluations * aba, math.nan, evaluations)
            found[method] = [too_long]
        elif method == "RK4":
            longest = aba * most

            def run(steps: int) -> Point:
                return _point(name, form, form.scene.run.spacing / steps, aba, lambda: form.by_rk4(steps))

            found[method] = ladder(run, first, longest, smallest)
        else:
            found[method] = _by_tolerance(name, form, method, aba, tolerances)
    return found | {"Radau": _by_tolerance(name, form, "Radau", aba, tolerances)}


def _by_tolerance(name: str, form: PinocchioForm, method: str, aba: float, tolerances: Sequence[float]) -> list[Point]:
    found = []
    for relative in tolerances:
        point = _point(name, form, relative, aba, lambda r=relative: form.by_scipy(method, r))  # type: ignore[misc]
        found.append(point)
        if point.error == math.inf:  # finer tolerances take even more evaluations
            break
    return found


def _point(name: str, form: PinocchioForm, setting: float, aba: float, run: Callable[[], Solved]) -> Point:
    form.evaluations = 0
    try:
        solved = run()
    except FlexlinkError:
        return Point(setting, math.inf, 0.0)
    return point(name, seen(form.chain, solved.q), setting, solved.evaluations * aba, solved.evaluations)
