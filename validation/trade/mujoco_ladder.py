"""Time for a given error with each of MuJoCo's integrators, from runs with finer and finer steps."""

from __future__ import annotations

import math

import flexlink as fl
from validation.trade.mujoco_runs import INTEGRATORS, MujocoRuns
from validation.trade.scenes import OUTPUTS, errors, seen, trade_scene
from validation.trade.work_precision import Point, ladder

EVALUATIONS_OF_A_STEP = {"RK4": 4}  # of the others one
ORDER = {"Euler": 1.0, "implicit": 1.0, "implicitfast": 1.0, "discrete": 1.0, "RK4": 4.0}
STEPS_OF_A_PART = 5000  # steps that tell what a step costs


def points(name: str, budget: float, smallest: float) -> dict[str, list[Point]]:
    """Ladders of all integrators on a scene of the trade; one whose stable steps are past the budget has no point."""
    runs = MujocoRuns(trade_scene(name))
    found = {}
    for integrator in INTEGRATORS:
        first = 1
        if integrator == "RK4":
            first = steps_of_limit(runs)
            whole = _whole(runs, first)
            if whole > budget:
                found[integrator] = [Point(runs.scene.run.sample / first, math.nan, whole)]
                continue

        def run(steps: int, integrator: str = integrator) -> Point:
            timed = runs.run(integrator, steps)
            found = errors(name, seen(runs.chain, timed.q))
            evaluations = EVALUATIONS_OF_A_STEP.get(integrator, 1) * OUTPUTS * steps
            return Point(runs.scene.run.sample / steps, found.tip, timed.seconds, found.bend, evaluations)

        found[integrator] = ladder(run, first, budget, smallest)
    return found


def steps_of_limit(runs: MujocoRuns) -> int:
    """Steps of RK4 between outputs at the largest stable step of the start, as flexlink predicts it."""
    stable = fl.stable_step(runs.chain, runs.start[0], method="RK4")
    return math.ceil(runs.scene.run.sample / stable)


def _whole(runs: MujocoRuns, steps: int) -> float:
    """CPU seconds of RK4's whole run with so many steps between outputs, from a part of it."""
    part = min(steps, STEPS_OF_A_PART)
    return runs.seconds_a_step("RK4", runs.scene.run.sample / steps, part) * steps * OUTPUTS
