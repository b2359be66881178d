"""Refinement study: the limit of the tip's path with more and more hinges, extrapolated by order 2, and its error."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.goal import Goal, Ruler
from flexlink.advice.model import Axes, Model, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.results.convergence import Limit, change_of_limit, extrapolated
from flexlink.results.deflection import deflections
from flexlink.results.tip_motion import tip_travel

Array = NDArray[np.float64]

LEVELS = (1, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128)
ENOUGH = 0.1
"""Part of the tolerance to which the limit is sought."""

SAFE_LEVEL, SAFE_LIMIT = 1.4, {"gauss": 1.5, "legendre": 1.2}
"""Measured on 22 scenes: the error of a level is at most 1.4 times what its change tells from N = 6 on; that of the
limit at most 1/1.5, 1/1.2 of its own change."""

STRICT = 0.1
"""Tolerance of the steps by which errors of the levels' steps are told, over theirs."""

SCATTER = 5.0
"""Times what steps do at a coarse level that they may do at the finest, where motion is sensitive."""

REGULAR = 6
"""Hinges from which the order of convergence is there."""

FALL, LIMIT_FALL = 4.0, 6.0
"""Orders of the fastest fall that errors of a level and of a limit are believed to have: two can agree by chance."""

STUCK = 32
"""Hinges from which a level must better the third last one by a third, or the ladder ends."""


class Level(NamedTuple):
    """A run with the same number of hinges in every link that bends."""

    hinges: int
    outcome: Outcome


