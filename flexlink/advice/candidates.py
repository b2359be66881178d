"""What is thought of: models and ways to step, what each is expected to cost and to do to the tip."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.evaluation_cost import bodies_of, evaluation_cost
from flexlink.advice.goal import OF_STEPS
from flexlink.advice.link_errors import Parts
from flexlink.advice.model import Axes, Bend, Model, flexes, is_scene
from flexlink.advice.model_runner import OF_STABLE, ModelRunner
from flexlink.advice.step_options import Probes, fixed_ways
from flexlink.describe.schemes.methods import method

Array = NDArray[np.float64]

MOST = 1000
"""Combinations of choices that are thought of."""

HOPELESS = 2.0
"""Predicted error over what is allowed, beyond which a choice is not thought of."""

FINE = 0.02
"""The same below which finer choices are not thought of."""

SCALED = 4
"""Hinges up to which the stable step of a link is estimated; beyond, it falls with their square."""


class Column(NamedTuple):
    """A way to step: fixed steps, as a part of the stable one, or a tolerance over what is allowed."""

    method: str
    factor: float
    error: float  # at the tip [m]; of stable fixed steps it is not known, and small
    evaluations: float  # of the base; 0 of fixed steps

    @property
    def fixed(self) -> bool:
        """Whether steps are fixed."""
        return not self.evaluations


class Pool:
    """Models in rows, ways to step in columns.

    Attributes
    ----------
    space
        Predicted errors of the models themselves, shape (models,) [m].
    costs
        Expected CPU times, shape (models, ways) [s].
    """

    def __init__(self, bench: ModelRunner, parts: Parts, probes: Probes, allowed: float) -> None:
        self.bench, self.parts, self.allowed = bench, parts, allowed
        self.columns = [Column(name, factor, 0.0, 0.0) for name, factor in fixed_ways()]
        self.columns += [Column(*key, steps.size, steps.evaluations) for key, steps in probes.steps.items()]
        self._steps: dict[tuple[int, Bend], float] = {}
        rigid = (None,) * len(bench.scene.arm.links)
        self._joints = bodies_of(bench.chain(rigid)) if is_scene(bench.scene, rigid) else np.zeros(4, np.intp)
        self._planar: dict[Axes, bool] = {}
        self.models = list(dict.fromkeys(self._models()))
        self.space = np.array([self._error(model) for model in self.models])
        self.costs = np.array([self._costs(model) for model in self.models]).reshape(-1, len(self.columns))

    def alike(self, row: int) -> NDArray[np.bool_]:
        """Which models bend about the same axes as one of them, shape (models,)."""
        return np.array([flexes(model) == flexes(self.models[row]) for model in self.models])

    def _error(self, model: Model) -> float:
        error = self.parts.error(model)
        return np.inf if error is None else self.parts.ruler(error)

    def _costs(self, model: Model) -> list[float]:
        step = min((self._step(k, bend) for k, bend in enumerate(model) if bend), default=np.inf)
        rates = [
            evaluation_cost(self._bodies(model), planar=self._is_planar(model), explicit=explicit)
            for explicit in (False, True)
        ]
        effort = self.parts.effort(model)
        return [
            self._fixed(column, step) * rates[True]
            if column.fixed
            else column.evaluations * effort ** self._strictness(column) * rates[False]
            for column in self.columns
        ]

    def _strictness(self, column: Column) -> float:
        """1 of the steps that `Parts.effort` was measured with, 0 of the loosest, which damp what differs."""
        loosest = max(way.factor for way in self.columns)
        return float(np.log(loosest / column.factor) / np.log(loosest / OF_STEPS))

    def _fixed(self, column: Column, step: float) -> float:
        """Evaluations of fixed steps that are about a part of a stable one [s]."""
        largest = column.factor * (OF_STABLE * step if np.isfinite(step) else self.bench.scene.run.sample)
        stepping = self.bench.fixed(largest)
        if stepping is None or stepping.step is None:
            return np.inf
        return method(column.method).stages * round(self.bench.scene.run.duration / stepping.step)

    def _models(self) -> Iterator[Model]:
        links = range(len(self.bench.scene.arm.links))
        lists: list[list[Bend | None]] = [self._efficient(k) if k in self.parts.bending else [None] for k in links]
        while np.prod([len(choices) for choices in lists], dtype=float) > MOST:
            longest = max(lists, key=len)
            longest[1:-1] = longest[1:-1:2] if len(longest) > 3 else []
        for model in itertools.chain(itertools.product(*lists), self.parts.known):
            if is_scene(self.bench.scene, model):
                yield model

    def _efficient(self, k: int) -> list[Bend | None]:
        """Choices for a link that are not both dearer and worse than another one, by either kind of steps."""
        choices = [(self.parts.ruler(error), bend) for bend, error in self.parts.choices(k).items()]
        choices = [(error, bend) for error, bend in choices if error <= HOPELESS * self.allowed]
        kept: dict[Bend | None, None] = {}
        for explicit in (False, True):
            least = np.inf
            for error, bend in sorted(choices, key=lambda choice: (self._weight(k, choice[1], explicit), choice[0])):
                if error < 0.98 * least:
                    kept[bend] = None
                    least = error
                if least < FINE * self.allowed:
                    break
        return sorted(kept, key=lambda bend: self._weight(k, bend, True))

    def _weight(self, k: int, bend: Bend | None, explicit: bool) -> float:
        """What a choice costs, beside others for the same link."""
        if bend is None:
            return 0.0
        return len(bend.flex) * bend.hinges / (self._step(k, bend) if explicit else 1.0)

    def _step(self, k: int, bend: Bend) -> float:
        """About the stable step with this choice for a link [s]."""
        if (k, bend) not in self._steps:
            if bend.hinges > SCALED:
                step = self._step(k, bend._replace(hinges=SCALED)) * (SCALED / bend.hinges) ** 2
            else:
                step = self.bench.estimated_step(k, bend)
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
            self._planar[axes] = plane and self.bench.chain(model).is_planar
        return self._planar[axes]
