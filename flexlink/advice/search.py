"""Search for the cheapest model and steps; models are predicted from the order of convergence, corrected by a few runs.

With adaptive steps, the model is found with small step errors; then the tolerance is increased while the error is
allowed. A finer model with a larger tolerance is tried once. Fixed steps are tried if they are predicted to be cheaper.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexlink.advice.allocation import Allocation
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Bend, Model, can_move
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.thresholds import Thresholds


class Solution(NamedTuple):
    """A run whose error is allowed."""

    model: Model
    outcome: Outcome
    error: float  # relative to the limit [m]


class Search:
    """Search for the cheapest run whose error is allowed; `solution` is the best run so far."""

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, allowed: float) -> None:
        self.runner, self.link_errors, self.allowed = runner, link_errors, allowed  # error relative to the limit [m]
        self.solution: Solution | None = None
        self._stable_steps: dict[tuple[int, Bend], float] = {}

    def best(self) -> Solution | None:
        """The cheapest solution; None if there is none."""
        for factor in (1.0, 0.25, 0.06):  # step tolerance, relative to the allowed error
            if self._fit(0.95, self._implicit_cost, functools.partial(self._by_tolerance, factor * self.allowed)):
                break
        self._loosen()
        if self.solution is not None and (loosest := self.solution.outcome.stepping.tolerance):
            self._fit(0.6, self._implicit_cost, functools.partial(self._by_tolerance, 2 * loosest))
            self._loosen()
        for part in (1.0, 0.5):
            if self._fit(0.98, functools.partial(self._fixed_cost, part), functools.partial(self._fixed, part)):
                break
        return self.solution

    def accept(self, model: Model, outcome: Outcome) -> bool:
        """Adopt a run if its error is allowed and no earlier run is cheaper; return whether its error is allowed."""
        error = self.link_errors.from_limit(outcome.tip)
        good = outcome.completed and error <= self.allowed
        if good and (self.solution is None or outcome.seconds < self.solution.outcome.seconds):
            self.solution = Solution(model, outcome, error)
        return good

    def _fit(
        self, share: float, cost: Callable[[Model], float], stepping_of: Callable[[Model], Stepping | None]
    ) -> bool:
        """Run the cheapest models for a share of the allowed error; return False if their steps fail."""
        allocation, least = Allocation(self.link_errors, cost), np.inf
        for _ in range(6):
            model = allocation.cheapest(share * self.allowed)
            if model is None or cost(model) >= least:
                break
            stepping = stepping_of(model)
            if stepping is None:
                return True
            outcome = self.runner.run(model, stepping)
            error = self.link_errors.from_limit(outcome.tip)
            if self.accept(model, outcome):
                least = cost(model)
            elif not np.isfinite(error) or model in allocation.measured:
                return outcome.over_budget
            allocation.learn(model, error)
        return bool(np.isfinite(least))

    def _loosen(self) -> None:
        """Double the tolerance of the solution as long as the error is allowed."""
        if self.solution is None or self.solution.outcome.stepping.tolerance is None:
            return
        model, tolerance = self.solution.model, 2 * self.solution.outcome.stepping.tolerance
        while tolerance <= self.link_errors.refinement.travel:
            if not self.accept(model, self.runner.run(model, self._by_tolerance(tolerance, model))):
                return
            tolerance *= 2

    def _by_tolerance(self, tolerance: float, model: Model) -> Stepping:
        return Stepping("Radau5", tolerance=tolerance)

    def _implicit_cost(self, model: Model) -> float:
        """Cost of an evaluation [s]; the number of evaluations hardly depends on the hinges."""
        return self.runner.evaluation_cost(model, explicit=False) if can_move(self.runner.scene, model) else np.inf

    def _fixed(self, part: float, model: Model) -> Stepping | None:
        """Steps that are this fraction of the stable step; None if the present solution is cheaper."""
        stable = self.runner.stable_step(model) if any(model) else np.inf
        stepping = self.runner.fixed_steps(part * Thresholds.stable_share * stable)
        most = self.runner.budget if self.solution is None else 0.99 * self.solution.outcome.seconds
        return stepping if stepping and self.runner.fixed_steps_cost(model, stepping) <= most else None

    def _fixed_cost(self, part: float, model: Model) -> float:
        """Cost of a run with fixed steps [s], from an estimated stable step."""
        step = min((self._stable_step(k, bend) for k, bend in enumerate(model) if bend), default=np.inf)
        stepping = (
            self.runner.fixed_steps(part * Thresholds.stable_share * step)
            if can_move(self.runner.scene, model)
            else None
        )
        return np.inf if stepping is None else self.runner.fixed_steps_cost(model, stepping)

    def _stable_step(self, k: int, bend: Bend) -> float:
        """Estimated stable step for a link [s], proportional to 1 / (number of hinges)²."""
        few = bend._replace(hinges=min(bend.hinges, 4))
        if (k, few) not in self._stable_steps:
            self._stable_steps[k, few] = self.runner.estimated_step(k, few)
        return self._stable_steps[k, few] * (few.hinges / bend.hinges) ** 2
