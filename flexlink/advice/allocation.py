"""Cheapest numbers of hinges N_k of links with errors C_k / N_k^p (see `link_errors`), for an allowed error.

    N_k ∝ (C_k / c_k)^(1/(p+1))        minimizes Σ c_k N_k for an allowed Σ C_k / N_k^p, c_k the cost of a hinge

N_k is rounded up to a number that the rules offer. Then some hinges, one axis or all bending of a link is removed,
whichever saves most. This is repeated as long as the error is allowed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from flexlink.advice.families import FAMILIES
from flexlink.advice.link_errors import LinkErrors
from flexlink.advice.model import Bend, Model, by_rule


class Allocation:
    """Find models for an allowed error; predictions are corrected by errors `measured` [m] in runs of models."""

    def __init__(self, link_errors: LinkErrors, cost: Callable[[Model], float]) -> None:
        self.link_errors, self.cost = link_errors, cost
        self.measured, self._correction = dict(link_errors.known), 1.0

    def learn(self, model: Model, error: float) -> None:
        """Use the measured error of a model [m] to correct predictions."""
        predicted = self.link_errors.error(model)
        if predicted:
            ratio = error / predicted
            self._correction = max(0.3, min(ratio, ratio**0.5, 3.0))  # time steps may cause part of a large error
        self.measured.setdefault(model, error)

    def cheapest(self, allowed: float) -> Model | None:
        """The cheapest model with at most this error [m]; None if no model is predicted to be this accurate."""
        enough = [model for model, error in self.measured.items() if error <= allowed]
        enough += filter(None, [self._rounded_up(allowed)])
        cost, model = min(((self.cost(model), model) for model in enough), key=_first, default=(math.inf, None))
        if model is None:
            return None
        while True:
            smaller = [(self.cost(less), less) for less in self._smaller(model) if self._error(less) <= allowed]
            least, less = min(smaller, key=_first, default=(math.inf, model))
            if least >= cost:
                return model
            cost, model = least, less

    def _error(self, model: Model) -> float:
        measured = self.measured.get(model)
        return self._correction * self.link_errors.error(model) if measured is None else measured

    def _rounded_up(self, allowed: float) -> Model | None:
        axes, most = self.link_errors.refinement.axes, max(3 * self.link_errors.refinement.finest.hinges, 8)
        constants = {k: self._correction * self.link_errors.constant(k) for k in self.link_errors.bending}
        if not all(map(math.isfinite, constants.values())):  # the run that measures a constant failed
            return None
        p, family = self.link_errors.order, FAMILIES[self.link_errors.family]
        shape = {k: (constant / len(axes[k])) ** (1 / (p + 1)) for k, constant in constants.items()}
        total = sum(constants[k] / shape[k] ** p for k in shape if shape[k])
        scale = (total / allowed) ** (1 / p)
        hinges = {k: family.rounded_up(max(1, math.ceil(scale * size))) for k, size in shape.items()}
        while max(hinges.values()) <= most:
            model = tuple(self._bend(flex, hinges.get(k, 0)) for k, flex in enumerate(axes))
            if self._error(model) <= allowed:
                return model
            # with few hinges, errors do not yet fall as 1 / N^p
            hinges = {k: family.rounded_up(count + max(1, count // 4)) for k, count in hinges.items()}
        return None

    def _smaller(self, model: Model) -> Iterator[Model]:
        for k, bend in enumerate(model):
            if bend:
                counts = FAMILIES[self.link_errors.family].fewer(bend.hinges)
                options = [self._bend(bend.flex, count) for count in counts]
                options += [bend._replace(flex=flex) for flex in self.link_errors.axes(k) if len(flex) < len(bend.flex)]
                yield from ((*model[:k], option, *model[k + 1 :]) for option in options)

    def _bend(self, flex: str, hinges: int) -> Bend | None:
        return by_rule(flex, hinges, self.link_errors.refinement.family) if hinges else None


def _first(option: tuple[float, Model]) -> float:
    return option[0]
