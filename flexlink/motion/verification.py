"""A second run, which reveals what a run's own checks cannot: errors that the motion amplifies.

Fixed steps of an implicit method are compared with a run of twice the step, at about half the cost. If the two differ,
or one of these steps was taken in parts, a run with a tolerance follows.

A tolerance bounds the errors of adaptive steps, and the errors of fixed explicit steps are measured; most motions only
add them up. They grow where joints turn round and round, or where the loop of a sampled drive is unstable. There a run
with a tenth of the tolerance shows by how much. Fixed explicit steps may be far more accurate than necessary. They are
compared with runs of smaller and smaller tolerances, until a run agrees, is strict enough to prove them wrong, or has
taken more evaluations than they have.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.common.types import Array
from flexlink.common.wording import Diagnostic
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.motion.hindrance import sampled_growth
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import apart, motion_in_words

STRICTER = 0.1
"""Tolerance of the second run over that of the first, or over the error at which a run is doubtful."""


class Second(NamedTuple):
    """A verification run, and how it is compared."""

    run: RunSettings
    every: int  # samples of the first run per compared sample
    larger: float  # distance of the two runs over the error of the first
    strict: bool = True  # so accurate that a difference proves the first run wrong


def second_runs(monitor: Monitor, name: str) -> Iterator[Second]:
    """Yield runs to compare a finished run by method `name` with; the first that ends and is strict decides.

    There are none if a control law drives the arm: it may have memory.
    """
    # Ratio of the distance to a run with twice the step to the error of the first run, at order two. Steps that hardly
    # resolve the motion do not show the order of their method, and two such runs may be wrong alike.
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
    text = f"doubtful: tip error {error:.2g} m against a run with {steps}"
    if not (chain := monitor.record.chain).has_levers:
        text = (
            f"doubtful: error {error:.2g} m (positions, or angles times {chain.size:.3g} m) against a run with {steps}"
        )
    if monitor.run.controlled and error > Thresholds.tolerable * _tolerance(monitor):
        return Diagnostic(f"{text}{multiplies(monitor)}; {advice(monitor)} and compare", "doubtful-comparison")
    if not monitor.run.controlled and error > _tolerance(monitor):
        grown = multiplies(monitor) if monitor.explicit else ""
        text = f"{text}, {motion_in_words(chain, monitor.extent)}{grown}"
        return Diagnostic(f"{text}; {advice(monitor)} and compare", "doubtful-comparison")
    return Diagnostic("", "")


def multiplies(monitor: Monitor) -> str:
    """Why a run may amplify its errors, as the end of a sentence; empty if no reason is known."""
    # Growth of motion by a sampled loop within a run, relative to that without the drive, above which a verification
    # run is made. Among 44 random loops the stable ones reached at most 2.1, the others at least 4e3.
    notable_growth = 10.0
    if monitor.travelled > Thresholds.far_turned:
        return ": this motion amplifies errors"
    # a motor that keeps switching between its limits: among 120 arms with saturating motors none rejected more than 0.7
    # of the steps taken
    if monitor.steps.rejected > 0.8 * max(monitor.steps.taken, 50):
        return ": the drive switches again and again, and each switch adds an error"
    growth, without = sampled_growth(monitor.record)
    more, rate = growth / max(1.0, without), monitor.record.problem.scene.drive.rate or 0.0
    if more > 1.0 and np.log(more) * rate * monitor.run.duration > np.log(notable_growth):
        return f": the control loop, unstable at drive.rate = {rate:g} Hz, amplifies errors"
    return ""


def advice(monitor: Monitor) -> str:
    """Remedy for a run that its verification run contradicts."""
    return "take a hundredth of the tolerance" if monitor.run.controlled else "halve the step"


def _stricter_and_stricter(monitor: Monitor) -> Iterator[Second]:
    """Settings of stricter and stricter runs, until their own errors cannot explain a difference."""
    finer = 1e-2  # tolerance of a run over that of the one before
    tolerance, own = STRICTER * _tolerance(monitor), STRICTER * max(monitor.tip_error, monitor.record.least_tolerance)
    while tolerance > own:
        yield Second(_within(monitor.run, AUTO, tolerance), 1, 1.0, strict=False)
        tolerance *= finer
    yield Second(_within(monitor.run, AUTO, max(own, monitor.record.least_tolerance)), 1, 1.0)


def _stricter(monitor: Monitor, name: str) -> RunSettings:
    """The same settings with a stricter tolerance of the same kind."""
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
