"""A second run, by which a run judges what its own steps cannot tell: errors that the motion multiplies.

Fixed steps of an implicit method are compared with a run of twice the step, for about half the cost, and, where the two
differ or one of these steps was taken in parts, with one that keeps a tolerance. The errors of the steps themselves are
bounded by a tolerance, or known, of a fixed step of an explicit method, and most motions add them up. Where joints turn
round and round, or the loop of a sampled drive is unstable, errors grow. There a run with a tenth of the tolerance
tells how far; fixed explicit steps, which may be far better than they need be, are compared with less and less
tolerance, until a run agrees, is itself so strict that they are to blame, or has taken more evaluations than they have.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from flexlink.common.types import Array
from flexlink.describe.run_settings import AUTO, RunSettings
from flexlink.motion.hindrance import sampled_growth
from flexlink.motion.monitor import Monitor
from flexlink.motion.tolerable import Thresholds
from flexlink.results.tip_motion import apart, motion_in_words

STRICTER = 0.1
"""Part of the tolerance, or of the error from which a run is doubtful, that the second run is allowed."""


class Second(NamedTuple):
    """A verification run, and how it compares."""

    run: RunSettings
    every: int  # of the first run's samples
    larger: float  # how far the two are apart, over the error of the first
    strict: bool = True  # so much that the first is to blame where they differ


def second_runs(monitor: Monitor, name: str) -> Iterator[Second]:
    """Runs to compare a finished one with, that advanced by the method of this name: up to one that ends and is strict.

    None where a control law drives the arm: it may remember what it was asked.
    """
    # Error of the run with twice the step, less that of the first, over that of the first, for order two: steps that
    # hardly resolve the motion do not show the order of their method, and two such runs may be wrong alike.
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


def doubt(monitor: Monitor, second: Second, path: Array) -> str:
    """The warning that follows from what a verification run has to compare; empty if both runs agree."""
    own = monitor.record.compared(monitor.n_valid)[:: second.every][: len(path)]
    error = float(apart(own, path).max()) / second.larger
    of = second.run.tolerance or STRICTER * _tolerance(monitor)
    steps = f"a tolerance of {of:.2g} m" if second.run.controlled else f"steps of {second.run.fixed_step:g} s"
    text = f"doubtful: tip error {error:.2g} m against a run with {steps}"
    if not (chain := monitor.record.chain).has_levers:
        text = (
            f"doubtful: error {error:.2g} m, of places or angles times {chain.size:.3g} m, against a run with {steps}"
        )
    if monitor.run.controlled and error > Thresholds.tolerable * _tolerance(monitor):
        return f"{text}{multiplies(monitor)}; {advice(monitor)} and compare"
    if not monitor.run.controlled and error > _tolerance(monitor):
        grown = multiplies(monitor) if monitor.explicit else ""
        return f"{text}, {motion_in_words(chain, monitor.extent)}{grown}; {advice(monitor)} and compare"
    return ""


def multiplies(monitor: Monitor) -> str:
    """Why a run may multiply its errors, as the end of a sentence; empty if there is no known reason."""
    # Growth of motion by a sampled loop within a run, beyond that without the drive, that calls for a verification run.
    # Of 44 random loops the stable ones came to 2.1 and less, the others to 4e3 and more.
    notable_growth = 10.0
    if monitor.travelled > Thresholds.far_turned:
        return ": this motion amplifies errors"
    # a motor that switches between its limits without end: of 120 arms whose motors saturate none rejected more than
    # 0.7 of the steps taken
    if monitor.steps.rejected > 0.8 * max(monitor.steps.taken, 50):
        return ": steps end at switches of the drive again and again, and each adds an error"
    growth, without = sampled_growth(monitor.record)
    more, rate = growth / max(1.0, without), monitor.record.problem.scene.drive.rate or 0.0
    if more > 1.0 and np.log(more) * rate * monitor.run.duration > np.log(notable_growth):
        return f": the control loop, unstable at drive.rate = {rate:g} Hz, amplifies errors"
    return ""


def advice(monitor: Monitor) -> str:
    """What to change in a run that its verification run contradicts."""
    return "take a hundredth of the tolerance" if monitor.run.controlled else "halve the step"


def _stricter_and_stricter(monitor: Monitor) -> Iterator[Second]:
    """Settings of stricter and stricter runs that may explain a difference by their own errors."""
    finer = 1e-2  # Tolerance of a run that is to explain why two differ, over that of the one before
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
    """Of a run [m]; of fixed steps the error of the tip from which they are doubtful."""
    if monitor.run.controlled:
        return monitor.tolerance
    return max(Thresholds.doubt * Thresholds.tip_share * monitor.extent, monitor.record.least_tolerance / STRICTER)
