"""Classify a run by its error, measured from a reference on which two methods agree: right, warned, refused or wrong.

The error of a run is compared with its tolerance, or, for fixed steps, with the error above which flexlink calls a run
doubtful. ε is the tip's largest distance from the reference at any sample, in units of that tolerance:

    within          ε ≤ 1                  near            1 < ε ≤ 10, possible in sensitive motion
    warned          ε > 1, and the result has a warning
    false doubt     ε ≤ 1, and the result is called doubtful
    error           a FlexlinkError that names the cause and the remedy
    dear            the run exceeded the budget and was stopped
    unknown         the two references disagree too much
    silent wrong    ε > 10 without a warning: there must be none
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Literal, NamedTuple, get_args

import numpy as np

from flexlink import engines
from flexlink.chain.lumping import lump
from flexlink.common.errors import FlexlinkError
from flexlink.common.interruption import deferred
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.dynamics.placement import tip_position
from flexlink.motion.inputs.problem import problem_of
from flexlink.motion.single_run import SingleRun
from flexlink.motion.tolerable import Thresholds
from flexlink.results.stop_reasons import InterruptedRunError
from flexlink.results.tip_motion import largest_distance, tip_travel
from flexlink.results.trajectory import Trajectory
from validation.trade.with_mujoco import INTEGRATORS

Outcome = Literal["within", "near", "warned", "false doubt", "error", "dear", "unknown", "silent wrong"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)

NEAR_TOLERANCES = 10.0
"""Largest allowed final error in units of the tolerance: the project's limit."""

KNOWN = 0.3
"""Largest distance between the references, in units of the tolerance, at which a run is classified."""

REFERENCES = (
    ("DOP853", 1e-11),
    ("Radau9", 1e-11),
    ("Radau5", 1e-10),
    ("Radau9", 1e-9),
    ("Radau5", 1e-8),
    ("Radau9", 1e-6),
)
"""Methods and tolerances (fractions of the arm's reach) of the references. After DOP853, RK10 runs with fixed steps of
half DOP853's mean step."""


class Truth(NamedTuple):
    """Reference path of the tip, on which two methods agree."""

    tip: Array  # (samples, 3) by the more accurate method [m]; no samples if there is no reference
    apart: float  # distance between the two references [m]; inf unless there are two
    methods: str


class RunOutcome(NamedTuple):
    """One run: its outcome, its error in units of the tolerance, and its messages."""

    outcome: Outcome
    error: float  # nan: unknown
    words: str
    seconds: float


def truth_of(scene: Scene, budget: float) -> Truth:
    """The tip path on which two methods agree best; methods that need more than `budget` [s] are skipped."""
    best, found = Truth(np.empty((0, 3)), np.inf, ""), list[tuple[str, Array]]()
    good = 1e-9 * lump(scene).reach  # good enough to stop
    for method, tip in _references(scene, budget):
        for other, before in found:
            distance = largest_distance(tip, before)
            if other != method and distance < best.apart:
                best = Truth(before, distance, f"{other}, {method}")
        if best.apart <= good:
            break
        found.append((method, tip))
    return best


def _references(scene: Scene, budget: float) -> Iterator[tuple[str, Array]]:
    """Yield tip paths by different methods, strictest first; methods that fail or exceed the budget are skipped."""
    for method, tolerance in REFERENCES:
        changes = {"run.method": method, "run.relative_tolerance": tolerance}
        if (run := _reference(scene.varied(changes), budget)) is None:
            continue
        yield method, run.tip
        if method == "DOP853" and run.steps is not None and scene.run.duration > 0:
            sample = scene.run.spacing
            mean = scene.run.duration / run.steps.taken
            changes = {"run.method": "RK10", "run.step": sample / math.ceil(2 * sample / mean), "run.unstable": "allow"}
            if (run := _reference(scene.varied(changes), budget)) is not None:
                yield "RK10", run.tip


def _reference(scene: Scene, budget: float) -> Trajectory | None:
    try:
        return within_budget(scene, budget, compared=False)  # the references are compared with each other
    except (FlexlinkError, InterruptedRunError):
        return None


def within_budget(scene: Scene, budget: float, *, compared: bool = True) -> Trajectory:
    """Run a scene; raise InterruptedRunError after more than `budget` [s of CPU], not counting compilation.

    `compared`: check the run with a second run if its kind of steps requires this, as in users' runs.
    """
    started: list[float] = []

    def look(_: float) -> None:
        started.append(time.thread_time())
        if started[-1] - started[0] > budget:
            raise KeyboardInterrupt

    with deferred() as stop:
        return SingleRun(problem_of(scene)).finish(stop, look, compared=compared)


def outcome_of(scene: Scene, truth: Callable[[], Truth], budget: float) -> RunOutcome:
    """Run a scene and classify it; the reference is computed only if there is a result."""
    started = time.thread_time()
    try:
        run = within_budget(scene, budget)
    except InterruptedRunError as stopped:
        return RunOutcome("dear", np.nan, str(stopped), time.thread_time() - started)
    except FlexlinkError as refused:
        return RunOutcome("error", np.nan, str(refused), time.thread_time() - started)
    seconds = time.thread_time() - started
    words = "; ".join(run.warnings) or str(run.steps)
    return judged(scene, run.tip, truth(), words, seconds)


def outcome_beside(scene: Scene, name: str, method: str, truth: Callable[[], Truth]) -> RunOutcome:
    """Run a scene with fixed steps in an engine, which rejects no step and checks no result."""
    run, started = scene.run, time.thread_time()
    if run.duration / run.fixed_step > 20_000:  # an engine's run cannot be interrupted
        return RunOutcome("dear", np.nan, f"{round(run.duration / run.fixed_step)} steps", 0.0)
    try:
        chain = lump(scene)
        engine = engines.load(name, chain)
        if name == "mujoco":
            engine.model.opt.integrator = INTEGRATORS[method]  # type: ignore[attr-defined]
        _, q, _ = engine.integrate(scene.varied({"run.unstable": "allow"}))
        tip = np.array([tip_position(chain, row) for row in q])
    except FlexlinkError as error:
        return RunOutcome("error", math.nan, str(error), time.thread_time() - started)
    return judged(scene, tip, truth(), "", time.thread_time() - started)


def judged(scene: Scene, tip: Array, known: Truth, words: str, seconds: float) -> RunOutcome:
    """Determine the outcome of a run from its tip path, (samples, 3), and its messages."""
    if not known.tip.size:
        return RunOutcome("unknown", np.nan, words, seconds)
    tolerance = allowed(scene, known)
    error = largest_distance(tip, known.tip)
    doubted = "doubtful" in words  # other warnings concern the model, not the accuracy of the run
    return RunOutcome(_judged(error, known.apart, tolerance, doubted), error / tolerance, words, seconds)


def allowed(scene: Scene, truth: Truth) -> float:
    """The tolerance of a run [m]; with fixed steps, the tip error above which a run is doubtful."""
    if scene.run.controlled:
        return scene.run.tolerance_within(lump(scene).reach)
    return max(Thresholds.doubt * Thresholds.tip_share * tip_travel(truth.tip), 1e-12)


def _judged(error: float, apart: float, tolerance: float, doubted: bool) -> Outcome:
    """Classify an error; if the reference is uncertain, the run gets the benefit of the doubt."""
    if not error <= NEAR_TOLERANCES * tolerance + apart and not doubted:
        return "silent wrong"
    if apart > KNOWN * tolerance:
        return "unknown"
    if error <= tolerance:
        return "false doubt" if doubted else "within"
    return "warned" if doubted else "near"
