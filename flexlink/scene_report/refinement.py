"""Compare a scene's run with runs that have other numbers of hinges, axes and steps: tip errors and costs.

Errors are relative to the limit that `results.convergence` extrapolates, with the observed order, from discretisations
with 1, 2 and 4 times the hinges. CPU times are for this machine.
"""

import itertools
import math
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexlink.advice.model import FLEX, Bend, Model, can_move, limited_axes
from flexlink.advice.model_runner import Outcome, Stepping
from flexlink.common.types import Array
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.schemes.methods import method
from flexlink.motion.evaluation_cost import machine_factor, run_cost
from flexlink.motion.inputs.problem import problem_of
from flexlink.results.convergence import Limit, extrapolated, observed_order
from flexlink.results.tip_motion import distances, largest_distance, largest_so_far
from flexlink.scene_report.study import Study

FACTORS = (0.5, 2.0, 4.0)  # numbers of hinges of the other discretisations, as multiples of the scene's number

ENOUGH = 0.01  # largest acceptable model error, and largest uncertainty of the limit, as a fraction of the tip's travel


class Choice(NamedTuple):
    """The scene's run, or an alternative to it."""

    label: str
    n: int
    stepping: str
    outcome: Outcome
    error: float  # largest tip error at any sample [m]; nan if unknown
    seconds: float  # CPU time [s]


