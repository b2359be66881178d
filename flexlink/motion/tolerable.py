"""What a tolerance allows a run, and which of its steps are measured."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Indices
from flexlink.describe.run_settings import RunSettings
from flexlink.kernels.stepping.judgement import Allowance
from flexlink.results import balance


class Thresholds:
    """From what on a run is doubted, or judged."""

    far_bent: float = float(np.radians(84.0))
    """Angle of a hinge from which a chain says little of the beam, and of three axes at one point the outer two nearly
    coincide: cond(M) grows by 1/cos² 84° = 90, two decimal digits."""
    a_degree: float = float(np.radians(1.0))
    """Bends of hinges between which M is judged again [rad]."""
    at_limit: float = 1e-9
    """How far past a limit an angle still counts as at it [rad]: rounding of a run that starts or is led there."""
    tip_share: float = 0.05
    """Error of the tip, as a part of its motion, that counts as wrong: the same 5 % as in `balance.SHARE`."""
    doubt: float = 0.1
    """Part of `balance.SHARE` and `tip_share` from which a run is doubtful: what is seen of the errors are the losses
    of energy and the steps' own errors, which sensitive motion, and motion that drifts out of phase, multiply."""
    far_turned: float = 8.0
    """Angle travelled by all joints [rad] that calls for a verification run: errors of rates become errors of angles,
    and postures change without end. The models of the project that swing or move from place to place travel 7.1 and
    less. Arms with errors of more than ten tolerances travelled 29 and more of a thousand that were hit, 8.8 and
    more of 300 whose motors saturate, which hold nothing meanwhile."""
    long: int = 100
    """Number of steps with a tolerance in a run from which each is short: the error that it may have is in
    proportion."""
    tolerable: float = 3.0
    """Tolerances that a run may be off by: ten are the limit for an error at the end, one is what it should be."""
    few: int = 8
    """Tries of steps, at least: the first ones of a method, which begins anew, and those by which it is judged."""
    switch: float = 1e-4
    """CPU time of a change of methods, and back, beside their steps [s]."""
    trial: float = 0.03
    """Part of what a run has cost that a trial of a method may cost, if it is not fewer steps than twice `few`."""
    patience: Mapping[str, float] = MappingProxyType({"Radau5": 0.15, "Radau9": 0.4, "DOP853": 0.25})
    """Part of what a method promises to cost in the rest of a run that the run must have cost before that method goes
    on; a third of it, where it was tried, but of Radau9, for which the vibration of a start is dearest: Radau5 damps
    it. Measured on 90 random scenes with four tolerances: 0.15 and 0.3 for all three are as good within 2 %."""


APART = 128
"""How many steps' own errors are looked at, by two steps of half the size: at least so many of a run, and of a long one
one in so many, which costs three in 128, 2 %."""


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """The tolerance of a run [m]; a relative one is a part of the size, or of the largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.size)


def allowed_imbalance(run: RunSettings, chain: Chain, least: float, explicit: bool, compared: bool) -> Allowance:
    """Energy imbalance that position errors δ of the bodies, as large as the tolerance, explain: m g δ and m v δ/τ.

    τ, in which a body gets δ off its way, is a long step. Of a motion of a size errors of `Thresholds.tolerable` δ that
    go as it goes change rates by as large a part, and energies by twice that. An implicit method damps vibrations that
    stay below δ, however fast they are, and all energy may have been theirs, or work that a drive does on them: it is
    `compared` with a second run, if there is one, which judges. No δ is below the `least` tolerance [m].
    """
    if not run.controlled or run.duration == 0:
        return balance.NOTHING
    momentum = math.sqrt(2 * chain.mass) * Thresholds.long / run.duration
    share = 2 * Thresholds.tolerable if explicit else math.inf
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
