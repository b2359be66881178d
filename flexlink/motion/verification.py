"""Verification by a second run, which reveals errors that the motion amplifies; a run's own checks cannot show them.

A run with fixed steps of an implicit method is compared with a run of twice the step, at about half the cost. If the
two differ, or a step of the second run had to be divided, another run with a tolerance follows.

The errors of fixed explicit steps are measured; in most motions they only add up. They grow where joints make full
turns, or where the loop of a sampled drive is unstable. Such steps may be far more accurate than necessary; they are
compared with runs of smaller and smaller tolerance, until a run agrees, is strict enough to prove them wrong, or has
taken more evaluations than the run with fixed steps.

A tolerance bounds the errors of adaptive steps. Where these may hide errors, a run is compared with a coarser one; if
that shows too large an error, or the motion amplifies errors, with runs by a method of another order. One of these
replaces it if it misses its tolerance.
"""

import math
from collections.abc import Generator, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.common.errors import Diagnostic
from flexlink.common.memo import keep_last
from flexlink.common.types import Array
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import build_validated
from flexlink.kernels.inputs.laws import COMPUTED_TORQUE, TABLE
from flexlink.motion.hindrance import loop_grows
from flexlink.motion.inputs.actuation import corners
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import apart, motion_in_words

STRICTER = 0.1
"""Tolerance of the second run, relative to the first run's tolerance, or to the error at which a run is doubtful."""
PART = STRICTER**0.5
"""Largest tolerance of a run of another order, relative to the compared run: equal ones may be wrong alike (by 36, 39
tolerances), because both damp vibrations, or end steps where motors reach their limits."""
GIVEN_UP = 50
"""Largest number of evaluations of a verification run, relative to the run itself; useful ones need far fewer."""
Finer = Generator[RunSettings, float | None, None]


class Second(NamedTuple):
    """A verification run, and how it is compared."""

    run: RunSettings
    every: int  # number of samples of the first run per compared sample
    larger: float  # ratio of the distance between the two runs to the error of the first
    strict: bool = True  # whether this run is so accurate that a difference proves the first run wrong


def second_runs(monitor: Monitor) -> Iterator[Second]:
    """Yield runs to compare with one with fixed steps, to the first strict one; none if a law in Python drives it."""
    # Distance to a run with twice the step, relative to the error of the first run, for a method of order two. Steps
    # that hardly resolve the motion do not converge with the order of their method, and two such runs may be equally
    # wrong.
    error_ratio = 2**2 - 1.0
    run = monitor.run
    if monitor.control is not None:
        return
    if monitor.explicit:
        if multiplies(monitor) and monitor.tip_error <= _tolerance(monitor):
            yield from _stricter_and_stricter(monitor)
    elif monitor.extent > 0:
        if pairs := (run.samples - 1) // 2:
            sample = 2 * run.spacing
            coarser = replace(run, step=2 * run.fixed_step, sample=sample, duration=pairs * sample)
            yield Second(coarser, 2, error_ratio, strict=False)
        yield Second(_within(run, STRICTER * _tolerance(monitor)), 1, 1.0)


def needs_comparison(monitor: Monitor) -> bool:
    """Whether the errors of the steps, which a run with a tolerance states, may not show its error."""
    stated = monitor.stated
    if stated is None or monitor.n_valid < 2:
        return False
    after = monitor.before is not None and monitor.before.end is not None
    estimated = max(2.0 * Thresholds.lasting * stated.drifted, stated.tip.item(-1)) > Thresholds.large * stated.allowed
    read = monitor.run.accuracy == "auto" and monitor.record.follows_vibrations
    return bool(after or estimated or read or monitor.suspicious or _switches(monitor) or multiplies(monitor))


