"""What each choice for each link does to the tip, as paths in time: they add up, with their signs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.goal import Ruler
from flexlink.advice.ladder import RefinementStudy
from flexlink.advice.model import Bend, Model, by_rule, flexes, lesser, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.describe.schemes.methods import method

Array = NDArray[np.float64]

BASE = 4
"""Hinges of every link while one of them is changed."""

FINER = {
    "midpoint": (3, 4, 6, 8, 10, 12, 16),
    "gauss": (4, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 96),
    "legendre": (3, 4, 5, 6, 8, 10, 12),
}
"""Hinges that are thought of, by rule, beside 1 and 2; the error of more hinges than `BASE` is scaled."""

BEYOND = 3
"""Times the hinges of the finest level, up to which more are thought of: it is known to converge only so far."""

ORDER, FASTER = 2.0, 3.0
"""Of convergence from `BASE` on, and from fewer hinges."""

PROMISING = 1.3
"""Tolerances of error up to which fewer axes of a link are worth a thought: what else is off may have another sign."""


class Parts:
    """Errors of the choices for each link against the limit, (samples, 3) [m]; `known` are those of whole models.

    Attributes
    ----------
    efforts
        How many times the evaluations of the base an implicit method takes if a link has fewer axes: where beams are
        slender, their twist may follow so fast that Newton's iteration keeps the steps short.
    """

    def __init__(self, bench: ModelRunner, ruler: Ruler, ladder: RefinementStudy, stepping: Stepping) -> None:
        assert ladder.limit is not None
        self.bench, self.ruler, self.ladder, self.stepping = bench, ruler, ladder, stepping
        self.limit, self.tolerance = ladder.limit.tip, ladder.tolerance
        self.errors: dict[tuple[int, Bend | None], Array] = {}
        self.efforts: dict[tuple[int, str], float] = {}
        self.known: dict[Model, Array] = {model: run.tip - self.limit for model, run in ladder.known().items()}
        self.bending = [k for k, flex in enumerate(ladder.axes) if flex != "rigid"]
        tips = {level.hinges: level.outcome.tip for level in ladder.levels["gauss"]}
        self.base = BASE if BASE in tips and ladder.finest.hinges > BASE else BASE // 2
        if self.base in tips and self.base // 2 in tips:
            self._take_apart(tips)

    def error(self, model: Model) -> Array | None:
        """Of a model, measured or added up; None if a choice in it was not thought of."""
        if model in self.known:
            return self.known[model]
        parts = [self.errors.get((k, model[k])) for k in self.bending]
        return None if any(part is None for part in parts) else np.sum([p for p in parts if p is not None], axis=0)

    def effort(self, model: Model) -> float:
        """Evaluations of an implicit method over those of the base, as far as axes tell."""
        return float(np.prod([
            self.efforts.get((k, flex), 1.0) for k, flex in enumerate(flexes(model)) if flex != self.ladder.axes[k]
        ]))  # fmt: skip

    def choices(self, k: int) -> dict[Bend | None, Array]:
        """What was thought of for a link."""
        return {bend: error for (link, bend), error in self.errors.items() if link == k}

    def _take_apart(self, tips: dict[int, Array]) -> None:
        """The error of the base is shared out to the links as its change from half the hinges is."""
        base, half, axes = self.base, self.base // 2, self.ladder.axes
        rest = tips[base] - self.limit
        if len(self.bending) == 1:
            changes = {self.bending[0]: tips[half] - tips[base]}
            own = {self.bending[0]: rest}
        else:
            changes = {k: self._changed(k, by_rule(axes[k], half)) for k in self.bending}
            total = np.sum(list(changes.values()), axis=0)
            share = np.copysign(self.ruler(rest) / (self.ruler(total) or 1.0), np.vdot(rest, total))
            own = {k: share * change for k, change in changes.items()}
        factors = self._rule_factors(tips[base])
        for k in self.bending:
            self.errors[k, by_rule(axes[k], half)] = changes[k] + own[k]
            self.errors[k, by_rule(axes[k], base)] = own[k]
            self._coarse(k, own[k])
            self._fine(k, own[k], factors)
            self._fewer_axes(k)

    def _changed(self, k: int, bend: Bend | None) -> Array:
        """What it does to the tip of the base if a link bends so."""
        base = uniform(self.ladder.axes, self.base)
        before = self.bench.run(base, self.ladder.stepping)
        after = self.bench.run((*base[:k], bend, *base[k + 1 :]), self.stepping)
        counts = [_implicit_evaluations(outcome) for outcome in (after, before)]
        if all(counts):
            self.efforts[k, bend.flex if bend else "rigid"] = counts[0] / counts[1]
        return after.tip - before.tip

    def _rule_factors(self, base: Array) -> dict[str, float]:
        """Errors of other rules over that of gauss, at `BASE` hinges in every link."""
        factors = {"gauss": 1.0, "legendre": 1.0, "midpoint": 1.0}
        error = self.ruler(base - self.limit)
        if self.base == BASE and error > 0:
            for rule in ("legendre", "midpoint"):
                model = tuple(bend and bend._replace(rule=rule) for bend in uniform(self.ladder.axes, BASE))
                if model not in self.known:
                    self.known[model] = self.bench.run(model, self.stepping).tip - self.limit
                factors[rule] = float(np.clip(self.ruler(self.known[model]) / error, 0.03, 3.0))
        return factors

    def _coarse(self, k: int, own: Array) -> None:
        """Rigid, or one hinge; measured."""
        alone = len(self.bending) == 1
        if not alone:
            self.errors[k, None] = self._changed(k, None) + own
        one = by_rule(self.ladder.axes[k], 1)
        if (k, one) not in self.errors:
            known = self.known.get(uniform(self.ladder.axes, 1)) if alone else None
            self.errors[k, one] = self._changed(k, one) + own if known is None else known

    def _fine(self, k: int, own: Array, factors: dict[str, float]) -> None:
        """More hinges than half the base; scaled by the order of convergence."""
        flex, alone = self.ladder.axes[k], len(self.bending) == 1
        for rule, counts in FINER.items():
            for hinges in counts:
                if hinges > max(BEYOND * self.ladder.finest.hinges, 2 * BASE):
                    continue
                bend = Bend(flex, rule, hinges)
                model = tuple(bend if j == k else None for j in range(len(self.ladder.axes)))
                if alone and model in self.known:
                    self.errors[k, bend] = self.known[model]
                    continue
                order = ORDER if self.base == BASE else FASTER
                self.errors[k, bend] = own * (self.base / hinges) ** order * factors[rule]

    def _fewer_axes(self, k: int) -> None:
        flex = self.ladder.axes[k]
        for less in lesser(flex):
            change = self._changed(k, by_rule(less, self.base))
            if self.ruler(change) < PROMISING * self.tolerance:
                for bend, error in self.choices(k).items():
                    if bend is not None and bend.flex == flex:
                        self.errors[k, bend._replace(flex=less)] = error + change


def _implicit_evaluations(outcome: Outcome) -> int:
    """Of a whole run of an implicit method; 0 of others."""
    steps = outcome.run.steps if outcome.run is not None and outcome.whole else None
    return 0 if steps is None or method(steps.method).explicit else steps.evaluations
