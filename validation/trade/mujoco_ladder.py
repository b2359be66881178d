"""Time for a given error with each of MuJoCo's integrators, from runs with finer and finer steps."""

from __future__ import annotations

from validation.trade.mujoco_runs import INTEGRATORS, MujocoRuns
from validation.trade.scenes import OUTPUTS, point, seen, trade_scene
from validation.trade.work_precision import Point, ladders

EVALUATIONS_OF_A_STEP = {"RK4": 4}  # of the others one
ORDER = {"Euler": 1.0, "implicit": 1.0, "implicitfast": 1.0, "discrete": 1.0, "RK4": 4.0}


def points(name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Ladders of all integrators on a scene of the trade; RK4 begins at its limit of stability, as flexlink has it."""
    runs = MujocoRuns(trade_scene(name))

    def run(integrator: str, steps: int) -> Point:
        timed = runs.run(integrator, steps)
        evaluations = EVALUATIONS_OF_A_STEP.get(integrator, 1) * OUTPUTS * steps
        return point(name, seen(runs.chain, timed.q), runs.scene.run.sample / steps, timed.seconds, evaluations)

    return ladders(runs.scene, INTEGRATORS, run, runs.seconds_a_step, budget, smallest)
