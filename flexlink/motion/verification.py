"""Verification by a second run, which reveals errors that the motion amplifies; a run's own checks cannot show them.

A run with fixed steps of an implicit method is compared with a run of twice the step, at about half the cost. If the
two differ, or a step of the second run had to be divided, another run with a tolerance follows.

A tolerance bounds the errors of adaptive steps, and the errors of fixed explicit steps are measured; in most motions
they only add up. Errors grow where joints make full turns, or where the loop of a sampled drive is unstable. In these
cases a second run with a tenth of the tolerance shows by how much. Fixed explicit steps may be far more accurate than
necessary. They are compared with runs of smaller and smaller tolerance, until a run agrees, is strict enough to prove
them wrong, or has taken more evaluations than the run with fixed steps.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from msgspec.structs import replace

from flexlink.common.types import Array
from flexlink.common.wording import Diagnostic
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.motion.hindrance import loop_grows
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import apart, motion_in_words

STRICTER = 0.1
"""Tolerance of the second run, relative to the first run's tolerance, or to the error at which a run is doubtful."""


class Second(NamedTuple):
    """A verification run, and how it is compared."""

    run: RunSettings
    every: int  # number of samples of the first run per compared sample
    larger: float  # ratio of the distance between the two runs to the error of the first
    strict: bool = True  # whether this run is so accurate that a difference proves the first run wrong


def second_runs(monitor: Monitor, name: str) -> Iterator[Second]:
    """Yield runs with which to compare a finished run by method `name`; the first strict one that ends decides.

    If a control law drives the arm, there are no such runs, since the law may have internal states.
    """
    # Distance to a run with twice the step, relative to the error of the first run, for a method of order two. Steps
    # that hardly resolve the motion do not converge with the order of their method, and two such runs may be equally
    # wrong.
    error_ratio = 2**2 - 1.0
    run = monitor.run
    if monitor.control is not None:
        return
    if run.controlled:
        if monitor.suspicious or multiplies(monitor):
            yield Second(_stricter(monitor, name), 1, 1.0)
    elif monitor.explicit:
        if multiplies(monitor) and monitor.tip_error <= _tolerance(monitor):
            yield from _stricter_and_stricter(monitor)
    elif monitor.extent > 0:
        if pairs := (run.samples - 1) // 2:
            sample = 2 * run.spacing
            coarser = replace(run, step=2 * run.fixed_step, sample=sample, duration=pairs * sample)
            yield Second(coarser, 2, error_ratio, strict=False)
        yield Second(_within(run, AUTO, STRICTER * _tolerance(monitor)), 1, 1.0)


def doubt(monitor: Monitor, second: Second, path: Array) -> Diagnostic:
    """Warning that follows from the path of a verification run; empty if both runs agree."""
    own = monitor.record.compared(monitor.n_valid)[:: second.every][: len(path)]
    error = float(apart(own, path).max()) / second.larger
    of = second.run.tolerance or STRICTER * _tolerance(monitor)
    steps = f"a tolerance of {of:.2g} m" if second.run.controlled else f"steps of {second.run.fixed_step:g} s"
    text = f"doubtful: tip error {error:.2g} m relative to a run with {steps}"
    if not (chain := monitor.record.chain).has_levers:
        text = (
            f"doubtful: error {error:.2g} m (positions, or angles × {chain.size:.3g} m) relative to a run with {steps}"
        )
    if monitor.run.controlled and error > Thresholds.tolerable * _tolerance(monitor):
        return Diagnostic(f"{text}{multiplies(monitor)}; {advice(monitor)} and compare", "doubtful-comparison")
    if not monitor.run.controlled and error > _tolerance(monitor):
        grown = multiplies(monitor) if monitor.explicit else ""
        text = f"{text}, {motion_in_words(chain, monitor.extent)}{grown}"
        return Diagnostic(f"{text}; {advice(monitor)} and compare", "doubtful-comparison")
    return Diagnostic("", "")


def multiplies(monitor: Monitor) -> str:
    """Why a run may amplify its errors, phrased as the end of a sentence; empty if no reason is known."""
    if monitor.travelled > Thresholds.far_turned:
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
        yield Second(_within(monitor.run, AUTO, tolerance), 1, 1.0, strict=False)
        tolerance *= finer
    yield Second(_within(monitor.run, AUTO, max(own, monitor.record.least_tolerance)), 1, 1.0)


def _stricter(monitor: Monitor, name: str) -> RunSettings:
    """The settings of the finished run with a stricter tolerance of the same kind."""
    run = monitor.run
    if run.accuracy == "tip":
        return _within(run, name, max(STRICTER * _tolerance(monitor), monitor.record.least_tolerance))
    return replace(run, method=name, relative_tolerance=STRICTER * run.tolerance_within(1.0))


def _within(run: RunSettings, name: str, tolerance: float) -> RunSettings:
    return replace(
        run,
        method=name,
        step=None,
        tolerance=tolerance,
        relative_tolerance=None,
        sample=run.spacing,
        solver=RunSettings().solver,
    )


def _tolerance(monitor: Monitor) -> float:
    """Tolerance of a run [m]; for fixed steps, the tip error at which they are doubtful."""
    if monitor.run.controlled:
        return monitor.tolerance
    return max(Thresholds.doubt * Thresholds.tip_share * monitor.extent, monitor.record.least_tolerance / STRICTER)
