"""Search for the cheapest model and steps; models are predicted from the order of convergence, corrected by a few runs.

Adaptive steps have at most the allowed error as their tolerance, so that the run's own stated error is within the
goal; less only if no model meets the goal otherwise. Fixed steps are tried if they are predicted to be cheaper, then
models with fewer hinges in one link, and adaptive explicit steps if stability allows long enough ones.
"""

import functools
import math
import operator
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.advice.goal import Thresholds, TipErrorNorm
from flexlink.advice.model import FAMILIES, FLEX, GAUSS, Bend, Model, by_rule, can_move, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import RefinementStudy
from flexlink.common.types import Array
from flexlink.describe.link import AXES, of_number


class Solution(NamedTuple):
    """A run whose error is allowed."""

    model: Model
    outcome: Outcome
    error: float  # relative to the limit [m]


# Errors of the tip's path due to each link, measured with few hinges; they decrease with the rules' order p.
#
#     e_k(N) = C_k / N^p         N hinges in link k, p = 2, or 4 for cells
#
# The error paths of all links are added with their signs.


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
            for flex in FLEX[1 : FLEX.index(self.refinement.axes[k])]:  # z for yz, z and yz for xyz
                self._fewer_axes[k, flex] = self._changed(k, by_rule(flex, self.base, self.family))

    def from_limit(self, tip: Array) -> float:
        """Distance of a tip path (samples, 3) from the limit [m]."""
        assert self.refinement.limit is not None
        return self.norm(tip - self.refinement.limit.tip)

    def solution(self, model: Model, outcome: Outcome, allowed: float) -> Solution | None:
        """A run as a solution; None if it failed, or if its error exceeds the allowed one [m]."""
        error = self.from_limit(outcome.tip)
        return Solution(model, outcome, error) if outcome.completed and error <= allowed else None

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
        if (path := self._few.get((k, hinges))) is None:
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
        return by_rule(self.refinement.axes[k], hinges, self.family)

    @property
    def _base_model(self) -> Model:
        return uniform(self.refinement.axes, self.base, self.family)

    def _changed(self, k: int, bend: Bend | None) -> Array:
        """Change of the base model's tip path if one link bends in another way."""
        base, stepping = self._base_model, self.refinement.stepping
        return self.runner.run((*base[:k], bend, *base[k + 1 :]), stepping).tip - self.runner.run(base, stepping).tip


