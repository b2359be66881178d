"""advise(scene, tip=…): find the cheapest model whose tip error is within a tolerance, checked by finer models."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from time import thread_time
from typing import Literal, get_args

import numpy as np

from flexlink.advice import rigid
from flexlink.advice.goal import Goal, Thresholds, TipErrorNorm, goal_of, least_tolerance
from flexlink.advice.model import Model, all_axes, checked_scene, gauges_lost, uniform
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.advice.refinement import AxisScreening, RefinementStudy, error_growth, horizon
from flexlink.advice.search import LinkErrors, Search, ShapeSearch
from flexlink.advice.verdict import Advice, length, line, payback, time
from flexlink.chain.arguments import positive, require_bool, require_one_of, require_type
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError, FlexlinkError
from flexlink.common.types import Array
from flexlink.common.wording import plural, short_list
from flexlink.describe.run_settings import AUTO
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.notes import is_free_fall
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.simulate import simulate
from flexlink.results.convergence import Limit
from flexlink.results.stop_reasons import EvaluationLimitError
from flexlink.results.tip_motion import tip_travel
from flexlink.results.trajectory import deflections


def advise(
    scene: Scene, tip: float | str = 1e-3, *, deflection: bool = False, band: float | None = None, budget: float = 1.0,
    measure: Measure = "simulation",
) -> Advice:  # fmt: skip
    """Find the cheapest model of a scene with an allowed error at the tip.

    For the motion of this scene, the function chooses the links that bend, their axes, the positions and the number of
    their hinges, and the time steps. Errors are relative to the limit of finer and finer models of the same beams; all
    links with a section may bend. Everything else is unchanged: joints, gears, loads, friction, drive, samples.

    Parameters
    ----------
    scene
        The scene; its flex, segments, modes, lumping, method and step have no effect.
    tip
        Allowed error of the tip at the samples, as a fraction of its travel, or as a length, such as "2 mm".
    deflection
        Whether `tip` is a fraction of the largest deflection of the tip by the springs of links and gears.
    band
        Vibrations above this frequency are ignored [Hz]; None: all vibrations that the samples resolve are included.
    budget
        Largest CPU time of the steps of any one run [s], including runs of finer models; computed from listed costs.
    measure
        What the model should have least of: "simulation", CPU time of the run; "control", coordinates, for controllers,
        observers and stored models; "explicit", CPU time of explicit steps of RK4, as in real time. For the latter two,
        links may move by strain modes.

    Returns
    -------
    Advice
        Result; its `scene` is ready to run, and `met` is True if the error is within the tolerance.

    Raises
    ------
    ArgumentError
        `scene` is not a Scene, or an argument is out of range; fewer than two models of the scene can be run (the
        message gives the reason of the last failure); or `tip` is a fraction, and the travel or deflection of the tip
        is zero.
    SceneError
        The scene fits only one model (it sets `initial.q` or `qd`), has no duration, or has no link with a section.
    InterruptedRunError
        Ctrl-C or SIGTERM.

    Examples
    --------
    >>> found = fl.advise(scene, tip="5 mm")
    >>> print(found.met, found.error < 5e-3, fl.lump(found.scene).n < 10)
    True True True
    >>> small = fl.simulate(found.scene)
    """
    scene = checked_scene(require_type("scene", scene, Scene))
    goal = goal_of(tip, deflection=require_bool("deflection", deflection), band=band, run=scene.run)
    require_one_of("measure", measure, dict.fromkeys(get_args(Measure)))
    return Advisor(scene, goal, positive("budget", budget), measure).advice()


Measure = Literal["simulation", "explicit", "control"]  # what advice minimises


class Advisor:
    """Search for the cheapest model of one scene, and for the reasons."""

    def __init__(self, scene: Scene, goal: Goal, budget: float, measure: Measure = "simulation") -> None:
        self.scene, self.goal, self.measure, self._started = scene, goal, measure, thread_time()
        self.runner, self.norm = ModelRunner(scene, budget), TipErrorNorm(goal, scene.run.spacing)
        self.axes, self.lines = all_axes(scene), list[str]()
        self.size = self.runner.chain(uniform(self.axes, Thresholds.hinges)).size
        self.rigid: Outcome | None = None

    def advice(self) -> Advice:
        """Advise rigid links if they are accurate enough; otherwise find the limit of finer models, then search."""
        if (settled := self._rigid_is_enough()) is not None:
            return settled
        stepping, tolerance = self._first_flexible_run()
        screening = AxisScreening(self.runner, self.norm, self.axes, stepping, tolerance)
        self.axes = screening.axes
        self.lines += [line("axes", trial) for trial in screening.trials]
        refinement = RefinementStudy(self.runner, self.norm, self.goal, self.axes, stepping)
        refinement.refine()
        if refinement.limit is None:
            why = f"{self.scene.name}: fewer than two models could be run: {refinement.reason}"
            raise ArgumentError(why, id="too-few-models")
        known = refinement.limit.errors + refinement.remove_step_errors() + self.norm.up_to(screening.left_out)
        if known[-1] >= refinement.tolerance:
            return self._cannot(refinement, known)
        return self._cheapest(refinement, known)

    def _rigid_is_enough(self) -> Advice | None:
        if self.goal.deflection or self.scene.ties:  # ties load rigid links in ways that the estimate does not contain
            return None
        self.rigid = rigid.rigid_run(self.runner, self.goal, self.size)
        if self.rigid is None or self.rigid.run is None:
            return None
        self.runner.sample_postures(self.rigid.run)
        travel, strict = tip_travel(self.rigid.tip), self.rigid
        tolerance = self.goal.tolerance(travel, 0.0)
        error, hertz = rigid.estimate(self.runner, strict, self.axes, self.norm)
        size = f"estimated error at most {length(error)}" if np.isfinite(error) else "error too large to estimate"
        vibration = f" (first mode {hertz:.3g} Hz)" if np.isfinite(hertz) else ""
        self.lines = [line("rigid", f"{size}{vibration}")]
        clearly_rigid = 0.5 * tolerance  # an estimate below this is sufficient
        if error < clearly_rigid:
            error *= max(1.0, rigid.growth(self.runner, strict, error) / Thresholds.modest_growth)
        if error >= clearly_rigid:
            return None

        def total(tip: Array) -> float:
            return error + self.norm(tip - strict.tip) + (strict.stepping.tolerance or 0.0)

        outcome = rigid.cheapest_run(self.runner, strict, tolerance, total)
        return self._done(rigid.rigid_model(self.runner), outcome, total(outcome.tip), tolerance, travel, None)

    def _first_flexible_run(self) -> tuple[Stepping, float]:
        """Return time steps whose errors on the coarsest chain are far below the tolerance, and this tolerance [m]."""
        model = uniform(self.axes, Thresholds.hinges)
        travel = tip_travel(self.rigid.tip) if self.rigid else Thresholds.first_guess * self.size
        tolerance = self.goal.tolerance(travel, travel) or self.goal.size * self.size
        least, share = least_tolerance(self.size), Thresholds.reference_step_share
        # stricter steps measure the step errors, which are many times the steps' tolerance in sensitive motion
        strictness, passes = 0.1, 8
        stepping, known_tolerance = Stepping("auto", tolerance=share * tolerance), tolerance
        for _ in range(passes):
            stepping = Stepping("auto", tolerance=max(share * tolerance, least))
            outcome = self.runner.run(model, stepping)
            if outcome.run is None or not outcome.completed:
                return stepping, tolerance
            self.runner.sample_postures(outcome.run)
            travel, bent = tip_travel(outcome.tip), float(deflections(outcome.run).max())
            known_tolerance = self.goal.tolerance(travel, bent)
            if self.scene.ties and travel < 1e-9 * self.size:
                why = "ties hold the tip, whose motion shows the errors of models; advise on an arm whose tip moves"
                raise ArgumentError(f"{self.scene.name}: {why}", id="tip-held")
            if known_tolerance < least:
                what, size = ("springs deflect the tip", bent) if self.goal.deflection else ("the tip moves", travel)
                why = f"{what} by only {size:.2g} m, and {self.goal} of that is below the rounding error, {least:.2g} m"
                remedy = "specify the error as a length, such as tip = '1 mm'"
                raise ArgumentError(f"{self.scene.name}: {why}; {remedy}", id="no-motion")
            if stepping.tolerance == least:
                return stepping, known_tolerance
            if known_tolerance >= tolerance / Thresholds.rerun_factor:
                strict = Stepping("auto", tolerance=max(share * strictness * tolerance, least))
                stricter = self.runner.run(model, strict)
                small = self.norm(stricter.tip - outcome.tip) <= 0.1 * known_tolerance
                leaves_levels = 8 * stricter.seconds <= self.runner.budget  # the budget must suffice for finer levels
                if small or stricter.over_budget or not leaves_levels:
                    return stepping, known_tolerance
                share *= strictness
            tolerance = known_tolerance
        return stepping, known_tolerance

    def _cheapest(self, refinement: RefinementStudy, known: Array) -> Advice:
        assert refinement.limit is not None
        known_to, tolerance, limit = float(known[-1]), refinement.tolerance, refinement.limit._replace(errors=known)

        def total(tip: Array) -> float:
            return self.norm(tip - limit.tip) + known_to

        if self.rigid is not None and total(self.rigid.tip) <= tolerance:
            outcome = rigid.cheapest_run(self.runner, self.rigid, tolerance, total)
            model, travel = rigid.rigid_model(self.runner), refinement.travel
            return self._done(model, outcome, total(outcome.tip), tolerance, travel, limit)
        link_errors = LinkErrors(self.runner, self.norm, refinement)
        search = Search(self.runner, link_errors, tolerance - known_to)
        if (best := search.best()) is None:
            for level, outcome in refinement.models().items():
                search.accept(level, outcome)
            best = search.solution
        if self.measure != "simulation":
            shapes = ShapeSearch(self.runner, link_errors, tolerance - known_to, explicit=self.measure == "explicit")
            best = shapes.best(best)
            self.lines += [line("tried", text) for text in shapes.lines]
        if best is None:
            return self._cannot(refinement, known)
        return self._done(best.model, best.outcome, best.error + known_to, tolerance, refinement.travel, limit)

    def _cannot(self, refinement: RefinementStudy, known: Array) -> Advice:
        """Advice with the finest level, which misses the goal; `known` is the limit's error up to each sample [m]."""
        assert refinement.limit is not None
        known_to = float(known[-1])
        finest, tolerance = refinement.finest.outcome, refinement.tolerance
        error = self.norm(finest.tip - refinement.limit.tip) + known_to
        holds = horizon(refinement, self.norm, known)
        growth, e_fold = error_growth(self.runner, refinement, tolerance)
        why = f" ({refinement.reason})" if refinement.reason else ""
        hinges = refinement.finest.hinges
        lines = [line("cannot", f"error {length(error)} with {hinges} hinges per link: {self.goal} is not met{why}")]
        if known_to <= tolerance:
            path = f"the extrapolated path of the tip is known within {length(known_to)}; see converged_tip"
            lines.append(line("limit", path))
        if growth > Thresholds.sensitive_growth:
            fold = f" (by e every {e_fold:.3g} s)" if np.isfinite(e_fold) else ""
            lines.append(line("sensitive", f"initial errors grow by a factor of {growth:.2g}{fold}"))
        lines.append(line("horizon", f"the tolerance is met up to t = {holds:.6g} s"))
        limit = refinement.limit._replace(errors=known)
        return self._result(refinement.model, finest, error, tolerance, refinement.travel, limit, holds, lines)

    def _done(
        self, model: Model, outcome: Outcome, error: float, tolerance: float, travel: float, limit: Limit | None
    ) -> Advice:
        links = zip(self.scene.arm.links, model, strict=True)
        lines = [line("link", f"{link.name}: {bend or 'rigid'}") for link, bend in links]
        chain = self.runner.chain(model)
        lost = short_list([one.name for one in gauges_lost(self.scene, model)])
        lines += [line("sensor", f"{lost}: left out, as its link is rigid; for strain, let it bend")] if lost else []
        moves = "a plane" if chain.is_planar else "space"
        lines.append(line("moves in", f"{moves}, {chain.freedoms} degrees of freedom"))
        lines.append(line("step", self._steps(model, outcome)))
        end = self.scene.initial.time + self.scene.run.duration
        return self._result(model, outcome, error, tolerance, travel, limit, end, lines)

    def _result(
        self, model: Model, outcome: Outcome, error: float, tolerance: float, travel: float, limit: Limit | None,
        holds: float, lines: list[str],
    ) -> Advice:  # fmt: skip
        free_fall = "none: this is a free fall; give the scene its drive, or lock its joints, for advice on its task"
        part = "" if self.goal.metres else f"{self.goal} of {'the deflection' if self.goal.deflection else 'it'} = "
        first = line("motion", f"tip travels {length(travel)}; tolerance {part}{length(tolerance)}")
        own = f", including {length(limit.error)} uncertainty of the reference" if limit else ", at most"
        whole, again = run_time(lambda: self.runner.scene_of(model, outcome.stepping))
        took = thread_time() - self._started
        pays = payback(took, own_time(self.scene, took), again)
        cost = f"CPU time {time(whole)} including set-up, {time(again)} if repeated"
        last = (
            line("error", f"{length(error)}{own}"),
            line("cost", f"{cost}; advice took {plural(self.runner.count, 'run')}, {time(took)}{pays}"),
        )
        falls = [line("drive", free_fall)] if is_free_fall(self.scene) else []
        return Advice(
            error <= tolerance, self.runner.scene_of(model, outcome.stepping), error, tolerance, travel, whole,
            again, limit, holds, self.runner.count, took, (first, *falls, *self.lines, *lines, *last),
        )  # fmt: skip

    def _steps(self, model: Model, outcome: Outcome) -> str:
        stepping = outcome.stepping
        if stepping.step is None:
            taken = outcome.run.steps if outcome.run else ""
            return f"tolerance {length(stepping.tolerance or 0.0)}: {taken}"
        if not any(model):
            return f"{stepping}, {round(self.scene.run.spacing / stepping.step)} steps per sample"
        share = stepping.step / self.runner.stable_step(model)
        return f"{stepping}, {share:.2f} of the stable step (smallest of {len(self.runner.postures)} configurations)"


