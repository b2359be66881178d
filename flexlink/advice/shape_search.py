"""Search for the fewest strain modes whose error is allowed, for controllers, observers and explicit methods.

The stations of the shapes are the hinges of the coarsest level whose error is at most half the allowed one. The number
of modes, the same for all links and directions, is then increased until the error is allowed, and decreased again link
by link and direction by direction; directions without modes, and links without directions, become rigid.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import FLEX, Bend, Model, can_move
from flexlink.advice.model_runner import ModelRunner, Stepping
from flexlink.advice.search import Solution
from flexlink.advice.thresholds import Thresholds
from flexlink.describe.link import AXES, of_number

OF_STATIONS = 0.5
"""Largest error of the stations, as a share of the allowed error."""
OF_STEPS = 0.05
"""Tolerance of the steps, as a share of the allowed error."""


class ShapeSearch:
    """Search for the smallest model with strain modes, or with hinges that move one by one if those are fewer."""

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, allowed: float, *, explicit: bool) -> None:
        self.runner, self.link_errors, self.allowed, self.explicit = runner, link_errors, allowed, explicit
        self.stepping = Stepping("auto", tolerance=OF_STEPS * allowed)
        self.lines: list[str] = []

    def best(self, cheapest: Solution | None) -> Solution | None:
        """The smallest solution; None if the error of no model is allowed.

        `cheapest` is the solution of `Search`, whose hinges move one by one.
        """
        hinges = [each for each in (self._coarsest(1.0), cheapest) if each is not None]
        shaped = self._shaped()
        best: list[Solution] = []
        for name, found in (("one by one", hinges), ("strain modes", [shaped] if shaped else [])):
            if found:
                best.append(min(found, key=lambda each: self.size(each.model)))
                self.lines.append(f"{name}: {self._in_words(best[-1].model)}")
        if not best:
            return None
        smallest = min(best, key=lambda each: self.size(each.model))
        return self._by_fixed_steps(smallest) if self.explicit else smallest

    def size(self, model: Model) -> float:
        """The measure to minimise: coordinates or, for explicit methods, CPU time per simulated second [s]."""
        if not self.explicit:
            return float(self.runner.chain(model).freedoms)
        return self.runner.evaluation_cost(model, explicit=True) / self.runner.stable_step(model)

    def _coarsest(self, share: float) -> Solution | None:
        """The coarsest level of the refinement study whose error is at most this share of the allowed error."""
        levels = self.link_errors.refinement.models().items()
        for model, outcome in sorted(levels, key=lambda level: self.runner.chain(level[0]).n):
            error = self.link_errors.from_limit(outcome.tip)
            if outcome.completed and error <= share * self.allowed:
                return Solution(model, outcome, error)
        return None

    def _shaped(self) -> Solution | None:
        stations = self._coarsest(OF_STATIONS)
        if stations is None:
            return None
        most = min(bend.hinges for bend in stations.model if bend)
        for count in range(1, most + 1):
            model = tuple(bend and bend._replace(modes=of_number(count)) for bend in stations.model)
            if solution := self._tried(model, self.stepping):
                return self._with_fewer(solution)
        return None

    def _with_fewer(self, solution: Solution) -> Solution:
        """Remove modes one by one as long as the error is allowed."""
        for model in _fewer(solution.model):
            if found := self._tried(model, self.stepping):
                return self._with_fewer(found)
        return solution

    def _tried(self, model: Model, stepping: Stepping) -> Solution | None:
        """The solution of a run; None if it fails or its error is not allowed."""
        if not can_move(self.runner.scene, model):
            return None
        outcome = self.runner.run(model, stepping)
        error = self.link_errors.from_limit(outcome.tip)
        return Solution(model, outcome, error) if outcome.completed and error <= self.allowed else None

    def _by_fixed_steps(self, solution: Solution) -> Solution:
        """The same model by RK4 with the largest stable or accurate step."""
        longest = Thresholds.stable_share * self.runner.stable_step(solution.model)
        for part in (1.0, 0.5, 0.25):
            stepping = self.runner.fixed_steps(part * longest)
            if stepping is None:
                break
            if found := self._tried(solution.model, stepping):
                return found
        return solution

    def _in_words(self, model: Model) -> str:
        chain = self.runner.chain(model)
        return f"{chain.freedoms} coordinates, largest stable step of RK4 {self.runner.stable_step(model):.3g} s"


def _fewer(model: Model) -> Iterator[Model]:
    """Models with one mode less in one direction of one link, from the tip inward."""
    for k in reversed(range(len(model))):
        for less in _less_of(model[k]):
            yield (*model[:k], less, *model[k + 1 :])


def _less_of(bend: Bend | None) -> Iterator[Bend | None]:
    """A link with one mode less in one direction; only the first direction of its flex can lose its last mode."""
    if bend is None or bend.modes is None:
        return
    for axis in AXES[bend.flex]:
        count = bend.modes.of_axis(axis)
        if count > 1:
            yield bend._replace(modes=replace(bend.modes, **{"xyz"[axis - 1]: count - 1}))
        elif axis == AXES[bend.flex][0]:
            flex = FLEX[FLEX.index(bend.flex) - 1]
            yield bend._replace(flex=flex) if flex != "rigid" else None