class Search:
    """Search for the cheapest run whose error is allowed; `solution` is the best run so far."""

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, allowed: float) -> None:
        self.runner, self.link_errors, self.allowed = runner, link_errors, allowed  # error relative to the limit [m]
        self.solution: Solution | None = None
        self._stable_steps: dict[tuple[int, Bend], float] = {}

    def best(self) -> Solution | None:
        """The cheapest solution; None if there is none."""
        # shares of the allowed error for the model, and step tolerances: actual step errors are usually far smaller
        for share, factor in ((0.95, 1.0), (0.6, 1.0), (0.95, 0.25), (0.95, 0.06)):
            if self._fit(share, self._implicit_cost, functools.partial(self._by_tolerance, factor * self.allowed)):
                break
        self._loosen()
        for part in (1.0, 0.5):
            if self._fit(0.98, functools.partial(self._fixed_cost, part), functools.partial(self._fixed, part)):
                break
        self._coarser()
        self._explicit()
        return self.solution

    def accept(self, model: Model, outcome: Outcome) -> bool:
        """Adopt a run if its error is allowed and no earlier run is cheaper; return whether its error is allowed.

        `simulate` compares some runs with others and returns a finer one, without errors of steps that cancel those of
        the model. So a run is adopted only if what `simulate` returns is allowed as well.
        """
        found = self.link_errors.solution(model, outcome, self.allowed)
        if found is None or (self.solution is not None and outcome.seconds >= self.solution.outcome.seconds):
            return found is not None
        returned = self.runner.run(model, outcome.stepping, compared=True)
        found = self.link_errors.solution(model, returned, self.allowed)
        if found and (self.solution is None or returned.seconds < self.solution.outcome.seconds):
            self.solution = found
        return found is not None

    def _fit(self, share: float, cost: Callable[[Model], float], steps: Callable[[Model], Stepping | None]) -> bool:
        """Run the cheapest models for a share of the allowed error; return False if their steps fail."""
        allocation, least = Allocation(self.link_errors, cost), np.inf
        for _ in range(6):
            model = allocation.cheapest(share * self.allowed)
            if model is None or cost(model) >= least:
                break
            if (stepping := steps(model)) is None:
                return True
            outcome = self.runner.run(model, stepping)
            error = self.link_errors.from_limit(outcome.tip)
            if self.accept(model, outcome):
                least = cost(model)
            elif not np.isfinite(error) or model in allocation.measured:
                return outcome.over_budget
            allocation.learn(model, error)
        return bool(np.isfinite(least))

    def _loosen(self) -> None:
        """Increase the tolerance of the solution as long as the error is allowed, first by 2, then by √2."""
        if self.solution is None or self.solution.outcome.stepping.tolerance is None:
            return
        model, tolerance = self.solution.model, self.solution.outcome.stepping.tolerance
        for factor in (2.0, math.sqrt(2.0)):
            while factor * tolerance <= self.allowed and self.accept(
                model, self.runner.run(model, self._by_tolerance(factor * tolerance, model))
            ):
                tolerance *= factor

    def _coarser(self) -> None:
        """Try fewer hinges in one link, as long as a run is cheaper: small errors of model and steps may cancel."""
        before = np.inf
        while self.solution is not None and self.solution.outcome.seconds < before:
            model, outcome, _ = self.solution
            if outcome.stepping.tolerance is None:
                return
            before = outcome.seconds
            for fewer in self._with_fewer_hinges(model):
                self.accept(fewer, self.runner.run(fewer, outcome.stepping))

    def _with_fewer_hinges(self, model: Model) -> Iterator[Model]:
        """Models in which one link has fewer hinges, of any rule, or is rigid."""
        families = dict.fromkeys((self.link_errors.refinement.family, GAUSS))
        for k, bend in enumerate(model):
            if bend is None:
                continue
            fewer = [by_rule(bend.flex, n, family) for family in families for n in FAMILIES[family].fewer(bend.hinges)]
            for less in dict.fromkeys(fewer):
                smaller = (*model[:k], less, *model[k + 1 :])
                if can_move(self.runner.scene, smaller):
                    yield smaller

    def _explicit(self) -> None:
        """Try DOP853 with the model of the solution."""
        if self.solution is None:
            return
        model, outcome, _ = self.solution
        if self.runner.least_explicit_cost(model) >= outcome.seconds:
            return
        self.accept(model, self.runner.run(model, Stepping("DOP853", tolerance=self.allowed)))

    def _by_tolerance(self, tolerance: float, model: Model) -> Stepping:
        return Stepping("Radau5", tolerance=tolerance)

    def _implicit_cost(self, model: Model) -> float:
        """Cost of an evaluation [s]; the number of evaluations hardly depends on the hinges."""
        return self.runner.evaluation_cost(model, explicit=False) if can_move(self.runner.scene, model) else np.inf

    def _fixed(self, part: float, model: Model) -> Stepping | None:
        """Steps that are this fraction of the stable step; None if the present solution is cheaper."""
        stable = self.runner.stable_step(model) if any(model) else np.inf
        stepping = self.runner.fixed_steps(part * Thresholds.stable_share * stable)
        most = self.runner.budget if self.solution is None else 0.99 * self.solution.outcome.seconds
        return stepping if stepping and self.runner.fixed_steps_cost(model, stepping) <= most else None

    def _fixed_cost(self, part: float, model: Model) -> float:
        """Cost of a run with fixed steps [s], from an estimated stable step."""
        if not can_move(self.runner.scene, model):
            return np.inf
        step = min((self._stable_step(k, bend) for k, bend in enumerate(model) if bend), default=np.inf)
        stepping = self.runner.fixed_steps(part * Thresholds.stable_share * step)
        return np.inf if stepping is None else self.runner.fixed_steps_cost(model, stepping)

    def _stable_step(self, k: int, bend: Bend) -> float:
        """Estimated stable step for a link [s], proportional to 1 / (number of hinges)²."""
        few = bend._replace(hinges=min(bend.hinges, 4))
        if (k, few) not in self._stable_steps:
            self._stable_steps[k, few] = self.runner.estimated_step(k, few)
        return self._stable_steps[k, few] * (few.hinges / bend.hinges) ** 2


