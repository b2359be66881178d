"""A scene's run beside others with more and fewer hinges, axes and steps: how far each is off, and what it costs.

Errors are those from the limit that `results.convergence` extrapolates from cuts with once, twice and four times the
hinges, by the order that these show. CPU times are those of this machine.
"""

from __future__ import annotations

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

FACTORS = (0.5, 2.0, 4.0)
"""Of the scene's hinges, in the cuts beside its own."""

ENOUGH = 0.01
"""Part of the tip's travel: a limit that is not known so well is none, and a model that is off by more is doubted."""


class Choice(NamedTuple):
    """A run beside the scene's own."""

    label: str
    n: int
    stepping: str
    outcome: Outcome
    error: float  # largest of the tip at any sample [m], nan where unknown
    seconds: float  # CPU time [s]


class Refinement:
    """Runs about one scene."""

    def __init__(self, study: Study) -> None:
        self.study, self.scene, self.chain = study, study.scene, study.chain
        self.run, self.runner = study.run, study.runner

    @cached_property
    def model(self) -> Model:
        """The scene's own cut."""
        return tuple(
            Bend(link.flex, link.lumping, link.segments - 1) if link.flex != "rigid" else None
            for link in self.scene.arm.links
        )

    @cached_property
    def strict(self) -> Stepping:
        """Steps whose errors are small beside those of cuts."""
        off = 1e-5  # part of the tip's travel: it hides in no error of a cut
        return Stepping("auto", tolerance=off * self.study.travel)

    @property
    def says_state(self) -> bool:
        """Whether the scene starts from the joints of its own cut, so that no other can be run."""
        return self.scene.initial.q is not None or self.scene.initial.qd is not None

    @cached_property
    def cuts(self) -> dict[float, Outcome]:
        """Runs with so many times the hinges, those that came to their end; 1 with the scene's own cut."""
        if self.says_state or not any(self.model):
            return {}
        apart = {self.cut(factor): factor for factor in (*FACTORS, 1.0)}  # of one hinge, half as many are as many
        runs = {factor: self.runner.run(model, self.strict) for model, factor in apart.items()}
        return {factor: runs[factor] for factor in sorted(runs) if runs[factor].completed}

    def cut(self, factor: float) -> Model:
        """The scene's cut with so many times the hinges; of fewer, about so many, as rules take them."""
        return tuple(bend and scaled(bend, factor) for bend in self.model)

    def times_the_hinges(self, factor: float, times: str) -> str:
        """Words for a cut, by words for the factor."""
        exact = all(bend is None or scaled(bend, factor).hinges == factor * bend.hinges for bend in self.model)
        return f"{times} the hinges" if exact else f"about {times} the hinges"

    @cached_property
    def limit(self) -> Limit | None:
        """What the cuts converge to; the finest one where their changes do not fall, None if fewer than two ran."""
        cuts = [(factor, self.cuts[factor].tip) for factor in (1.0, 2.0, 4.0) if factor in self.cuts]
        if len(cuts) < 2:
            return None
        lowest, highest = math.log2(1.5), 4.0  # observed orders below which none is believed, and at most
        order = min(observed_order(cuts), highest) if len(cuts) == 3 else math.nan
        finest = cuts[-1][1]
        if not order >= lowest:
            changes = [largest_so_far(distances(b, a)) for (_, a), (_, b) in itertools.pairwise(cuts)]
            return Limit(finest, np.maximum.reduce(changes))
        limit = extrapolated(cuts, order)
        errors = largest_so_far(distances(limit.tip, finest)) + (self.strict.tolerance or 0.0)
        return limit._replace(errors=errors)

    def known_until(self, part: float) -> float:
        """Time [s] up to which the two finest cuts differ by less than this part of the tip's travel."""
        t, cuts = self.run.t, list(self.cuts.values())[-2:]
        if len(cuts) < 2:
            return float(t[0])
        apart = distances(cuts[1].tip, cuts[0].tip) > part * self.study.travel
        return float(t[apart.argmax()] if apart.any() else t[-1])

    def error(self, tip: Array) -> float:
        """How far a tip's path is from the limit at most [m]; nan where that is not known."""
        return largest_distance(tip, self.limit.tip) if self.limit is not None and self.is_known else math.nan

    @property
    def is_known(self) -> bool:
        """Whether the limit is known well enough to measure errors by it."""
        return self.limit is not None and self.limit.error <= ENOUGH * self.study.travel

    @property
    def factors(self) -> tuple[float, float]:
        """Of the scene's steps, or of its tolerance: coarser, finer."""
        return (10.0, 0.1) if self.scene.run.controlled else (2.0, 0.5)

    @cached_property
    def of_steps(self) -> float:
        """Error of the scene's own steps [m], by the run with finer ones; nan if that one does not end."""
        finer = self.factors[1]
        outcome = self.runner.run(self.model, self.stepping(finer))
        if not outcome.completed:
            return math.nan
        order = 1 if self.scene.run.controlled else method(self.scene.run.method).order
        return largest_distance(outcome.tip, self.run.tip) / (1 - finer**order)

    def stepping(self, factor: float) -> Stepping:
        """The scene's steps, or tolerance, times a factor."""
        run = self.scene.run
        if not run.controlled:
            return Stepping(run.method, step=factor * run.fixed_step)
        size = float(self.study.bent_by.max()) if run.accuracy == "deflection" else self.study.size
        return Stepping(run.method, tolerance=factor * run.tolerance_within(size))

    @cached_property
    def scale(self) -> float:
        """CPU time of evaluations on this machine over that in the list of `motion.evaluation_cost`."""
        return machine_factor(problem_of(self.scene, self.chain))

    @cached_property
    def own(self) -> Choice:
        """The scene as it is."""
        steps = self.run.steps
        seconds = self.scale * run_cost(self.chain, steps.method, steps.evaluations) if steps else math.nan
        outcome = Outcome(self.run.tip, seconds, self.run, self.stepping(1.0))
        return Choice("this scene", self.chain.n, self._said(outcome), outcome, self.error(self.run.tip), seconds)

    def choices(self) -> list[Choice]:
        """The scene's own run first, then those beside it."""
        controlled = self.scene.run.controlled
        what = "tolerance" if controlled else "step"
        found = [self.own]
        found += [self._choice(f"{_times(k)} the {what}", self.model, self.stepping(k)) for k in self.factors]
        if self.says_state or not any(self.model):
            return found
        if not controlled:
            found.append(self._choice("adaptive steps", self.model, self.strict))
        others = [(self.times_the_hinges(factor, _times(factor)), self.cut(factor)) for factor in FACTORS]
        others += [(f"{', '.join(flex)} bending only", self.limited_axes(flex)) for flex in FLEX[1:-1]]
        others.append(("rigid links", (None,) * len(self.model)))
        for label, model in others:
            if model != self.model and can_move(self.scene, model):
                found.append(self._choice(label, model, self.strict))
        return found

    def limited_axes(self, top: str) -> Model:
        """The scene's cut with no link bending about more axes than these."""
        axes = limited_axes([bend.flex if bend else FLEX[0] for bend in self.model], top)
        return tuple(bend and bend._replace(flex=flex) for bend, flex in zip(self.model, axes, strict=True))

    def _choice(self, label: str, model: Model, stepping: Stepping) -> Choice:
        outcome = self.runner.run(model, stepping)
        n = outcome.run.chain.n if outcome.run is not None else 0
        error = self.error(outcome.tip) if outcome.completed else math.nan
        return Choice(label, n, self._said(outcome), outcome, error, self.scale * outcome.seconds)

    def _said(self, outcome: Outcome) -> str:
        if outcome.stepping.step is not None:
            return f"{outcome.stepping.method}, {outcome.stepping.step:g} s"
        steps = outcome.run.steps if outcome.run is not None else None
        return f"{steps.method}, {steps.taken} steps" if steps is not None else "by a tolerance"


def scaled(bend: Bend, factor: float) -> Bend:
    """A link with so many times the hinges; where these are fewer, the nearest number that its rule takes."""
    wanted = round(factor * bend.hinges)
    if factor < 1:
        nearest = sorted(range(bend.hinges, 0, -1), key=lambda count: abs(count - wanted))
        wanted = next(filter(lumping_rule(bend.rule).takes, nearest))
    return bend._replace(hinges=wanted)


def _times(factor: float) -> str:
    return {0.1: "a tenth of", 0.5: "half", 2.0: "twice"}.get(factor, f"{factor:g} times")
