"""advise(scene, tip=…): the smallest model that keeps the tip within a tolerance, checked by finer ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexlink.advice import horizon as horizons
from flexlink.advice import rigid
from flexlink.advice.axes import Screening
from flexlink.advice.goal import OF_STEPS, Goal, Ruler, goal_of, least_tolerance
from flexlink.advice.ladder import RefinementStudy
from flexlink.advice.link_errors import Parts
from flexlink.advice.model import Model, judged, most_axes, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.search import Search
from flexlink.advice.verdict import Advice, length, line, time
from flexlink.chain.arguments import flag, given, positive
from flexlink.common.errors import AdviceError
from flexlink.describe.scene import Scene
from flexlink.results.convergence import Limit
from flexlink.results.deflection import deflections
from flexlink.results.tip_motion import tip_travel

Array = NDArray[np.float64]

CLEAR = 0.5
"""Part of the tolerance below which the guess of a rigid model's error settles it without another run."""

OF_THE_STEPS = 0.1
"""Part of the tolerance that the steps of runs to compare with may do to the tip."""

STRICTER = 0.1
"""Tolerance of a second run, over that of the first, by which the errors of its steps are told: where the motion
multiplies them, they are many times what the steps were allowed."""

ROOM = 8.0
"""Times what a run of the coarsest chain costs that the budget must have room for: without levels no limit is known."""

PASSES = 8
"""Of the search for steps that are small enough."""

AGAIN = 1.5
"""Times too loose that the steps of the first flexible run may be before it is run again."""


def advise(
    scene: Scene, tip: float | str = 1e-3, *, deflection: bool = False, band: float | None = None, budget: float = 1.0
) -> Advice:
    """The cheapest model of a scene whose tip is never farther from where the arm's is than allowed.

    Decided are which links bend, about which axes, where their hinges are and how many, and the steps of the run, for
    this very motion. What the model is measured by is the limit of finer and finer ones of the same beams; all links
    with a section may bend. All else of the scene stays as it is: joints, gears, loads, friction, drive, samples.

    Parameters
    ----------
    scene
        Arm and situation; its flex, segments, lumping, method and step have no effect.
    tip
        Allowed error of the tip at the samples: a part of how far it gets from its start, or a length, as "2 mm".
    deflection
        Whether `tip` is a part of how far the springs, of links and gears, bend the tip away instead.
    band
        Vibrations faster than this do not count [Hz]; None: all that the samples show count.
    budget
        CPU time that one run may take [s], of the model and of those that it is measured by.

    Returns
    -------
    Advice
        Its `scene` is ready to run; `met` says whether the error is within the tolerance.

    Raises
    ------
    ArgumentError
        `scene` is no Scene, or an argument is out of range.
    SceneError
        The scene holds for one model only (`initial.q`, `qd`), has no duration, or no link with a section.
    AdviceError
        No two models of the scene can be run; the message says what became of the last one. Or the tip does not move,
        and `tip` is a part of that.
    InterruptedRunError
        Ctrl-C or SIGTERM; of the advice nothing is there.
    """
    scene = judged(given("scene", scene, Scene))
    goal = goal_of(tip, deflection=flag("deflection", deflection), band=band, run=scene.run)
    return Study(scene, goal, positive("budget", budget)).advice()


