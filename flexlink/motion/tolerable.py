"""What a tolerance allows a run, and which of its steps are measured."""

from __future__ import annotations

import math

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Indices
from flexlink.describe.run_settings import RunSettings
from flexlink.kernels.stepping.judgement import Allowance
from flexlink.results import balance

LONG = 100
"""Number of steps with a tolerance in a run from which each is short: the error that it may have is in proportion."""


TOLERABLE = 3.0
"""Tolerances that a run may be off by: ten are the limit for an error at the end, one is what it should be."""


APART = 128
"""How many steps' own errors are looked at, by two steps of half the size: at least so many of a run, and of a long one
one in so many, which costs three in 128, 2 %."""


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """The tolerance of a run [m]; a relative one is a part of the size, or of the largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.size)


def allowed_imbalance(run: RunSettings, chain: Chain, least: float, explicit: bool, compared: bool) -> Allowance:
    """Energy imbalance that position errors δ of the bodies, as large as the tolerance, explain: m g δ and m v δ/τ.

    τ, in which a body gets δ off its way, is a long step. Of a motion of a size errors of `TOLERABLE` δ that go as it
    goes change rates by as large a part, and energies by twice that. An implicit method damps vibrations that stay
    below δ, however fast they are, and all energy may have been theirs, or work that a drive does on them: it is
    `compared` with a second run, if there is one, which judges. No δ is below the `least` tolerance [m].
    """
    if not run.controlled or run.duration == 0:
        return balance.NOTHING
    momentum, share = math.sqrt(2 * chain.mass) * LONG / run.duration, 2 * TOLERABLE if explicit else math.inf
    part = run.tolerance_within(1.0) if run.accuracy == "deflection" else 0.0
    δ = max(tolerance_of(run, chain, 0.0), least)
    return Allowance(δ, part, chain.weight, momentum, share, not explicit, compared)


def probed(run: RunSettings, rows: slice) -> Indices:
    """Samples whose next step's error is measured."""
    every = apart(run)
    return np.arange(-(-rows.start // every) * every, rows.stop, every)


def apart(run: RunSettings) -> int:
    """Distance between measured steps [samples]."""
    fewest = 64  # steps of a run whose error is measured, if it has so many
    steps_apart = min(APART, (run.samples - 1) * run.steps_per_sample // fewest)
    return max(1, -(-steps_apart // run.steps_per_sample))
