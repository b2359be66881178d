"""Errors of the tip's path due to each link, measured with few hinges; they decrease with the rules' order p.

    e_k(N) = C_k / N^p         N hinges in link k, p = 2, or 4 for cells

The error paths of all links are added with their signs.
"""

from __future__ import annotations

import numpy as np

from flexlink.advice.goal import TipErrorNorm
from flexlink.advice.model import FAMILIES, GAUSS, Bend, Model, by_rule, fewer_axes, uniform
from flexlink.advice.model_runner import ModelRunner
from flexlink.advice.refinement import RefinementStudy
from flexlink.common.types import Array


class LinkErrors:
    """Errors of models relative to the limit."""

    def __init__(self, runner: ModelRunner, norm: TipErrorNorm, refinement: RefinementStudy) -> None:
        self.runner, self.norm, self.refinement = runner, norm, refinement
        # gauss also includes Gauss-Legendre points, so it offers any number of hinges
        self.family = refinement.family if FAMILIES[refinement.family].step > 1 else GAUSS
        self.order = FAMILIES[self.family].order
        self.base = 4 if refinement.finest.hinges > 4 else 2  # hinges in each of the other links while one is varied
        self.bending = [k for k, flex in enumerate(refinement.axes) if flex != "rigid"]  # numbers of links, from 0
        self.known = {model: self.from_limit(run.tip) for model, run in refinement.models().items()}  # [m]
        self._few: dict[tuple[int, int], Array] = {}  # errors with fewer hinges than the base, by link and hinges
        self._fewer_axes: dict[tuple[int, str], Array] = {}  # changes of the path with fewer axes
        self._own = self._of_base()
        counts = {self.base // 2, 1} | ({0} if len(self.bending) > 1 else set())  # never a model with all links rigid
        for k in self.bending:
            for hinges in counts:
                self._few[k, hinges] = self._changed(k, self._hinges(k, hinges)) + self._own[k]
            for flex in fewer_axes(self.refinement.axes[k]):
                self._fewer_axes[k, flex] = self._changed(k, by_rule(flex, self.base, self.family))

    def from_limit(self, tip: Array) -> float:
        """Distance of a tip path (samples, 3) from the limit [m]."""
        assert self.refinement.limit is not None
        return self.norm(tip - self.refinement.limit.tip)

    def constant(self, k: int) -> float:
        """Error constant C_k of a link [m]."""
        return float(self.norm(self._own[k]) * self.base**self.order)

    def error(self, model: Model) -> float:
        """Predicted error [m]."""
        return self.norm(np.sum([self._path(k, model[k]) for k in self.bending], axis=0))

    def axes(self, k: int) -> list[str]:
        """Axes of a link, followed by the choices with fewer axes whose effect has been measured."""
        return [self.refinement.axes[k], *(flex for link, flex in self._fewer_axes if link == k)]

    def _path(self, k: int, bend: Bend | None) -> Array:
        hinges = bend.hinges if bend else 0
        path = self._few.get((k, hinges))
        if path is None:
            path = self._own[k] * (self.base / hinges) ** self.order if hinges else np.full_like(self._own[k], np.inf)
        return path + self._fewer_axes[k, bend.flex] if bend and bend.flex != self.refinement.axes[k] else path

    def _of_base(self) -> dict[int, Array]:
        """Error of the base model, divided among links in proportion to the path's change with half a link's hinges."""
        assert self.refinement.limit is not None
        rest = self.runner.run(self._base_model, self.refinement.stepping).tip - self.refinement.limit.tip
        changes = {k: self._changed(k, self._hinges(k, self.base // 2)) for k in self.bending}
        total = np.sum(list(changes.values()), axis=0)
        share = np.copysign(self.norm(rest) / (self.norm(total) or 1.0), np.vdot(rest, total))
        return {k: share * change for k, change in changes.items()}

    def _hinges(self, k: int, hinges: int) -> Bend | None:
        return by_rule(self.refinement.axes[k], hinges, self.family) if hinges else None

    @property
    def _base_model(self) -> Model:
        return uniform(self.refinement.axes, self.base, self.family)

    def _changed(self, k: int, bend: Bend | None) -> Array:
        """Change of the base model's tip path if one link bends in another way."""
        base, stepping = self._base_model, self.refinement.stepping
        return self.runner.run((*base[:k], bend, *base[k + 1 :]), stepping).tip - self.runner.run(base, stepping).tip
