"""Models and steps in the order of what they are expected to cost, each run, until none is cheaper and good enough."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.bench import OF_STABLE, Bench, Outcome, Stepping
from flexlink.advice.model import Bend, Model, is_scene, uniform
from flexlink.advice.parts import Parts
from flexlink.advice.price import bodies_of, prices
from flexlink.advice.ways import Probes
from flexlink.describe.methods import method

Array = NDArray[np.float64]

TRIES, AFTER = 12, 5
"""Runs at most up to the first that is good enough, and of cheaper ones after it."""

WORTH = 0.9
"""Cost over that of the best, from which a candidate is not worth a run."""

HOPE, HOPE_AFTER = 1.1, 1.6
"""Predicted errors, over what is allowed, of candidates that are run, before one is good enough and after."""

MOST = 4000
"""Combinations of choices that are thought of."""

HALF = 0.6
"""Predicted part of the tolerance up to which an error that is too large is laid to the steps, and they are halved."""

LEARN = 0.5
"""Power of what a run cost over what was expected, by which others of its method are expected to cost more."""

SCALED = 4
"""Hinges up to which the stable step of a link is estimated; beyond, it falls with their square."""


class Candidate(NamedTuple):
    """A model with its steps, before it is run."""

    cost: float  # expected [s of CPU]
    model: Model
    method: str
    factor: float  # as of `Way`


class Found(NamedTuple):
    """A run that is good enough."""

    model: Model
    outcome: Outcome
    error: float  # against the limit [m]


class Search:
    """Candidates, what was learned of their errors and costs, and the best one so far, `found`."""

    def __init__(self, bench: Bench, parts: Parts, allowed: float, known_to: float) -> None:
        self.bench, self.parts, self.ruler = bench, parts, parts.ruler
        self.allowed = allowed - known_to  # of the difference to the limit [m]
        self.found: Found | None = None
        self.tried: set[tuple[Model, str, float]] = set()
        self.bias, self.of_steps = 1.0, 1.0  # errors of models and of steps, over those predicted
        self.probes = self._probes()
        self._norms: dict[Model, float] = {}
        self._steps: dict[tuple[int, Bend], float] = {}
        rigid = (None,) * len(bench.scene.arm.links)
        self._joints = bodies_of(bench.chain(rigid)) if is_scene(bench.scene, rigid) else np.zeros(4, np.intp)
        self._planar: dict[tuple[str, ...], bool] = {}

    def best(self) -> Found | None:
        """The cheapest that is good enough, as far as was looked."""
        pool = sorted(set(self._pool()), key=lambda candidate: candidate.cost)
        for hope, tries in ((HOPE, TRIES), (HOPE_AFTER, AFTER)):
            last, good = len(self.tried) + tries, False
            while not good and len(self.tried) < last and (candidate := self._next(pool, hope)):
                good = self._try(candidate, pool) and hope == HOPE
                pool.sort(key=lambda candidate: candidate.cost)
        return self.found

    def accept(self, model: Model, outcome: Outcome) -> bool:
        """Take a run for the best, if it is good enough and cheaper."""
        error = self.ruler(outcome.tip - self.parts.limit)
        good = outcome.whole and error <= self.allowed
        if good and (self.found is None or outcome.seconds < self.found.outcome.seconds):
            self.found = Found(model, outcome, error)
        return good

    def _next(self, pool: list[Candidate], hope: float) -> Candidate | None:
        """The cheapest that may be good enough, and is worth a run."""
        for candidate in pool:
            if self.found is not None and candidate.cost > WORTH * self.found.outcome.seconds:
                return None
            if candidate.cost > self.bench.budget:
                return None
            if candidate[1:] not in self.tried and self._may_do(candidate, hope * self.allowed):
                return candidate
        return None

    def _may_do(self, candidate: Candidate, most: float) -> bool:
        """Whether the predicted error, of the model and of its steps, is no more than this [m]."""
        _, model, name, factor = candidate
        steps, space = self.probes.steps.get((name, factor)), self._space(model)
        if steps is None or not np.isfinite(space):
            return space <= most
        least, largest = sorted((space, self.of_steps * steps.size))
        if largest - least > most or least + largest <= most:
            return largest <= most
        error, bias = self.parts.error(model), self._bias(model)
        assert error is not None
        return self.ruler(bias * error + self.of_steps * steps.error) <= most

    def _space(self, model: Model) -> float:
        """Predicted error of a model itself [m]."""
        if model not in self._norms:
            error = self.parts.error(model)
            self._norms[model] = np.inf if error is None else self.ruler(error)
        return self._norms[model] * self._bias(model)

    def _bias(self, model: Model) -> float:
        return 1.0 if model in self.parts.known else self.bias

    def _try(self, candidate: Candidate, pool: list[Candidate]) -> bool:
        """Run a candidate and learn from it: whether it is good enough.

        One whose steps are dearer than was thought goes back to its place.
        """
        model, name, factor = candidate[1:]
        if name == "RK4":
            stepping = self.bench.fixed(factor * OF_STABLE * self.bench.stable(model))
            exact = np.inf if stepping is None else self.bench.fixed_cost(model, stepping)
            if exact > 1.05 * candidate.cost:
                pool[pool.index(candidate)] = candidate._replace(cost=exact)
                return False
        else:
            stepping = Stepping(name, tolerance=factor * self.allowed)
        assert stepping is not None
        self.tried.add(candidate[1:])
        outcome = self.bench.run(model, stepping)
        error = self.ruler(outcome.tip - self.parts.limit)
        self._learn(candidate, outcome, error, pool)
        return self.accept(model, outcome)

    def _learn(self, candidate: Candidate, outcome: Outcome, error: float, pool: list[Candidate]) -> None:
        _, model, name, factor = candidate
        space, steps = self._space(model), self.probes.steps.get((name, factor))
        if steps is not None:
            ratio = outcome.seconds / candidate.cost if outcome.whole else 1.0
            pool[:] = [c._replace(cost=c.cost * ratio**LEARN) if c.method == name else c for c in pool]
            if not np.isfinite(error):
                return
            if steps.size * self.of_steps > space:
                self.of_steps = max(self.of_steps, min(3.0, 0.8 * (error - space) / steps.size))
                return
        elif error > self.allowed and space <= HALF * self.allowed:
            if factor == 1.0:
                pool.append(Candidate(2 * candidate.cost, model, name, 0.5))
            return
        if model not in self.parts.known and space > 0:
            self.bias = max(self.bias, min(3.0, 0.8 * error / (space / self.bias)))

    def _pool(self) -> Iterator[Candidate]:
        """All that is thought of, at its expected cost."""
        for model in self._models():
            step = min((self._step(k, bend) for k, bend in enumerate(model) if bend), default=np.inf)
            bodies = self._bodies(model)
            planar = self._is_planar(model)
            fixed = self.bench.fixed(OF_STABLE * step if np.isfinite(step) else self.bench.scene.run.sample)
            if fixed is not None and fixed.step is not None:
                count = method("RK4").stages * round(self.bench.scene.run.duration / fixed.step)
                yield Candidate(count * prices().evaluation(bodies, planar=planar, explicit=True), model, "RK4", 1.0)
            evaluation = prices().evaluation(bodies, planar=planar, explicit=False)
            effort = self.parts.effort(model) * evaluation
            for (name, factor), steps in self.probes.steps.items():
                yield Candidate(steps.evaluations * effort, model, name, factor)

    def _probes(self) -> Probes:
        """Of the base, whose runs may be good enough."""
        ladder = self.parts.ladder
        model = uniform(ladder.axes, self.parts.base)
        tip = self.bench.run(model, ladder.stepping).tip
        probes = Probes(self.bench, self.ruler, model, tip, self.allowed, ladder.motion)
        for outcome in probes.runs:
            self.accept(model, outcome)
        return probes

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
        choices = [(self.ruler(error), bend) for bend, error in self.parts.choices(k).items()]
        choices = [(error, bend) for error, bend in choices if error <= HOPE_AFTER * self.allowed]
        kept: dict[Bend | None, None] = {}
        for explicit in (False, True):
            least = np.inf
            for error, bend in sorted(choices, key=lambda choice: (self._weight(k, choice[1], explicit), choice[0])):
                if error < 0.98 * least:
                    kept[bend] = None
                    least = error
                if least < 0.02 * self.allowed:
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
        flexes = tuple(bend.flex if bend else "rigid" for bend in model)
        if flexes not in self._planar:
            plane = all(flex in {"rigid", "z"} for flex in flexes)
            self._planar[flexes] = plane and self.bench.chain(model).is_planar
        return self._planar[flexes]
