"""A second run, by which a run judges what its own steps cannot tell: errors that the motion multiplies.

Fixed steps of an implicit method are compared with a run of twice the step, whose error is 2^p times theirs, or where
that finds no solution with one of half the step. Steps with a tolerance bound their own errors, and most motions add
them up; where joints turn round and round, errors grow: there a run with ten times the tolerance, for about half the
cost, tells how far apart two runs get.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from flexlink.describe.methods import method
from flexlink.describe.situation import Run
from flexlink.dynamics import rounding
from flexlink.motion.result import Record
from flexlink.motion.watch import DOUBT, TIP_SHARE, Watch

Array = NDArray[np.float64]

LOOSER = 10.0
"""Times the tolerance of the second run; its error is at most that of its own tolerance where errors only add up."""

FAR = 40.0
"""Angle [rad] that a joint goes through in all from which a motion is suspected to multiply errors: six turns. An error
of the rates turns into one of the angle all the time; where springs or gravity hold a joint it does not grow so."""


class Second(NamedTuple):
    """A run to compare with."""

    run: Run
    every: int  # of the first run's samples
    larger: float  # how far the two are apart, over the error of the first


def second_runs(watch: Watch, name: str) -> Iterator[Second]:
    """Runs to compare a finished one with, that advanced by the method of this name; the first that ends will do."""
    run = watch.run
    if run.controlled:
        if run.accuracy == "tip" and turned(watch.record) > FAR:
            tolerances = [None if one is None else LOOSER * one for one in (run.tolerance, run.relative_tolerance)]
            looser = replace(run, method=name, tolerance=tolerances[0], relative_tolerance=tolerances[1])
            yield Second(looser, 1, 1.0)
    elif not method(run.method).explicit and run.samples > 1:
        if pairs := (run.samples - 1) // 2:
            sample = 2 * run.sample
            coarser = replace(run, step=2 * run.step, sample=sample, duration=pairs * sample)
            yield Second(coarser, 2, 2.0 ** method(run.method).order - 1)
        yield Second(replace(run, step=run.step / 2), 1, 1.0)


def turned(record: Record) -> float:
    """Largest angle [rad] that a driven or free joint goes through, forth and back, by its rates at the samples."""
    joints = np.setdiff1d(record.chain.active, np.flatnonzero(record.chain.hinges["prescribed"]))
    rates = np.abs(record.qd[:, joints])
    return float(np.trapezoid(rates, record.t, axis=0).max(initial=0.0))


def doubt(watch: Watch, second: Second, tip: Array) -> str:
    """Why a run is doubtful whose second run has these tips; empty if it is not."""
    run, record = watch.run, watch.record
    error = float(np.linalg.norm(record.tip[:: second.every][: len(tip)] - tip, axis=1).max()) / second.larger
    if run.controlled:
        allowed = LOOSER * run.tolerance_within(rounding.reach(record.chain))
        told = f"{LOOSER:g} times the tolerance put the tip {error:.2g} m elsewhere: this motion multiplies errors"
        return f"doubtful: {told}; take a hundredth of the tolerance and compare" if error > allowed else ""
    moved = float(np.linalg.norm(np.ptp(record.tip, axis=0)))
    told = f"by a run with steps of {second.run.step:g} s the tip is off by {error:.2g} m where it moves {moved:.3g} m"
    return f"doubtful: {told}; halve the step and compare" if error > DOUBT * TIP_SHARE * moved else ""


UNKNOWN = "doubtful: no run with another step ends, and none tells the errors of this one; halve the step and compare"