def _switches(monitor: Monitor) -> bool:
    """Whether torques jump often, ties have springs, or a rigid model controls springs: errors then add up.

    Torques jump where a table changes, motors reach limits, and steps are rejected, which may deceive error estimates.
    Of 280 runs with motors at limits that do not turn far, those with errors above three tolerances rejected 0.15 of
    their steps or more. A motor at its limit holds nothing, as of an upright pendulum.
    """
    record, drive, steps = monitor.record, monitor.record.inputs.drive, monitor.steps
    if record.problem.ties is not None and np.isfinite(record.problem.ties[0]["stiffness"]).any():
        return True
    jumps, taken = (len(corners(drive)) if drive.law == TABLE else 0) + steps.rejected, steps.taken
    if drive.law == COMPUTED_TORQUE and not drive.rate and (record.chain.stiffness > 0.0).any():
        return True
    share = 0.0 if (limited := monitor.at_limit) is None else float(limited.any(axis=1).mean())
    return share > 0.5 or jumps > 0.3 * taken or (share > 0.0 and jumps > 0.1 * taken)


def coarser_run(monitor: Monitor) -> RunSettings | None:
    """Settings of a run of ten times the tolerance, whose distance shows the error; None if both may be wrong alike.

    They may if the run continues another one, if stability, sampling or a table limits the steps, or if vibrations last
    that the method damps: a falling arm had 4 to 6 mm with any tolerance from 10 to 1 mm.
    """
    run, record, drive = monitor.run, monitor.record, monitor.record.inputs.drive
    steps_alike = monitor.before is not None or method(monitor.steps.method).explicit or drive.rate
    steps_alike = steps_alike or len(corners(drive)) > 0.5 * monitor.steps.taken
    lasts = monitor.stated is None or monitor.stated.tip[-1] > monitor.tolerance
    if steps_alike or lasts or record.follows_vibrations or monitor.suspicious or multiplies(monitor):
        return None
    return _with(run, monitor.steps.method, Thresholds.coarser * run.tolerance_within(1.0))


@keep_last(64)
def _with(run: RunSettings, name: str, tolerance: float) -> RunSettings:
    """Settings of a run with another method and tolerance, of the kind that is given."""
    given = {"relative_tolerance" if run.tolerance is None else "tolerance": tolerance}
    settings: RunSettings = build_validated(replace, run, method=name, sample=run.spacing, **given)
    return settings


def runs_of_other_order(run: RunSettings, name: str, size: float, least: float = 0.0, part: float = PART) -> Finer:
    """Settings of runs with which to compare a run by method `name`, finer and finer; send each its distance.

    A method of another order shows errors that the run's own smaller steps share; where steps are limited by stability,
    a smaller tolerance and halved steps do. `size` and `least` are the arm's size and the smallest tolerance that
    rounding errors allow [m]; distances are in tolerances. `part`: largest part of the tolerance to begin with.
    """
    same = method(name).explicit or name == Thresholds.finer
    other, part = (name, min(part, STRICTER)) if same else (Thresholds.finer, part)
    size = size if run.tolerance is None else 1.0
    before, least = math.inf, 0.0 if run.accuracy == "deflection" else least / size
    for _ in range(Thresholds.runs):
        tolerance = max(least, part * run.tolerance_within(1.0))
        if not tolerance < before:
            return
        before = tolerance
        distance = yield _with(run, other, tolerance)
        part *= min(STRICTER, STRICTER**0.5 / distance) if distance else STRICTER


def evaluations_within(first: Monitor) -> float:
    """Number of evaluations after which a verification run of the first run is given up."""
    fewest = 2000  # of a run that is given up: a short part of a motion, or one without vibrations, takes very few
    return GIVEN_UP * max(fewest, first.steps.evaluations)


def too_dear(runs: Sequence[Monitor], run: RunSettings) -> bool:
    """Whether the next of these runs would be given up, as the evaluations of the last one let expect."""
    dearer = 1.5  # evaluations for a tenth of the tolerance; of 280 runs that ended it leaves out one, of 44 others 27
    decades = math.log10(runs[-1].run.tolerance_within(1.0) / run.tolerance_within(1.0))
    return len(runs) > 1 and runs[-1].steps.evaluations * dearer**decades > evaluations_within(runs[0])


def unknown(monitor: Monitor) -> Diagnostic:
    """Warning that a run could not be compared."""
    late = f"no comparison run with other steps ended within {GIVEN_UP} times the evaluations of this run"
    text = f"doubtful: the error is unknown, since {late}; {advice(monitor)} and compare"
    return Diagnostic(text, "no-comparison-run")


