"""Pinocchio's ABA in RK4, and in SciPy's DOP853 and Radau.

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
from flexlink.formats.urdf import to_urdf
from validation.runs import stable_steps
from validation.speed.families import timed_states
from validation.speed.pinocchio_models import build_all
from validation.trade.contestants import by_steps, refined
from validation.trade.first_order import FirstOrder
from validation.trade.scenes import trade_scene
from validation.trade.work_precision import Point, Run

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


class Pinocchio:
    """A scene in Pinocchio, whose runs take at most `most` evaluations, because they are slow in Python."""

    def __init__(self, scene: Scene, most: float) -> None:
        self.form = PinocchioForm(scene, most)
        self.scene, self.chain = scene, self.form.chain
        self.aba = seconds_of_aba(self.chain)

    def run(self, method: str, setting: float) -> Run:
        """Run RK4 with a number of steps between samples, SciPy's solvers with a relative tolerance."""
        self.form.evaluations = 0
        try:
            q, _, count = self.form.by_rk4(round(setting)) if method == "RK4" else self.form.by_scipy(method, setting)
        except np.linalg.LinAlgError as error:
            raise FlexlinkError(f"{self.scene.name}: {method} diverges: {error}") from error
        return Run(q, count * self.aba, count)


def loading(chain: Chain) -> Callable[[], object]:
    """A call that reads a chain's URDF and creates its data."""
    text = to_urdf(chain, shapes=False)
    return lambda: pin.buildModelFromXML(text).createData()


def points(name: str, tolerances: Sequence[float], most: int, smallest: float) -> dict[str, list[Point]]:
    """Run RK4 with stable steps, and SciPy's solvers; the time of explicit runs that would be too long is estimated.

    `most` limits the evaluations of a run. `tolerances` are the solvers' relative tolerances; the absolute ones are a
    hundredth of them. Runs with a solver end with the first that fails.
    """
    pinocchio, found = Pinocchio(trade_scene(name), most), dict[str, list[Point]]()
    aba, run = pinocchio.aba, pinocchio.scene.run
    for method in ORDER:
        first = stable_steps(pinocchio.scene, method) if method in EVALUATIONS_OF_A_STEP else 0
        evaluations = EVALUATIONS_OF_A_STEP.get(method, 0) * (run.samples - 1) * first
        if evaluations > most:
            found[method] = [Point(run.spacing / first, math.nan, evaluations * aba, math.nan, evaluations)]
        elif method == "RK4":
            found[method] = by_steps(name, pinocchio, method, first, aba * most, smallest)
        else:
            found[method] = refined(name, pinocchio, method, tolerances, lambda last: last.error == math.inf)
    return found
