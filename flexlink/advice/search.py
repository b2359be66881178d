"""Search for the cheapest model and steps; models are predicted from the order of convergence, corrected by a few runs.

With adaptive steps, the model is found with small step errors; then the tolerance is increased while the error is
allowed, and finer models with larger tolerances are tried. Fixed steps are tried if they are predicted to be cheaper,
then models with fewer hinges in one link, and adaptive explicit steps if stability allows long enough ones.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from flexlink.advice.allocation import Allocation
from flexlink.advice.families import FAMILIES
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Bend, Model, by_rule, can_move
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
        self._while_cheaper(self._finer)
        for part in (1.0, 0.5):
            if self._fit(0.98, functools.partial(self._fixed_cost, part), functools.partial(self._fixed, part)):
                break
        self._while_cheaper(self._coarser)
        self._explicit()
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
        """Increase the tolerance of the solution as long as the error is allowed, first by 2, then by √2."""
        if self.solution is None or self.solution.outcome.stepping.tolerance is None:
            return
        model, tolerance = self.solution.model, self.solution.outcome.stepping.tolerance
        for factor in (2.0, math.sqrt(2.0)):
            while factor * tolerance <= self.link_errors.refinement.travel and self.accept(
                model, self.runner.run(model, self._by_tolerance(factor * tolerance, model))
            ):
                tolerance *= factor

    def _while_cheaper(self, improve: Callable[[Model, float], None]) -> None:
        """Repeat an attempt from the model and tolerance of the solution, as long as it finds a cheaper one."""
        before = np.inf
        while self.solution is not None and self.solution.outcome.seconds < before:
            model, outcome, _ = self.solution
            if outcome.stepping.tolerance is None:
                return
            before = outcome.seconds
            improve(model, outcome.stepping.tolerance)

    def _finer(self, _: Model, tolerance: float) -> None:
        """Try finer models with a larger tolerance."""
        self._fit(0.6, self._implicit_cost, functools.partial(self._by_tolerance, 4 * tolerance))
        self._loosen()

    def _coarser(self, model: Model, tolerance: float) -> None:
        """Try fewer hinges in one link, with the same or larger tolerances: small errors of both may cancel."""
        for fewer in self._with_fewer_hinges(model):
            for looser in (1.0, 2.0, 4.0):
                outcome = self.runner.run(fewer, self._by_tolerance(looser * tolerance, fewer))
                self.accept(fewer, outcome)
                if self.link_errors.from_limit(outcome.tip) > 2 * self.allowed:
                    break

    def _with_fewer_hinges(self, model: Model) -> Iterator[Model]:
        """Models in which one link has fewer hinges or is rigid."""
        family = self.link_errors.refinement.family
        for k, bend in enumerate(model):
            if bend is None:
                continue
            for hinges in sorted(FAMILIES[self.link_errors.family].fewer(bend.hinges)):
                fewer = (*model[:k], by_rule(bend.flex, hinges, family) if hinges else None, *model[k + 1 :])
                if can_move(self.runner.scene, fewer):
                    yield fewer

    def _explicit(self) -> None:
        """Try DOP853 with the model of the solution, and double its tolerance as long as the error is allowed."""
        if self.solution is None:
            return
        model, outcome, _ = self.solution
        if self.runner.least_explicit_cost(model) >= outcome.seconds:
            return
        tolerance = outcome.stepping.tolerance or self.allowed
        while tolerance <= self.link_errors.refinement.travel and self.accept(
            model, self.runner.run(model, Stepping("DOP853", tolerance=tolerance))
        ):
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
