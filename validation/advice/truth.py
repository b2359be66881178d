"""Independent references for advice: tip paths, the cost of a naive model, and the cost of the cheapest model.

The reference model has all axes of all beams and hinges at Gauss points, and is integrated by Radau IIA of order 9 with
a separate tolerance. Chains with more and more hinges are extrapolated until two successive limits agree. The reference
shares no screening, error estimate or candidate model with the advice.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.advice.goal import Thresholds
from flexlink.advice.model import Axes, Bend, Model, all_axes, can_move, uniform
from flexlink.advice.model_runner import ModelRunner, Stepping
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.results.convergence import change_of_limit, extrapolated
from flexlink.results.tip_motion import distances, largest_distance, largest_so_far, tip_travel

LEVELS = (4, 6, 8, 12, 16, 24, 32, 48)
METHOD, OF_MOTION = "Radau9", (1e-6, 1e-9)
CHECKED, STRICTER = 6, 0.1
"""Hinges of the model that checks time-stepping errors; its tolerance as a fraction of the other models' tolerance."""

NAIVE = 8
"""Number of three-axis hinges per link of the naive model, which is integrated by RK4 with its stable step."""

GRID = {"midpoint": (1, 2, 3, 4, 6), "gauss": (2, 4, 6, 8, 12, 16), "legendre": (3, 4, 5, 6, 8)}
FACTORS = (1.0, 0.5)
TOLERANCES = (1.0, 0.3, 0.1)
"""Tolerances of the grid's steps, relative to the goal: none beyond it, since a run promises its tolerance."""

METHODS = ("Radau5", "DOP853")
LAST_STEP = 50
"""Evaluations that a step may need; a run ends before its limit if one more step could exceed it."""


class Truth(NamedTuple):
    """Tip path (samples, 3), its travel, and its estimated error up to each sample (samples,) [m]."""

    tip: Array
    motion: float
    errors: Array

    @property
    def error(self) -> float:
        """Estimate of the path's largest error over the whole run [m]."""
        return float(self.errors[-1])


def truth(scene: Scene, within: float, budget: float) -> Truth:
    """Extrapolate finer and finer models until the limit changes by at most `within` × motion or the budget is spent.

    All models may have the same time-stepping error. One coarse model with a stricter tolerance estimates this error;
    if it is not small, as in sensitive motion, all models are run again with a stricter tolerance.
    """
    found: list[Truth] = []
    for of_motion in OF_MOTION:
        limit, of_steps = _limit(scene, within, budget, of_motion)
        found.append(limit._replace(errors=limit.errors + of_steps))
        if of_steps[-1] <= within * limit.motion:
            break
    return min(found, key=lambda true: int((true.errors > within * true.motion).sum()))


def _limit(scene: Scene, within: float, budget: float, of_motion: float) -> tuple[Truth, Array]:
    """The extrapolated limit, and the time-stepping error of the models up to each sample (samples,) [m]."""
    runner, axes = ModelRunner(scene, budget), all_axes(scene)
    levels: list[tuple[int, Array]] = []
    motion, errors = 1.0, np.full(scene.run.samples, np.inf)
    for hinges in LEVELS:
        tip = _tip_of(runner, uniform(axes, hinges), of_motion * motion)
        if tip is None:
            break
        levels.append((hinges, tip))
        motion = tip_travel(tip)
        if len(levels) > 2:
            errors = largest_so_far(distances(change_of_limit(levels), np.zeros(3)))
            if errors[-1] <= within * motion:
                break
    strict = _tip_of(runner, uniform(axes, CHECKED), of_motion * STRICTER * motion)
    tip = extrapolated(levels).tip if len(levels) > 1 else np.full((scene.run.samples, 3), np.nan)
    checked = [tip for hinges, tip in levels if hinges == CHECKED]
    of_steps = (
        largest_so_far(distances(strict, checked[0]))
        if checked and strict is not None
        else np.full_like(errors, np.inf)
    )
    return Truth(tip, motion, errors), of_steps


def _tip_of(runner: ModelRunner, model: Model, tolerance: float) -> Array | None:
    for name in (METHOD, "auto"):
        outcome = runner.run(model, Stepping(name, tolerance=tolerance))
        if outcome.completed:
            return outcome.tip
    return None


def naive_cost(scene: Scene) -> float:
    """CPU time of the naive model [s], estimated from its evaluations without running it."""
    runner, model = ModelRunner(scene, np.inf), uniform(all_axes(scene), NAIVE)
    stepping = runner.fixed_steps(Thresholds.stable_share * runner.stable_step(model))
    return np.inf if stepping is None else runner.fixed_steps_cost(model, stepping)


def cheapest(scene: Scene, true: Truth, allowed: dict[float, float], axes: Axes) -> dict[float, float]:
    """Lowest cost [s] of a model with these axes for each tolerance [m], or the `allowed` cost if no model is cheaper.

    Each link is rigid or has a rule and a number of hinges from a grid; every combination is tried with every method.
    A run is stopped once it costs more than the cheapest known run for every tolerance. What counts is the run that
    `simulate` returns.
    """
    best = dict(allowed)
    for model in _grid(scene, axes):
        runner = ModelRunner(scene, np.inf)  # all runs of a model share its chain
        for stepping in _steppings(runner, model, best):
            runner.budget = max(best.values())
            runner.scene = _within_budget(scene, runner, model, stepping)
            if stepping.step is not None and runner.fixed_steps_cost(model, stepping) >= runner.budget:
                continue
            outcome = runner.run(model, stepping, compared=True)
            if outcome.completed:
                least = max(largest_distance(outcome.tip, true.tip), stepping.tolerance or 0.0)
                best |= {goal: min(cost, outcome.seconds) for goal, cost in best.items() if least <= goal}
    return best


def _within_budget(scene: Scene, runner: ModelRunner, model: Model, stepping: Stepping) -> Scene:
    """The scene with as many evaluations as the runner's budget allows, if each costs as little as possible.

    The runner itself checks its budget every 50 ms only, and most of these runs should end sooner.
    """
    one = runner.evaluation_cost(model, explicit=method(stepping.method).explicit)
    most = min(scene.run.max_evaluations, runner.budget / one + LAST_STEP)
    return replace(scene, run=replace(scene.run, max_evaluations=most))


def _grid(scene: Scene, axes: Axes) -> Iterator[Model]:
    choices: list[list[Bend | None]] = [
        [None] + [Bend(flex, rule, n) for rule, counts in GRID.items() for n in counts if flex != "rigid"]
        for flex in axes
    ]
    models = [model for model in itertools.product(*choices) if can_move(scene, model)]
    return iter(sorted(models, key=lambda model: sum(bend.hinges for bend in model if bend)))


def _steppings(runner: ModelRunner, model: Model, best: dict[float, float]) -> Iterator[Stepping]:
    stable = runner.stable_step(model)
    for factor in FACTORS:
        stepping = runner.fixed_steps(factor * Thresholds.stable_share * stable)
        if stepping is not None:
            yield stepping
    for name, tolerance, factor in itertools.product(METHODS, best, TOLERANCES):
        yield Stepping(name, tolerance=factor * tolerance)
