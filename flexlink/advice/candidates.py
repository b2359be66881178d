"""Candidates: models and options for their steps, with predicted costs and errors at the tip."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.evaluation_cost import bodies_of, evaluation_cost
from flexlink.advice.goal import REFERENCE_STEP_SHARE
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Axes, Bend, Model, can_move, flexes
from flexlink.advice.model_runner import STABLE_SHARE, ModelRunner
from flexlink.advice.step_options import MeasuredSteps, fixed_step_options
from flexlink.describe.schemes.methods import method

MAX_MODELS = 1000
"""Combinations of choices for links."""

HOPELESS_ERROR = 2.0
"""Predicted error over the allowed one, beyond which a choice is no candidate."""


class StepChoice(NamedTuple):
    """An option for steps: fixed ones, over the stable step, or by a tolerance, over the allowed error."""

    method: str
    factor: float
    error: float  # of the tip [m]; taken as 0 of stable fixed steps
    evaluations: float  # of the base model; 0 of fixed steps

    @property
    def fixed(self) -> bool:
        """Whether steps are fixed."""
        return not self.evaluations


class Candidates:
    """Models in rows, options for steps in columns.

    Attributes
    ----------
    space
        Predicted errors of the models, without those of steps, shape (models,) [m].
    costs
        Predicted CPU times, shape (models, options) [s].
    """

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, probes: MeasuredSteps, allowed: float) -> None:
        self.runner, self.link_errors, self.allowed = runner, link_errors, allowed
        self.step_choices = [StepChoice(name, factor, 0.0, 0.0) for name, factor in fixed_step_options()]
        self.step_choices += [StepChoice(*key, steps.size, steps.evaluations) for key, steps in probes.steps.items()]
        self._steps: dict[tuple[int, Bend], float] = {}
        rigid = (None,) * len(runner.scene.arm.links)
        self._joints = bodies_of(runner.chain(rigid)) if can_move(runner.scene, rigid) else np.zeros(4, np.intp)
        self._planar: dict[Axes, bool] = {}
        self.models = list(dict.fromkeys(self._models()))
        self.space = np.array([self._error(model) for model in self.models])
        self.costs = np.array([self._costs(model) for model in self.models]).reshape(-1, len(self.step_choices))

    def same_axes(self, row: int) -> NDArray[np.bool_]:
        """Mask of the models that bend about the same axes as the one of a row, shape (models,)."""
        return np.array([flexes(model) == flexes(self.models[row]) for model in self.models])

    def _error(self, model: Model) -> float:
        error = self.link_errors.error(model)
        return np.inf if error is None else self.link_errors.norm(error)

    def _costs(self, model: Model) -> list[float]:
        step = min((self._step(k, bend) for k, bend in enumerate(model) if bend), default=np.inf)
        rates = [
            evaluation_cost(self._bodies(model), planar=self._is_planar(model), explicit=explicit)
            for explicit in (False, True)
        ]
        effort = self.link_errors.implicit_effort(model)
        return [
            self._fixed(column, step) * rates[True]
            if column.fixed
            else column.evaluations * effort ** self._strictness(column) * rates[False]
            for column in self.step_choices
        ]

    def _strictness(self, column: StepChoice) -> float:
        """1 for the steps that `implicit_effort` was measured with, 0 for the loosest, which damp all differences."""
        loosest = max(choice.factor for choice in self.step_choices)
        return float(np.log(loosest / column.factor) / np.log(loosest / REFERENCE_STEP_SHARE))

    def _fixed(self, column: StepChoice, step: float) -> float:
        """Evaluations of a run with fixed steps, for a stable step [s]."""
        largest = column.factor * (STABLE_SHARE * step if np.isfinite(step) else self.runner.scene.run.sample)
        stepping = self.runner.fixed_steps(largest)
        if stepping is None or stepping.step is None:
            return np.inf
        return method(column.method).stages * round(self.runner.scene.run.duration / stepping.step)

    def _models(self) -> Iterator[Model]:
        links = range(len(self.runner.scene.arm.links))
        lists: list[list[Bend | None]] = [
            self._efficient(k) if k in self.link_errors.bending else [None] for k in links
        ]
        while np.prod([len(choices) for choices in lists], dtype=float) > MAX_MODELS:
            longest = max(lists, key=len)
            longest[1:-1] = longest[1:-1:2] if len(longest) > 3 else []
        for model in itertools.chain(itertools.product(*lists), self.link_errors.known):
            if can_move(self.runner.scene, model):
                yield model

    def _efficient(self, k: int) -> list[Bend | None]:
        """Choices for a link that no other one beats in both cost and error, by explicit or implicit steps."""
        choices = [(self.link_errors.norm(error), bend) for bend, error in self.link_errors.choices(k).items()]
        choices = [(error, bend) for error, bend in choices if error <= HOPELESS_ERROR * self.allowed]
        kept: dict[Bend | None, None] = {}
        for explicit in (False, True):
            least = np.inf
            for error, bend in sorted(choices, key=lambda choice: (self._weight(k, choice[1], explicit), choice[0])):
                if error < 0.98 * least:
                    kept[bend] = None
                    least = error
                if least < 0.02 * self.allowed:  # finer choices gain nothing
                    break
        return sorted(kept, key=lambda bend: self._weight(k, bend, True))

    def _weight(self, k: int, bend: Bend | None, explicit: bool) -> float:
        """Relative cost of a choice among those for the same link."""
        if bend is None:
            return 0.0
        return len(bend.flex) * bend.hinges / (self._step(k, bend) if explicit else 1.0)

    def _step(self, k: int, bend: Bend) -> float:
        """Estimated stable step with this choice for a link [s]."""
        if (k, bend) not in self._steps:
            if bend.hinges > 4:  # falls with their square
                step = self._step(k, bend._replace(hinges=4)) * (4 / bend.hinges) ** 2
            else:
                step = self.runner.estimated_step(k, bend)
            self._steps[k, bend] = step
        return self._steps[k, bend]

    def _bodies(self, model: Model) -> NDArray[np.intp]:
        bodies = self._joints.copy()
        for bend in filter(None, model):
            bodies[len(bend.flex)] += bend.hinges
        return bodies

    def _is_planar(self, model: Model) -> bool:
        axes = flexes(model)
        if axes not in self._planar:
            plane = all(flex in {"rigid", "z"} for flex in axes)
            self._planar[axes] = plane and self.runner.chain(model).is_planar
        return self._planar[axes]
