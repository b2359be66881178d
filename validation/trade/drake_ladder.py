"""Time for a given error with Drake's error-controlled integrators on the exported SDF.

Scenes with a drive, dry friction or load are excluded, since Drake would call Python for them. Only the advance of
Drake's simulator is timed, which involves no Python. Its `runge_kutta5` and `bogacki_shampine3` are excluded: on a
damped chain they do not pass the first outputs within half a minute.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags

from flexlink.chain.lumping import lump
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.engines.drake import DrakeEngine
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from validation.trade.scenes import point, seen, trade_scene
from validation.trade.work_precision import Point

SCHEMES = ("implicit_euler", "radau3", "runge_kutta3")


def points(name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators with finer and finer accuracies, until both errors are small or a run exceeds the budget."""
    runs = DrakeRuns(trade_scene(name))
    return {scheme: _ladder(name, runs, scheme, budget, smallest) for scheme in SCHEMES}


def _ladder(name: str, runs: DrakeRuns, scheme: str, budget: float, smallest: float) -> list[Point]:
    found: list[Point] = []
    for digits in range(1, 13):  # required digits of accuracy, at least one in Drake
        accuracy = 10.0**-digits
        run = runs.run(scheme, accuracy, 2.0 * budget)  # longer runs are aborted
        if run is None:
            break
        if run.q is None:
            found.append(Point(accuracy, math.inf, 0.0))
        else:
            found.append(point(name, seen(runs.chain, run.q), accuracy, run.seconds, run.evaluations))
        if found[-1].worst <= smallest or found[-1].seconds > budget:
            break
    return found


class DrakeRun(NamedTuple):
    """Angles at the samples (samples, n), None if Drake gives up; CPU seconds; evaluations."""

    q: Array | None
    seconds: float
    evaluations: int = 0


class DrakeRuns:
    """A scene in Drake."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.chain = scene, lump(scene)
        self.engine, self.start = DrakeEngine(self.chain), initial_state(scene, self.chain)

    def run(self, scheme: str, accuracy: float, longest: float) -> DrakeRun | None:
        """Run once; None if the run takes more than `longest` [s]."""
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
                return DrakeRun(None, seconds)
            seconds += time.thread_time() - begun
            if seconds > longest:
                return None
            q.append(np.array(plant.GetPositions(state)))
        return DrakeRun(np.array(q), seconds, integrator.get_num_derivative_evaluations())