class RefinementStudy:
    """Levels of a scene, climbed until their limit is known.

    Attributes
    ----------
    limit
        The best there is; None if fewer than two levels came to their end.
    levels
        By lumping rule, coarse to fine.
    tolerance, motion
        What the goal allows, and how far the tip gets [m], by the finest level.
    why
        Why it ended with less than asked for; empty if it did not.
    """

    def __init__(self, bench: ModelRunner, ruler: Ruler, goal: Goal, axes: Axes, stepping: Stepping) -> None:
        self.bench, self.ruler, self.goal, self.axes, self.stepping = bench, ruler, goal, axes, stepping
        self.levels: dict[str, list[Level]] = {"gauss": [], "legendre": []}
        self.family, self.why = "gauss", ""
        self.limit: Limit | None = None
        self.tolerance = self.motion = self.deflection = 0.0
        self._limits: dict[str, list[Limit]] = {"gauss": [], "legendre": []}
        self._itself: dict[str, Array] = {}  # errors of the last level by its change (samples,)
        self._errors: list[float] = []

    def climb(self) -> None:
        """Take levels until the limit is known, or there is no hope."""
        for hinges in LEVELS:
            if self._beyond_budget(hinges):
                break
            if self._take(hinges, self.family).dear:
                break
            if self.limit is None:
                continue
            if self.limit.error <= ENOUGH * self.tolerance:
                return
            if hinges == REGULAR:
                self._compare_rules()
            self._errors.append(self.limit.error)
            if hinges >= STUCK and self.limit.error > max(self.tolerance, self._errors[-4] * 2 / 3):
                self.why = f"more hinges do not help from {hinges} on"
                break

    @property
    def finest(self) -> Level:
        """The last level."""
        return self.levels[self.family][-1]

    @property
    def model(self) -> Model:
        """Of the last level."""
        return uniform(self.axes, self.finest.hinges, self.family)

    def known(self) -> dict[Model, Outcome]:
        """All levels by their models."""
        return {
            uniform(self.axes, hinges, family): outcome
            for family, levels in self.levels.items()
            for hinges, outcome in levels
        }

    def settle_time(self) -> Array:
        """Take what the levels' steps do out of the limit; what is left of it up to each sample (samples,) [m].

        Told by a tenth of their tolerance, at the two levels that the limit is made of: coarser ones hardly tell it.
        """
        assert self.limit is not None
        tip, left = self.limit.tip, np.zeros(len(self.limit.tip))
        for weight, level in zip(self.limit.weights, self.levels[self.family][-2:], strict=True):
            change = weight * self._by_steps(level) if weight else np.zeros_like(tip)
            tip, left = tip + change, left + self.ruler.up_to(change) * STRICT**0.5  # whatever the method's order is
        if not np.isfinite(left[-1]):
            return self._by_steps_of_coarser()
        self.limit = self.limit._replace(tip=tip)
        return left

    def _by_steps(self, level: Level) -> Array:
        """What stricter steps change at a level (samples, 3) [m]; nan where they cannot be run."""
        assert self.stepping.tolerance is not None
        strict = self.stepping._replace(tolerance=STRICT * self.stepping.tolerance)
        return self.bench.run(uniform(self.axes, level.hinges, self.family), strict).tip - level.outcome.tip

    def _by_steps_of_coarser(self) -> Array:
        """Where the finest levels cannot be run with stricter steps: of the finest that can, with room."""
        for level in self.levels[self.family][-2::-1]:
            errors = self.ruler.up_to(self._by_steps(level))
            if np.isfinite(errors[-1]):
                return SCATTER * errors
        return np.full(len(self.finest.outcome.tip), np.inf)

    def _beyond_budget(self, hinges: int) -> bool:
        levels = self.levels[self.family]
        if len(levels) < 2:  # which it takes to tell any error
            return False
        prices = [
            self.bench.evaluation(uniform(self.axes, n, self.family), explicit=False)
            for n in (levels[-1].hinges, hinges)
        ]
        if levels[-1].outcome.seconds * prices[1] / prices[0] <= self.bench.budget:
            return False
        self.why = f"a run with {hinges} hinges a link would take more than {self.bench.budget:g} s"
        return True

    def _take(self, hinges: int, family: str) -> Outcome:
        outcome = self.bench.run(uniform(self.axes, hinges, family), self.stepping)
        if not outcome.whole or outcome.run is None:
            self.why = outcome.why
            return outcome
        self.why = ""
        self.levels[family].append(Level(hinges, outcome))
        self.motion, self.deflection = tip_travel(outcome.tip), float(deflections(outcome.run).max())
        self.tolerance = self.goal.tolerance(self.motion, self.deflection)
        if len(self.levels[family]) > 1:
            self.limit = self._estimate(family)
        return outcome

    def _estimate(self, family: str) -> Limit:
        """The finest level or the extrapolated one, whichever is known better."""
        levels, limits = [(n, run.tip) for n, run in self.levels[family][-3:]], self._limits[family]
        (Na, a), (Nb, b) = levels[-2:]
        limit = extrapolated(levels)
        itself = SAFE_LEVEL * self.ruler.up_to(limit.tip - b) if Nb >= REGULAR else self.ruler.up_to(b - a)
        if limits:
            errors = self.ruler.up_to(change_of_limit(levels)) / SAFE_LIMIT[family]
            if len(limits) > 1:
                errors = np.maximum(errors, limits[-1].errors * (Na / Nb) ** LIMIT_FALL)
            limit = limit._replace(errors=errors)
            if Na >= 4:
                itself = np.maximum(itself, self._itself[family] * (Na / Nb) ** FALL)
        limits.append(limit)
        self._itself[family] = itself
        return min(limit, Limit(b, itself), key=self._worth)

    def _worth(self, limit: Limit) -> tuple[int, float]:
        """Small for one that is within the tolerance for long, and at last: errors that have grown say little."""
        return int((limit.errors > self.tolerance).sum()), limit.error

    def _compare_rules(self) -> None:
        """Go on with Gauss-Legendre over the whole link if that is twice as good."""
        assert self.limit is not None
        before = self.limit
        for hinges in (4, REGULAR):
            self._take(hinges, "legendre")
        levels = self.levels["legendre"]
        if len(levels) == 2 and self.limit.error < before.error / 2:
            self.family = "legendre"
        else:
            self.limit, self.why = before, ""
