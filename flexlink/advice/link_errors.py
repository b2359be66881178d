"""Errors of the tip path caused by each choice for each link; those of all links are superposed."""

from __future__ import annotations

import numpy as np

from flexlink.advice.goal import TipErrorNorm
from flexlink.advice.model import Bend, Model, by_rule, fewer_axes, flexes, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import RefinementStudy
from flexlink.advice.step_options import PROMISING_ERROR
from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method

BASE_HINGES = 4
"""Hinges of every link while one link is changed."""

FINER = {
    "midpoint": (3, 4, 6, 8, 10, 12, 16),
    "gauss": (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96),
    "legendre": (3, 4, 5, 6, 8, 10, 12),
}
"""Candidate numbers of hinges by rule, beside 1 and 2; errors for more hinges than `BASE_HINGES` are scaled."""


class LinkErrors:
    """Errors of the choices for each link from the limit, (samples, 3) [m]; `known`: those of whole models.

    Attributes
    ----------
    efforts
        Evaluations of an implicit method with fewer axes of a link, over those of the base: fast twist of slender beams
        keeps its steps short.
    """

    def __init__(
        self, runner: ModelRunner, norm: TipErrorNorm, refinement: RefinementStudy, stepping: Stepping
    ) -> None:
        assert refinement.limit is not None
        self.runner, self.norm, self.refinement, self.stepping = runner, norm, refinement, stepping
        self.limit, self.tolerance = refinement.limit.tip, refinement.tolerance
        self.errors: dict[tuple[int, Bend | None], Array] = {}
        self.efforts: dict[tuple[int, str], float] = {}
        self.known: dict[Model, Array] = {model: run.tip - self.limit for model, run in refinement.models().items()}
        self.bending = [k for k, flex in enumerate(refinement.axes) if flex != "rigid"]
        tips = {level.hinges: level.outcome.tip for level in refinement.levels["gauss"]}
        self.base = BASE_HINGES if BASE_HINGES in tips and refinement.finest.hinges > BASE_HINGES else BASE_HINGES // 2
        if self.base in tips and self.base // 2 in tips:
            self._share_out(tips)

    def error(self, model: Model) -> Array | None:
        """Error of a model, measured or superposed; None if one of its choices is no candidate."""
        if model in self.known:
            return self.known[model]
        parts = [self.errors.get((k, model[k])) for k in self.bending]
        return None if any(part is None for part in parts) else np.sum([p for p in parts if p is not None], axis=0)

    def implicit_effort(self, model: Model) -> float:
        """Evaluations of an implicit method over those of the base model, by the axes of its links."""
        return float(np.prod([
            self.efforts.get((k, flex), 1.0) for k, flex in enumerate(flexes(model)) if flex != self.refinement.axes[k]
        ]))  # fmt: skip

    def choices(self, k: int) -> dict[Bend | None, Array]:
        """Errors of the choices for a link."""
        return {bend: error for (link, bend), error in self.errors.items() if link == k}

    def _share_out(self, tips: dict[int, Array]) -> None:
        """Divide the error of the base model among its links like its change from half the hinges."""
        base, half, axes = self.base, self.base // 2, self.refinement.axes
        rest = tips[base] - self.limit
        if len(self.bending) == 1:
            changes = {self.bending[0]: tips[half] - tips[base]}
            own = {self.bending[0]: rest}
        else:
            changes = {k: self._changed(k, by_rule(axes[k], half)) for k in self.bending}
            total = np.sum(list(changes.values()), axis=0)
            share = np.copysign(self.norm(rest) / (self.norm(total) or 1.0), np.vdot(rest, total))
            own = {k: share * change for k, change in changes.items()}
        factors = self._rule_factors(tips[base])
        for k in self.bending:
            self.errors[k, by_rule(axes[k], half)] = changes[k] + own[k]
            self.errors[k, by_rule(axes[k], base)] = own[k]
            self._coarse(k, own[k])
            self._fine(k, own[k], factors)
            self._fewer_axes(k)

    def _changed(self, k: int, bend: Bend | None) -> Array:
        """Change of the base model's tip path by a choice for a link."""
        base = uniform(self.refinement.axes, self.base)
        before = self.runner.run(base, self.refinement.stepping)
        after = self.runner.run((*base[:k], bend, *base[k + 1 :]), self.stepping)
        counts = [_implicit_evaluations(outcome) for outcome in (after, before)]
        if all(counts):
            self.efforts[k, bend.flex if bend else "rigid"] = counts[0] / counts[1]
        return after.tip - before.tip

    def _rule_factors(self, base: Array) -> dict[str, float]:
        """Errors of other rules over that of gauss, with `BASE_HINGES` hinges in every link."""
        factors = {"gauss": 1.0, "legendre": 1.0, "midpoint": 1.0}
        error = self.norm(base - self.limit)
        if self.base == BASE_HINGES and error > 0:
            for rule in ("legendre", "midpoint"):
                model = tuple(bend and bend._replace(rule=rule) for bend in uniform(self.refinement.axes, BASE_HINGES))
                if model not in self.known:
                    self.known[model] = self.runner.run(model, self.stepping).tip - self.limit
                factors[rule] = float(np.clip(self.norm(self.known[model]) / error, 0.03, 3.0))
        return factors

    def _coarse(self, k: int, own: Array) -> None:
        """A rigid link, or one hinge: measured."""
        alone = len(self.bending) == 1
        if not alone:
            self.errors[k, None] = self._changed(k, None) + own
        one = by_rule(self.refinement.axes[k], 1)
        if (k, one) not in self.errors:
            known = self.known.get(uniform(self.refinement.axes, 1)) if alone else None
            self.errors[k, one] = self._changed(k, one) + own if known is None else known

    def _fine(self, k: int, own: Array, factors: dict[str, float]) -> None:
        """More hinges than half of the base: scaled by the order of convergence, in general 2, from few hinges on 3."""
        flex, alone = self.refinement.axes[k], len(self.bending) == 1
        for rule, counts in FINER.items():
            for hinges in counts:
                if hinges > max(3 * self.refinement.finest.hinges, 2 * BASE_HINGES):  # convergence not observed
                    continue
                bend = Bend(flex, rule, hinges)
                model = tuple(bend if j == k else None for j in range(len(self.refinement.axes)))
                if alone and model in self.known:
                    self.errors[k, bend] = self.known[model]
                    continue
                order = 2.0 if self.base == BASE_HINGES else 3.0
                self.errors[k, bend] = own * (self.base / hinges) ** order * factors[rule]

    def _fewer_axes(self, k: int) -> None:
        flex = self.refinement.axes[k]
        for less in fewer_axes(flex):
            change = self._changed(k, by_rule(less, self.base))
            if self.norm(change) < PROMISING_ERROR * self.tolerance:
                for bend, error in self.choices(k).items():
                    if bend is not None and bend.flex == flex:
                        self.errors[k, bend._replace(flex=less)] = error + change


def _implicit_evaluations(outcome: Outcome) -> int:
    """Evaluations of a complete run of an implicit method; 0 for others."""
    steps = outcome.run.steps if outcome.run is not None and outcome.completed else None
    return 0 if steps is None or method(steps.method).explicit else steps.evaluations
