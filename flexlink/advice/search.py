"""Search for the cheapest model and steps: runs the most promising candidate, until none promises to be cheaper."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.candidates import Candidates
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Model, uniform
from flexlink.advice.model_runner import STABLE_SHARE, ModelRunner, Outcome, Stepping
from flexlink.advice.step_options import MeasuredSteps
from flexlink.common.types import Array

LEAST_GAIN = 0.004
"""Share of the best run's cost that another run must be expected to save."""

LEARNING_EXPONENT = 0.5
"""Predictions for other candidates are corrected by (measured / predicted) to this power."""

CORRECTIONS = 0.5, 3.0
"""Least and largest correction."""


class Solution(NamedTuple):
    """A run whose error is allowed."""

    model: Model
    outcome: Outcome
    error: float  # from the limit [m]


class Search:
    """The best run so far, `solution`, and corrections of the predictions.

    Attributes
    ----------
    of_space, of_steps, of_cost
        Errors of models, errors of steps by option, costs by model and option, over the predicted ones.
    """

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, allowed: float, known_to: float) -> None:
        self.runner, self.link_errors, self.norm = runner, link_errors, link_errors.norm
        self.allowed = allowed - known_to  # error from the limit [m]
        self.solution: Solution | None = None
        self.candidates = Candidates(runner, link_errors, self._measured_steps(), self.allowed)
        self.step_choices = self.candidates.step_choices
        models = range(len(self.candidates.models))
        self._known = np.array([self.candidates.models[k] in link_errors.known for k in models], bool)
        self._open = np.ones(self.candidates.costs.shape, bool)
        fixed = [k for k, column in enumerate(self.step_choices) if column.fixed]
        self._open[:, fixed[1:]] = False  # opened when the larger steps turn out too large
        self.of_space, self.of_steps, self.of_cost = (
            1.0,
            np.ones(len(self.step_choices)),
            np.ones(self.candidates.costs.shape),
        )

    def best(self) -> Solution | None:
        """The cheapest solution of at most 32 runs; None if there is none."""
        for _ in range(32):
            chosen = self._next()
            if chosen is None:
                break
            self._try(*chosen)
        return self.solution

    def accept(self, model: Model, outcome: Outcome) -> bool:
        """Keep a run if its error is allowed and it is the cheapest so far; whether its error is allowed."""
        error = self.norm(outcome.tip - self.link_errors.limit)
        good = outcome.completed and error <= self.allowed
        if good and (self.solution is None or outcome.seconds < self.solution.outcome.seconds):
            self.solution = Solution(model, outcome, error)
        return good

    def _next(self) -> tuple[int, int] | None:
        """Row and column of the candidate that saves most or, before there is a solution, costs least, as expected.

        The chance that an error is allowed is taken as 1 / (1 + r⁶), r the predicted error over the allowed one.
        """
        costs, chances = self.of_cost * self.candidates.costs, 1 / (1 + (self._errors() / self.allowed) ** 6.0)
        costs[~self._open | (costs > self.runner.budget)] = np.inf
        if self.solution is not None:
            chances[self._looser()] = np.maximum(chances[self._looser()], 0.3)
            worth = chances * (1 - costs / self.solution.outcome.seconds)
            k = int(np.argmax(worth)) if worth.size else 0
            promising = worth.size > 0 and worth.flat[k] > LEAST_GAIN
        else:
            worth = costs / chances
            k = int(np.argmin(worth)) if worth.size else 0
            promising = worth.size > 0 and np.isfinite(worth.flat[k]) and chances.flat[k] > LEAST_GAIN
        row, column = np.unravel_index(k, costs.shape) if promising else (0, 0)
        return (int(row), int(column)) if promising else None

    def _looser(self) -> NDArray[np.bool_]:
        """Mask of the best model with the next looser steps, whose errors were measured on another model."""
        solution = self.solution
        here = np.zeros(self.candidates.costs.shape, bool)
        if solution is not None and solution.outcome.stepping.tolerance is not None:
            factors = np.array([0.0 if c.fixed else c.factor for c in self.step_choices])
            looser = np.flatnonzero(factors > 1.01 * solution.outcome.stepping.tolerance / self.allowed)
            if looser.size:
                here[self.candidates.models.index(solution.model), looser[np.argmin(factors[looser])]] = True
        return here

    def _errors(self) -> Array:
        """Predicted errors, shape (models, options) [m]; those of models and of steps are taken as unrelated."""
        space = self.candidates.space * np.where(self._known, 1.0, self.of_space)
        steps = self.of_steps * [column.error for column in self.step_choices]
        return np.asarray(np.hypot(space[:, None], steps))

    def _try(self, row: int, column: int) -> None:
        """Run a candidate and learn from it; if its fixed steps cost more than predicted, correct that and return."""
        model, choice = self.candidates.models[row], self.step_choices[column]
        if choice.fixed:
            stepping = self.runner.fixed_steps(choice.factor * STABLE_SHARE * self.runner.stable_step(model))
            exact = np.inf if stepping is None else self.runner.fixed_steps_cost(model, stepping)
            if exact > 1.05 * self.candidates.costs[row, column]:
                self.candidates.costs[row, column] = exact
                return
        else:
            stepping = Stepping(choice.method, tolerance=choice.factor * self.allowed)
        assert stepping is not None
        self._open[row, column] = False
        outcome = self.runner.run(model, stepping)
        self._learn(row, column, outcome)
        self.accept(model, outcome)

    def _learn(self, row: int, column: int, outcome: Outcome) -> None:
        choice, error = self.step_choices[column], self.norm(outcome.tip - self.link_errors.limit)
        predicted = float(self._errors()[row, column])
        if choice.fixed and error > self.allowed and self.candidates.space[row] <= 0.6 * self.allowed:
            if column + 1 < len(self.step_choices) and self.step_choices[column + 1].fixed:
                self._open[row, column + 1] = True
            return
        if not np.isfinite(error):
            return
        off, of_steps = (error / predicted) ** LEARNING_EXPONENT, float(self.of_steps[column]) * choice.error
        if of_steps > predicted / np.sqrt(2):
            self.of_steps[column] = np.clip(off * self.of_steps[column], *CORRECTIONS)
        elif not self._known[row]:
            self.of_space = float(np.clip(off * self.of_space, *CORRECTIONS))
            self._known[row], self.candidates.space[row] = True, np.sqrt(max(error**2 - of_steps**2, (error / 2) ** 2))
        if not choice.fixed:  # Newton's iteration takes longer with these axes, or with this tolerance
            dearer = (outcome.seconds / (self.of_cost * self.candidates.costs)[row, column]) ** LEARNING_EXPONENT
            self.of_cost[self.candidates.same_axes(row)] *= dearer
            self.of_cost[:, column] *= dearer

    def _measured_steps(self) -> MeasuredSteps:
        """Effect of steps on the base model, whose runs may be solutions."""
        refinement = self.link_errors.refinement
        model = uniform(refinement.axes, self.link_errors.base)
        tip = self.runner.run(model, refinement.stepping).tip
        measured = MeasuredSteps(self.runner, self.norm, model, tip, self.allowed, refinement.travel)
        for outcome in measured.runs:
            self.accept(model, outcome)
        return measured