def unrepeated(monitor: Monitor, error: float) -> Diagnostic:
    """Warning that a run by a law in Python may amplify what the law reads, which only a second run would show."""
    read = f"errors read by the control law add up to {error / monitor.tolerance:.2g} tolerances"
    text = f"doubtful: {read}, and a law in Python cannot be repeated to see whether they grow"
    return Diagnostic(f"{text}; take a tenth of the tolerance and compare", "doubtful-comparison")


def is_exceeded(monitor: Monitor, error: float) -> bool:
    """Whether a distance to a stricter run, plus the usual error of that run, is more than tolerable."""
    return bool(error > (Thresholds.tolerable - Thresholds.usual * PART) * monitor.tolerance)


def exceeded(monitor: Monitor, error: float) -> Diagnostic:
    """Warning that the stated error of a run [m] is beyond its tolerance."""
    off = f"tip error {error:.2g} m, {error / monitor.tolerance:.2g} times the tolerance{multiplies(monitor)}"
    return Diagnostic(f"doubtful: {off}; {advice(monitor)} and compare", "doubtful-comparison")


def doubt(monitor: Monitor, second: Second, path: Array) -> Diagnostic:
    """Warning that follows from the path of a verification run; empty if both runs agree."""
    own = monitor.record.compared(monitor.n_valid)[:: second.every][: len(path)]
    error = float(apart(own, path).max()) / second.larger
    run = second.run
    steps = f"a tolerance of {run.tolerance:.2g} m" if run.controlled else f"steps of {run.fixed_step:g} s"
    off = f"tip error {error:.2g} m"
    if not (chain := monitor.record.chain).has_levers:
        off = f"error {error:.2g} m (positions, or angles × {chain.size:.3g} m)"
    text = f"doubtful: {off} relative to a run with {steps}"
    if error > _tolerance(monitor):
        grown = multiplies(monitor) if monitor.explicit else ""
        text = f"{text}, {motion_in_words(chain, monitor.extent)}{grown}"
        return Diagnostic(f"{text}; {advice(monitor)} and compare", "doubtful-comparison")
    return Diagnostic("", "")


def multiplies(monitor: Monitor) -> str:
    """Why a run may amplify its errors, phrased as the end of a sentence; empty if no reason is known."""
    before = 0.0 if monitor.before is None else monitor.before.travelled
    if before + monitor.travelled > Thresholds.far_turned:
        return ": this motion amplifies errors"
    # Many rejected steps show that a motor keeps switching between its limits. Among 120 arms with motors that saturate
    # but do not keep switching, rejected steps were at most 0.7 times the steps taken.
    if monitor.steps.rejected > 0.8 * max(monitor.steps.taken, 50):
        return ": the drive switches repeatedly, and each switch adds an error"
    if loop_grows(monitor.record):
        rate = monitor.record.problem.scene.drive.rate or 0.0
        return f": the control loop, unstable at drive.rate = {rate:g} Hz, amplifies errors"
    return ""


def advice(monitor: Monitor) -> str:
    """Remedy for a run that its verification run contradicts."""
    return "take a hundredth of the tolerance" if monitor.run.controlled else "halve the step"


def _stricter_and_stricter(monitor: Monitor) -> Iterator[Second]:
    """Settings of stricter and stricter runs, until their own errors cannot explain a difference."""
    finer = 1e-2  # tolerance of a run, relative to the tolerance of the previous run
    tolerance, own = STRICTER * _tolerance(monitor), STRICTER * max(monitor.tip_error, monitor.record.least_tolerance)
    while tolerance > own:
        yield Second(_within(monitor.run, tolerance), 1, 1.0, strict=False)
        tolerance *= finer
    yield Second(_within(monitor.run, max(own, monitor.record.least_tolerance)), 1, 1.0)


def _within(run: RunSettings, tolerance: float) -> RunSettings:
    adaptive = replace(run, method=AUTO, step=None, tolerance=tolerance, relative_tolerance=None)
    return replace(adaptive, sample=run.spacing, solver=RunSettings().solver)


def _tolerance(monitor: Monitor) -> float:
    """Tip error [m] at which fixed steps are doubtful."""
    return max(Thresholds.doubt * Thresholds.tip_share * monitor.extent, monitor.record.least_tolerance / STRICTER)