# Cheapest numbers of hinges N_k of links with errors C_k / N_k^p (see `link_errors`), for an allowed error.
#
#     N_k ∝ (C_k / c_k)^(1/(p+1))        minimizes Σ c_k N_k for an allowed Σ C_k / N_k^p, c_k the cost of a hinge
#
# N_k is rounded up to a number that the rules offer. Then some hinges, one axis or all bending of a link is removed,
# whichever saves most. This is repeated as long as the error is allowed.


class Allocation:
    """Find models for an allowed error; predictions are corrected by errors `measured` [m] in runs of models."""

    def __init__(self, link_errors: LinkErrors, cost: Callable[[Model], float]) -> None:
        self.link_errors, self.cost = link_errors, cost
        self.measured, self._correction = dict(link_errors.known), 1.0

    def learn(self, model: Model, error: float) -> None:
        """Use the measured error of a model [m] to correct predictions."""
        if predicted := self.link_errors.error(model):
            ratio = error / predicted
            self._correction = max(0.3, min(ratio, ratio**0.5, 3.0))  # time steps may cause part of a large error
        self.measured.setdefault(model, error)

    def cheapest(self, allowed: float) -> Model | None:
        """The cheapest model with at most this error [m]; None if no model is predicted to be this accurate."""
        enough = [model for model, error in self.measured.items() if error <= allowed]
        enough += filter(None, [self._rounded_up(allowed)])
        first = operator.itemgetter(0)
        cost, model = min(((self.cost(model), model) for model in enough), key=first, default=(math.inf, None))
        if model is None:
            return None
        while True:
            smaller = [(self.cost(less), less) for less in self._smaller(model) if self._error(less) <= allowed]
            least, less = min(smaller, key=first, default=(math.inf, model))
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
        p, family, rules = self.link_errors.order, FAMILIES[self.link_errors.family], self.link_errors.refinement.family
        shape = {k: (constant / len(axes[k])) ** (1 / (p + 1)) for k, constant in constants.items()}
        scale = (sum(constants[k] / shape[k] ** p for k in shape if shape[k]) / allowed) ** (1 / p)
        hinges = {k: family.rounded_up(max(1, math.ceil(scale * size))) for k, size in shape.items()}
        while max(hinges.values()) <= most:
            model = tuple(by_rule(flex, hinges.get(k, 0), rules) for k, flex in enumerate(axes))
            if self._error(model) <= allowed:
                return model
            # with few hinges, errors do not yet fall as 1 / N^p
            hinges = {k: family.rounded_up(count + max(1, count // 4)) for k, count in hinges.items()}
        return None

    def _smaller(self, model: Model) -> Iterator[Model]:
        for k, bend in enumerate(model):
            if bend:
                counts = FAMILIES[self.link_errors.family].fewer(bend.hinges)
                options = [by_rule(bend.flex, count, self.link_errors.refinement.family) for count in counts]
                options += [bend._replace(flex=flex) for flex in self.link_errors.axes(k) if len(flex) < len(bend.flex)]
                yield from ((*model[:k], option, *model[k + 1 :]) for option in options)


# Search for the fewest strain modes whose error is allowed, for controllers, observers and explicit methods.
#
# The stations of the shapes are the hinges of the coarsest level whose error is at most half the allowed one. The
# number of modes, the same for all links and directions, is then increased until the error is allowed, and decreased
# again link by link and direction by direction; directions without modes, and links without directions, become rigid.


class ShapeSearch:
    """Search for the smallest model with strain modes, or with hinges that move one by one if those are fewer."""

    def __init__(self, runner: ModelRunner, link_errors: LinkErrors, allowed: float, *, explicit: bool) -> None:
        self.runner, self.link_errors, self.allowed, self.explicit = runner, link_errors, allowed, explicit
        self.stepping = Stepping("auto", tolerance=0.05 * allowed)
        self.lines: list[str] = []

    def best(self, cheapest: Solution | None) -> Solution | None:
        """The smallest solution, if any; the `cheapest` one, that of `Search`, has hinges that move one by one."""
        best: list[Solution] = []
        for name, several in (("one by one", (self._coarsest(1.0), cheapest)), ("strain modes", (self._shaped(),))):
            if found := [each for each in several if each is not None]:
                best.append(min(found, key=self.size))
                chain, stable = self.runner.chain(best[-1].model), self.runner.stable_step(best[-1].model)
                self.lines.append(f"{name}: {chain.freedoms} coordinates, largest stable step of RK4 {stable:.3g} s")
        if not best:
            return None
        smallest = min(best, key=self.size)
        return self._by_fixed_steps(smallest) if self.explicit else smallest

    def size(self, solution: Solution) -> float:
        """The measure to minimise: coordinates or, for explicit methods, CPU time per simulated second [s]."""
        model = solution.model
        if not self.explicit:
            return float(self.runner.chain(model).freedoms)
        return self.runner.evaluation_cost(model, explicit=True) / self.runner.stable_step(model)

    def _coarsest(self, share: float) -> Solution | None:
        """The coarsest level of the refinement study whose error is at most this share of the allowed error."""
        levels = self.link_errors.refinement.models().items()
        for model, outcome in sorted(levels, key=lambda level: self.runner.chain(level[0]).n):
            enough = self.link_errors.solution(model, outcome, share * self.allowed)
            if enough and (found := self._tried(model, outcome.stepping)):
                return found
        return None

    def _shaped(self) -> Solution | None:
        if (stations := self._coarsest(0.5)) is None:
            return None
        for count in range(1, min(bend.hinges for bend in stations.model if bend) + 1):
            model = tuple(bend and bend._replace(modes=of_number(count)) for bend in stations.model)
            if solution := self._tried(model, self.stepping):
                return self._with_fewer(solution)
        return None

    def _with_fewer(self, solution: Solution) -> Solution:
        """Remove modes one by one as long as the error is allowed."""
        model = solution.model
        for k in reversed(range(len(model))):  # from the tip inward
            for less in _less_of(model[k]):
                if found := self._tried((*model[:k], less, *model[k + 1 :]), self.stepping):
                    return self._with_fewer(found)
        return solution

    def _tried(self, model: Model, stepping: Stepping) -> Solution | None:
        """The solution of a run; None if it fails or its error is not allowed."""
        if not can_move(self.runner.scene, model):
            return None
        return self.link_errors.solution(model, self.runner.run(model, stepping, compared=True), self.allowed)

    def _by_fixed_steps(self, solution: Solution) -> Solution:
        """The same model by RK4 with the largest stable or accurate step."""
        longest = Thresholds.stable_share * self.runner.stable_step(solution.model)
        for part in (1.0, 0.5, 0.25):
            if (stepping := self.runner.fixed_steps(part * longest)) is None:
                break
            if found := self._tried(solution.model, stepping):
                return found
        return solution


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