class Refinement:
    """The scene's run and its alternatives."""

    def __init__(self, study: Study) -> None:
        self.study, self.scene, self.chain = study, study.scene, study.chain
        self.run, self.runner = study.run, study.runner

    @cached_property
    def model(self) -> Model:
        """The scene's discretisation, that is, how every link bends."""
        return tuple(
            Bend(link.flex, link.lumping, link.segments - 1, link.strain_modes) if link.flex != "rigid" else None
            for link in self.scene.arm.links
        )

    @cached_property
    def strict(self) -> Stepping:
        """Adaptive steps whose errors, even if the motion amplifies them, are small compared with those of hinges."""
        usual, stricter = (Stepping("auto", tolerance=part * self.study.travel) for part in (1e-5, 1e-7))
        off = largest_distance(self.runner.run(self.model, usual).tip, self.converged.tip)
        return stricter if off > 1e-5 * self.study.travel else usual

    @property
    def gives_state(self) -> bool:
        """Whether the scene specifies the initial state of all joints, so that other discretisations cannot use it."""
        return self.scene.initial.q is not None or self.scene.initial.qd is not None

    @cached_property
    def cuts(self) -> dict[float, Outcome]:
        """Completed runs by multiples of the scene's number of hinges; 1 is the scene's discretisation."""
        if self.gives_state or not any(self.model):
            return {}
        apart = {self.cut(factor): factor for factor in (*FACTORS, 1.0)}  # for one hinge, factor 0.5 changes nothing
        runs = {factor: self.runner.run(model, self.strict) for model, factor in apart.items()}
        return {factor: runs[factor] for factor in sorted(runs) if runs[factor].completed}

    def cut(self, factor: float) -> Model:
        """Return the discretisation with this multiple of the hinges; a multiple < 1 is rounded as the rules allow."""
        return tuple(bend and scaled(bend, factor) for bend in self.model)

    def times_the_hinges(self, factor: float, times: str) -> str:
        """Describe a discretisation; `times` is the text for the factor."""
        exact = all(bend is None or scaled(bend, factor).hinges == factor * bend.hinges for bend in self.model)
        return f"{times} the hinges" if exact else f"about {times} the hinges"

    @cached_property
    def limit(self) -> Limit | None:
        """Limit of the discretisations; the finest one if changes do not decrease; None if only one run completed."""
        cuts = [(factor, self.cuts[factor].tip) for factor in (1.0, 2.0, 4.0) if factor in self.cuts]
        if len(cuts) < 2:
            return None
        lowest, highest = math.log2(1.5), 4.0  # smallest accepted observed order; largest order used
        order = min(observed_order(cuts), highest) if len(cuts) == 3 else math.nan
        finest = cuts[-1][1]
        if not order >= lowest:
            changes = [largest_so_far(distances(b, a)) for (_, a), (_, b) in itertools.pairwise(cuts)]
            return Limit(finest, np.maximum.reduce(changes))
        limit = extrapolated(cuts, order)
        return limit._replace(errors=largest_so_far(distances(limit.tip, finest)) + (self.strict.tolerance or 0.0))

    def accurate_until(self, part: float) -> float:
        """Return the time [s] up to which the two finest discretisations differ by less than `part` of the travel."""
        t, cuts = self.run.t, list(self.cuts.values())[-2:]
        if len(cuts) < 2:
            return float(t[0])
        apart = distances(cuts[1].tip, cuts[0].tip) > part * self.study.travel
        return float(t[apart.argmax()] if apart.any() else t[-1])

    def error(self, tip: Array) -> float:
        """Return the largest distance of a tip path from the limit [m]; nan if the limit is unknown."""
        return largest_distance(tip, self.limit.tip) if self.limit is not None and self.is_accurate else math.nan

    @property
    def is_accurate(self) -> bool:
        """Whether the limit is accurate enough to measure errors against it."""
        return self.limit is not None and self.limit.error <= ENOUGH * self.study.travel

    @property
    def factors(self) -> tuple[float, float]:
        """Factors of the scene's steps or tolerance for a coarser and a finer run."""
        return (10.0, 0.1) if self.scene.run.controlled else (2.0, 0.5)

    @cached_property
    def converged(self) -> Limit:
        """Tip path of the scene's discretisation as steps get finer: of a strict run, or extrapolated from finer steps.

        Fixed steps are extrapolated if they are about as accurate as the strict run. Without a run it is nan.
        """
        own, run, finer = self.run.tip, self.scene.run, self.factors[1]
        allowed = self.stepping(finer).tolerance or math.inf  # [m]
        for part in (1e-7, 1e-5) if run.controlled else (1e-7,):  # the smaller tolerance may exceed the budget
            tolerance = min(part * self.study.travel, allowed)
            strict = self.runner.run(self.model, Stepping("auto", tolerance=tolerance))
            if strict.completed and (run.controlled or largest_distance(own, strict.tip) > 10 * tolerance):
                return Limit(strict.tip, np.array([tolerance]))
        smaller = self.runner.run(self.model, self.stepping(finer)).tip
        order = math.inf if run.controlled else method(run.method).order
        tip = own + (smaller - own) / (1 - finer**order)
        return Limit(tip, np.array([allowed if run.controlled else largest_distance(tip, smaller)]), order)

    @property
    def of_steps(self) -> float:
        """Error of the scene's steps [m]; nan if unknown. With the error of the hinges it is at least the whole one."""
        return largest_distance(self.converged.tip, self.run.tip)

    @property
    def of_hinges(self) -> float:
        """Error of the scene's number of hinges [m], without that of its steps; nan if unknown."""
        return self.error(self.converged.tip)

    def stepping(self, factor: float) -> Stepping:
        """Return the scene's steps or tolerance, multiplied by a factor."""
        run = self.scene.run
        if not run.controlled:
            return Stepping(run.method, step=factor * run.fixed_step)
        size = float(self.study.bent_by.max()) if run.accuracy == "deflection" else self.chain.size
        return Stepping(run.method, tolerance=factor * run.tolerance_within(size))

    @cached_property
    def scale(self) -> float:
        """CPU time of evaluations on this machine, relative to the times listed in `motion.evaluation_cost`."""
        return machine_factor(problem_of(self.scene, self.chain, tied=True))

    def choices(self) -> list[Choice]:
        """Return the scene's run, followed by the alternatives."""
        steps, run, controlled = self.run.steps, self.runner.run, self.scene.run.controlled
        seconds = run_cost(self.chain, steps.method, steps.evaluations) if steps else math.nan
        found = [self._choice("this scene", Outcome(self.run.tip, seconds, self.run, self.stepping(1.0)))]
        what = "tolerance" if controlled else "step"
        found += [self._choice(f"{_times(k)} the {what}", run(self.model, self.stepping(k))) for k in self.factors]
        if self.gives_state or not any(self.model):
            return found
        if not controlled:
            found.append(self._choice("adaptive steps", run(self.model, self.strict)))
        others = [(self.times_the_hinges(factor, _times(factor)), self.cut(factor)) for factor in FACTORS]
        others += [(f"{', '.join(flex)} bending only", self.limited_axes(flex)) for flex in FLEX[1:-1]]
        others.append(("rigid links", (None,) * len(self.model)))
        for label, model in others:
            if model != self.model and can_move(self.scene, model):
                found.append(self._choice(label, run(model, self.strict)))
        return found

    def limited_axes(self, top: str) -> Model:
        """Return the scene's discretisation with bending only about these axes."""
        axes = limited_axes([bend.flex if bend else FLEX[0] for bend in self.model], top)
        return tuple(bend and bend._replace(flex=flex) for bend, flex in zip(self.model, axes, strict=True))

    def _choice(self, label: str, outcome: Outcome) -> Choice:
        n = outcome.run.chain.freedoms if outcome.run is not None else 0
        error = self.error(outcome.tip) if outcome.completed else math.nan
        steps = outcome.run.steps if outcome.run is not None else None
        stepping = f"{steps.method}, {steps.taken} steps" if steps is not None else "by a tolerance"
        if outcome.stepping.step is not None:
            stepping = f"{outcome.stepping.method}, {outcome.stepping.step:g} s"
        return Choice(label, n, stepping, outcome, error, self.scale * outcome.seconds)


def scaled(bend: Bend, factor: float) -> Bend:
    """Return a link with this multiple of the hinges, moving one by one; if < 1, the nearest that its rule accepts."""
    wanted = round(factor * bend.hinges)
    if factor < 1:
        nearest = sorted(range(bend.hinges, 0, -1), key=lambda count: abs(count - wanted))
        wanted = next(filter(lumping_rule(bend.rule).takes, nearest))
    return bend._replace(hinges=wanted, modes=None)


def _times(factor: float) -> str:
    return {0.1: "a tenth of", 0.5: "half", 2.0: "twice"}.get(factor, f"{factor:g} times")
