"""Time for a given error with Drake's error-controlled integrators on the exported SDF.

Scenes with a drive, dry friction or load are excluded, since Drake would call Python for them. Only the advance of
Drake's simulator is timed, which involves no Python. Its `runge_kutta5` and `bogacki_shampine3` are excluded: on a
damped chain they do not pass the first outputs within half a minute.
"""

from __future__ import annotations

import math
import time

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags

from flexlink.chain.lumping import lump
from flexlink.engines.drake import DrakeEngine
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from validation.trade.scenes import point, seen, trade_scene
from validation.trade.work_precision import Point

SCHEMES = ("implicit_euler", "radau3", "runge_kutta3")


def points(name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators with finer and finer accuracies, until both errors are small or a run exceeds the budget."""
    runs = DrakeRuns(name)
    return {scheme: _ladder(runs, scheme, budget, smallest) for scheme in SCHEMES}


def _ladder(runs: DrakeRuns, scheme: str, budget: float, smallest: float) -> list[Point]:
    found: list[Point] = []
    for digits in range(1, 13):  # required digits of accuracy, at least one in Drake
        point = runs.run(scheme, 10.0**-digits, 2.0 * budget)  # longer runs are aborted
        if point is None:
            break
        found.append(point)
        if point.worst <= smallest or point.seconds > budget:
            break
    return found


class DrakeRuns:
    """A scene of the trade study in Drake."""

    def __init__(self, name: str) -> None:
        self.name, self.scene = name, trade_scene(name)
        self.chain = lump(self.scene)
        self.engine, self.start = DrakeEngine(self.chain), initial_state(self.scene, self.chain)

    def run(self, scheme: str, accuracy: float, longest: float) -> Point | None:
        """Run once; the error is infinite if Drake gives up; None if the run takes more than `longest` [s]."""
        simulator, plant = self.engine._simulator(problem_of(self.scene, self.chain))
        state = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context())
        plant.SetPositionsAndVelocities(state, np.concatenate(self.start))
        integrator = ResetIntegratorFromFlags(simulator, scheme, self.scene.run.spacing)
        integrator.set_fixed_step_mode(False)
        integrator.set_target_accuracy(accuracy)
        simulator.Initialize()
        q, seconds = [self.start[0]], 0.0
        for t in self.scene.run.times[1:]:
            begun = time.thread_time()
            try:
                simulator.AdvanceTo(t)
            except RuntimeError:
                return Point(accuracy, math.inf, 0.0)
            seconds += time.thread_time() - begun
            if seconds > longest:
                return None
            q.append(np.array(plant.GetPositions(state)))
        evaluations = integrator.get_num_derivative_evaluations()
        return point(self.name, seen(self.chain, np.array(q)), accuracy, seconds, evaluations)