def run_time(scene_of: Callable[[], Scene], enough: float = 0.05) -> tuple[float, float]:
    """Shortest CPU times [s] of a complete run, and of a prepared run, as with a `Problem`.

    A complete run uses a new scene, so nothing is prepared. After `enough` CPU time [s] runs are not repeated, because
    other programs disturb long runs less; one beyond 5 s is run once, as its set-up takes far less. Choices and their
    reasons depend only on listed costs (`evaluation_cost`), not on these times. Errors are as in `simulate`.
    """
    whole, again = list[float](), list[float]()
    # two to five times: the first run may load or compile code
    while len(whole) < 2 or (len(whole) < 5 and sum(whole[1:] + again) < enough):
        scene = scene_of()
        for times in (whole, again):
            started = thread_time()
            simulate(scene)
            times.append(thread_time() - started)
            if times[-1] > 5.0:
                return times[-1], times[-1]
    return min(whole), min(again)


def own_time(scene: Scene, most: float) -> float:
    """CPU time of a prepared run of the original scene [s]; inf if listed costs exceed `most` [s], nan if it fails."""
    run, chain = scene.run, lump(open_chain(scene))
    name = "Radau5" if run.method == AUTO else run.method
    evaluations = min(run.max_evaluations, max(1.0, most / run_cost(chain, name, 1.0)))
    if not run.controlled and method(name).stages * run.duration / run.fixed_step > evaluations:
        return math.inf
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the user did not request this run
            for _ in range(2):
                started = thread_time()
                simulate(scene, max_evaluations=evaluations)
                taken = thread_time() - started
        return taken
    except EvaluationLimitError:
        return math.inf
    except FlexlinkError:
        return math.nan
