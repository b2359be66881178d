"""Models and ways to step, run where that promises most, until it promises nothing any more."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.candidates import Pool
from flexlink.advice.link_errors import Parts
from flexlink.advice.model import Model, uniform
from flexlink.advice.model_runner import OF_STABLE, ModelRunner, Outcome, Stepping
from flexlink.advice.step_options import Probes

Array = NDArray[np.float64]

TRIES = 32
"""Runs at most."""

WORTH = 0.004
"""Part of the best one's cost that a run must be expected to save."""

SHARP = 6.0
"""Of the chance 1/(1 + r^SHARP) that an error predicted to be r of what is allowed is: 0.98 at a half, a half at 1."""

LOOSER = 0.3
"""Least chance that the best model with the next looser steps has."""

LEARN = 0.5
"""Power of what an error or a cost was, over what was predicted, by which others are expected to be larger, too."""

LEAST, MOST = 0.5, 3.0
"""Of all that is learned."""

HALF = 0.6
"""Predicted part of what is allowed up to which an error that is too large is laid to fixed steps."""


class Found(NamedTuple):
    """A run that is good enough."""

    model: Model
    outcome: Outcome
    error: float  # against the limit [m]


class Search:
    """The best run so far, `found`, and what was learned.

    Attributes
    ----------
    of_space, of_steps, of_cost
        Errors of models, errors of steps by way, costs by model and way, over those that were predicted.
    """

    def __init__(self, bench: ModelRunner, parts: Parts, allowed: float, known_to: float) -> None:
        self.bench, self.parts, self.ruler = bench, parts, parts.ruler
        self.allowed = allowed - known_to  # of the difference to the limit [m]
        self.found: Found | None = None
        self.pool = Pool(bench, parts, self._probes(), self.allowed)
        self.columns = self.pool.columns
        models = range(len(self.pool.models))
        self._known = np.array([self.pool.models[k] in parts.known for k in models], bool)
        self._open = np.ones(self.pool.costs.shape, bool)
        fixed = [k for k, column in enumerate(self.columns) if column.fixed]
        self._open[:, fixed[1:]] = False  # until the larger ones turn out to be too large
        self.of_space, self.of_steps, self.of_cost = 1.0, np.ones(len(self.columns)), np.ones(self.pool.costs.shape)

    def best(self) -> Found | None:
        """The cheapest that is good enough, as far as was looked."""
        for _ in range(TRIES):
            chosen = self._next()
            if chosen is None:
                break
            self._try(*chosen)
        return self.found

    def accept(self, model: Model, outcome: Outcome) -> bool:
        """Take a run for the best, if it is good enough and cheaper."""
        error = self.ruler(outcome.tip - self.parts.limit)
        good = outcome.whole and error <= self.allowed
        if good and (self.found is None or outcome.seconds < self.found.outcome.seconds):
            self.found = Found(model, outcome, error)
        return good

    def _next(self) -> tuple[int, int] | None:
        """Model and way that are expected to save most of the best one's cost, or, before one is found, to cost least.

        Both by the chance that the error is allowed.
        """
        costs, chances = self.of_cost * self.pool.costs, 1 / (1 + (self._errors() / self.allowed) ** SHARP)
        costs[~self._open | (costs > self.bench.budget)] = np.inf
        if self.found is not None:
            chances[self._looser()] = np.maximum(chances[self._looser()], LOOSER)
            worth = chances * (1 - costs / self.found.outcome.seconds)
            k = int(np.argmax(worth)) if worth.size else 0
            promising = worth.size > 0 and worth.flat[k] > WORTH
        else:
            worth = costs / chances
            k = int(np.argmin(worth)) if worth.size else 0
            promising = worth.size > 0 and np.isfinite(worth.flat[k]) and chances.flat[k] > WORTH
        row, column = np.unravel_index(k, costs.shape) if promising else (0, 0)
        return (int(row), int(column)) if promising else None

    def _looser(self) -> NDArray[np.bool_]:
        """The best model with the next looser steps: what steps do was measured on another one."""
        found = self.found
        here = np.zeros(self.pool.costs.shape, bool)
        if found is not None and found.outcome.stepping.tolerance is not None:
            factors = np.array([0.0 if c.fixed else c.factor for c in self.columns])
            looser = np.flatnonzero(factors > 1.01 * found.outcome.stepping.tolerance / self.allowed)
            if looser.size:
                here[self.pool.models.index(found.model), looser[np.argmin(factors[looser])]] = True
        return here

    def _errors(self) -> Array:
        """Predicted errors, shape (models, ways) [m]; what a model does and what its steps do are unrelated."""
        space = self.pool.space * np.where(self._known, 1.0, self.of_space)
        steps = self.of_steps * [column.error for column in self.columns]
        return np.asarray(np.hypot(space[:, None], steps))

    def _try(self, row: int, column: int) -> None:
        """Run a model and learn from it; one whose fixed steps are dearer than was thought is put back."""
        model, way = self.pool.models[row], self.columns[column]
        if way.fixed:
            stepping = self.bench.fixed(way.factor * OF_STABLE * self.bench.stable(model))
            exact = np.inf if stepping is None else self.bench.fixed_cost(model, stepping)
            if exact > 1.05 * self.pool.costs[row, column]:
                self.pool.costs[row, column] = exact
                return
        else:
            stepping = Stepping(way.method, tolerance=way.factor * self.allowed)
        assert stepping is not None
        self._open[row, column] = False
        outcome = self.bench.run(model, stepping)
        self._learn(row, column, outcome)
        self.accept(model, outcome)

    def _learn(self, row: int, column: int, outcome: Outcome) -> None:
        way, error = self.columns[column], self.ruler(outcome.tip - self.parts.limit)
        predicted = float(self._errors()[row, column])
        if way.fixed and error > self.allowed and self.pool.space[row] <= HALF * self.allowed:
            if column + 1 < len(self.columns) and self.columns[column + 1].fixed:
                self._open[row, column + 1] = True
            return
        if not np.isfinite(error):
            return
        off, of_steps = (error / predicted) ** LEARN, float(self.of_steps[column]) * way.error
        if of_steps > predicted / np.sqrt(2):
            self.of_steps[column] = np.clip(off * self.of_steps[column], LEAST, MOST)
        elif not self._known[row]:
            self.of_space = float(np.clip(off * self.of_space, LEAST, MOST))
            self._known[row], self.pool.space[row] = True, np.sqrt(max(error**2 - of_steps**2, (error / 2) ** 2))
        if not way.fixed:  # Newton's iteration is slow by these axes, or by this tolerance
            dearer = (outcome.seconds / (self.of_cost * self.pool.costs)[row, column]) ** LEARN
            self.of_cost[self.pool.alike(row)] *= dearer
            self.of_cost[:, column] *= dearer

    def _probes(self) -> Probes:
        """Of the base, whose runs may be good enough."""
        ladder = self.parts.ladder
        model = uniform(ladder.axes, self.parts.base)
        tip = self.bench.run(model, ladder.stepping).tip
        probes = Probes(self.bench, self.ruler, model, tip, self.allowed, ladder.motion)
        for outcome in probes.runs:
            self.accept(model, outcome)
        return probes
