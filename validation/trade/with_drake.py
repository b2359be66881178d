"""Drake's error-controlled integrators on the exported SDF.

Scenes with a drive, dry friction or load are excluded, since Drake would call Python for them. Only the advance of
Drake's simulator is timed, which involves no Python. Its `runge_kutta5` and `bogacki_shampine3` are excluded: on a
damped chain they do not pass the first outputs within half a minute.
"""

from __future__ import annotations

import time

import numpy as np
from pydrake.systems.analysis import ResetIntegratorFromFlags

from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.describe.scene import Scene
from flexlink.motion.inputs.initial_state import initial_state
from flexlink.motion.inputs.problem import problem_of
from flexlink_witnesses.drake import DrakeEngine
from validation.trade.contestants import TooDearError, refined
from validation.trade.work_precision import Point, Run

SCHEMES = ("implicit_euler", "radau3", "runge_kutta3")
ACCURACIES = tuple(10.0**-digits for digits in range(1, 13))  # of at least one digit in Drake


def points(name: str, scene: Scene, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Run all integrators with finer and finer accuracies, until both errors are small or a run exceeds the budget."""
    drake = Drake(scene, 2.0 * budget)  # longer runs are aborted

    def ends(last: Point) -> bool:
        return last.worst <= smallest or last.seconds > budget

    return {scheme: refined(name, drake, scheme, ACCURACIES, ends) for scheme in SCHEMES}


class Drake:
    """A scene in Drake, whose runs take at most `longest` [s]."""

    def __init__(self, scene: Scene, longest: float) -> None:
        self.scene, self.chain, self.longest = scene, lump(scene), longest
        self.engine, self.start = DrakeEngine(self.chain), initial_state(scene, self.chain)

    def run(self, scheme: str, accuracy: float) -> Run:
        """Run with an error-controlled integrator."""
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
            except RuntimeError as error:
                raise FlexlinkError(f"{self.scene.name}: Drake's {scheme} gives up: {error}") from None
            seconds += time.thread_time() - begun
            if seconds > self.longest:
                raise TooDearError(f"{self.scene.name}: Drake's {scheme} takes more than {self.longest:g} s")
            q.append(np.array(plant.GetPositions(state)))
        return Run(np.array(q), seconds, integrator.get_num_derivative_evaluations())