class Study:
    """Advice on one scene, on its way."""

    def __init__(self, scene: Scene, goal: Goal, budget: float) -> None:
        self.scene, self.goal = scene, goal
        self.bench, self.ruler = ModelRunner(scene, budget), Ruler(goal, scene.run.sample)
        self.axes, self.lines = most_axes(scene), list[str]()
        self.rigid: Outcome | None = None

    def advice(self) -> Advice:
        """From the cheapest to the dearest, as far as it takes."""
        settled = self._rigid_is_enough()
        if settled is not None:
            return settled
        stepping, tolerance = self._first_flexible_run()
        screening = Screening(self.bench, self.ruler, self.axes, stepping, tolerance)
        self.axes = screening.axes
        self.lines += [line("axes", str(trial)) for trial in screening.trials]
        ladder = RefinementStudy(self.bench, self.ruler, self.goal, self.axes, stepping)
        ladder.climb()
        if ladder.limit is None:
            raise AdviceError(f"{self.scene.name}: no two models can be run: {ladder.why}")
        of_steps = ladder.settle_time()
        known = ladder.limit.errors + of_steps + self.ruler.up_to(screening.gone)
        if known[-1] > ladder.tolerance:
            return self._cannot(ladder, known)
        return self._cheapest(ladder, known)

    def _rigid_is_enough(self) -> Advice | None:
        if self.goal.deflection:
            return None
        self.rigid = rigid.rigid_run(self.bench, self.goal, self._reach())
        if self.rigid is None or self.rigid.run is None:
            return None
        self.bench.pass_along(self.rigid.run)
        motion, strict = tip_travel(self.rigid.tip), self.rigid
        tolerance = self.goal.tolerance(motion, 0.0)
        guess = rigid.guess(self.bench, strict, self.axes, self.ruler)
        swings = f"(swinging at {guess.hertz:.3g} Hz)" if np.isfinite(guess.hertz) else ""
        self.lines = [line("rigid", f"would be off by at most about {length(guess.error)} {swings}")]
        if guess.error >= CLEAR * tolerance:
            return None
        error = guess.error * max(1.0, rigid.growth(self.bench, strict, guess.error) / rigid.TAME)
        if error >= CLEAR * tolerance:
            return None

        def total(tip: Array) -> float:
            return error + self.ruler(tip - strict.tip) + (strict.stepping.tolerance or 0.0)

        outcome = rigid.loosest(self.bench, strict, tolerance, total)
        return self._done(rigid.rigid_model(self.bench), outcome, total(outcome.tip), tolerance, motion, None)

    def _reach(self) -> float:
        return self.bench.chain(uniform(self.axes, rigid.COARSE)).reach

    def _first_flexible_run(self) -> tuple[Stepping, float]:
        """Steps of the levels, whose errors on the coarsest chain are small beside the tolerance; and this [m]."""
        model = uniform(self.axes, rigid.COARSE)
        motion = tip_travel(self.rigid.tip) if self.rigid else rigid.FIRST_GUESS * self._reach()
        tolerance = self.goal.tolerance(motion, motion) or self.goal.size * self._reach()
        least, share = least_tolerance(self._reach()), OF_STEPS
        stepping, told = Stepping("auto", tolerance=share * tolerance), tolerance
        for _ in range(PASSES):
            stepping = Stepping("auto", tolerance=max(share * tolerance, least))
            outcome = self.bench.run(model, stepping)
            if outcome.run is None or not outcome.whole:
                return stepping, tolerance
            self.bench.pass_along(outcome.run)
            motion, bent = tip_travel(outcome.tip), float(deflections(outcome.run).max())
            told = self.goal.tolerance(motion, bent)
            if told < least:
                raise self._still(bent if self.goal.deflection else motion, least)
            if stepping.tolerance == least:
                return stepping, told
            if told >= tolerance / AGAIN:
                strict = Stepping("auto", tolerance=max(share * STRICTER * tolerance, least))
                stricter = self.bench.run(model, strict)
                small = self.ruler(stricter.tip - outcome.tip) <= OF_THE_STEPS * told
                if small or stricter.dear or ROOM * stricter.seconds > self.bench.budget:
                    return stepping, told
                share *= STRICTER
            tolerance = told
        return stepping, told

    def _still(self, size: float, least: float) -> AdviceError:
        """Of a part of next to nothing [m]."""
        what = "springs do not move the tip" if self.goal.deflection else "the tip does not move"
        return AdviceError(
            f"{self.scene.name}: {what}, but for {size:.2g} m, and {self.goal} of that is less than the {least:.2g} m "
            "that rounding leaves uncertain; give the error as a length, as tip = '1 mm'"
        )

    def _cheapest(self, ladder: RefinementStudy, known: Array) -> Advice:
        assert ladder.limit is not None
        known_to = float(known[-1])
        tolerance, limit = ladder.tolerance, ladder.limit._replace(errors=known)

        def total(tip: Array) -> float:
            return self.ruler(tip - limit.tip) + known_to

        if self.rigid is not None and total(self.rigid.tip) <= tolerance:
            outcome = rigid.loosest(self.bench, self.rigid, tolerance, total)
            model = rigid.rigid_model(self.bench)
            return self._done(model, outcome, total(outcome.tip), tolerance, ladder.motion, limit)
        parts = Parts(self.bench, self.ruler, ladder, ladder.stepping)
        search = Search(self.bench, parts, tolerance, known_to)
        found = search.best()
        if found is None:
            for level, outcome in ladder.known().items():
                search.accept(level, outcome)
            found = search.found
        if found is None:
            return self._cannot(ladder, known)
        return self._done(found.model, found.outcome, found.error + known_to, tolerance, ladder.motion, limit)

    def _cannot(self, ladder: RefinementStudy, known: Array) -> Advice:
        """The finest level, with what it is worth; the limit is known so well up to each sample (samples,) [m]."""
        assert ladder.limit is not None
        known_to = float(known[-1])
        finest, tolerance = ladder.finest.outcome, ladder.tolerance
        error = self.ruler(finest.tip - ladder.limit.tip) + known_to
        holds = horizons.horizon(ladder, self.ruler, known)
        growth = horizons.growth(self.bench, ladder, tolerance)
        why = f" ({ladder.why})" if ladder.why else ""
        said = f"{self.goal} is not met: with {ladder.finest.hinges} hinges a link the error is {length(error)}{why}"
        lines = [line("cannot", said)]
        if known_to <= tolerance:
            lines.append(line("limit", f"extrapolated, the tip's path is known to {length(known_to)}: no one model is"))
        if growth.factor > horizons.SENSITIVE:
            fold = f"; e-fold {growth.e_fold:.3g} s" if np.isfinite(growth.e_fold) else ""
            lines.append(line("sensitive", f"an initial error grows {growth.factor:.2g} times{fold}"))
        lines.append(line("horizon", f"the tolerance holds up to t = {holds:.6g} s"))
        limit = ladder.limit._replace(errors=known)
        return self._said(ladder.model, finest, error, tolerance, ladder.motion, limit, holds, lines)

    def _done(
        self, model: Model, outcome: Outcome, error: float, tolerance: float, motion: float, limit: Limit | None
    ) -> Advice:
        end = self.scene.initial.time + self.scene.run.duration
        lines = self._choices(model, outcome)
        return self._said(model, outcome, error, tolerance, motion, limit, end, lines)

    def _said(
        self, model: Model, outcome: Outcome, error: float, tolerance: float, motion: float, limit: Limit | None,
        holds: float, lines: list[str],
    ) -> Advice:  # fmt: skip
        part = "" if self.goal.metres else f"{self.goal} of {'the deflection' if self.goal.deflection else 'it'} = "
        first = line("motion", f"tip travels {length(motion)}; tolerance {part}{length(tolerance)}")
        own = f", reference's own {length(limit.error)} included" if limit else ", at most"
        took = f"advice took {self.bench.count} runs, {time(self.bench.seconds)}"
        last = line("error", f"{length(error)}{own}; cost {time(outcome.seconds)}; {took}")
        met = error <= tolerance
        return Advice(
            met, self.bench.scene_of(model, outcome.stepping), error, tolerance, motion, outcome.seconds, limit, holds,
            self.bench.count, self.bench.seconds, (first, *self.lines, *lines, last),
        )  # fmt: skip

    def _choices(self, model: Model, outcome: Outcome) -> list[str]:
        links = zip(self.scene.arm.links, model, strict=True)
        lines = [line("link", f"{link.name}: {bend or 'rigid'}") for link, bend in links]
        chain = self.bench.chain(model)
        lines.append(line("moves in", f"{'a plane' if chain.is_planar else 'space'}, {chain.n} degrees of freedom"))
        return [*lines, line("step", self._steps(model, outcome))]

    def _steps(self, model: Model, outcome: Outcome) -> str:
        stepping = outcome.stepping
        if stepping.step is None:
            taken = outcome.run.steps if outcome.run else ""
            return f"tolerance {length(stepping.tolerance or 0.0)}: {taken}"
        if not any(model):
            return f"{stepping}, {round(self.scene.run.sample / stepping.step)} to a sample"
        share = stepping.step / self.bench.stable(model)
        return f"{stepping}, {share:.2f} of the stable step (smallest over {len(self.bench.along)} postures)"
