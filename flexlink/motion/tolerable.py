"""Errors that a run may have for a given tolerance, and the steps whose errors are measured."""

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
    """Limits of the checks of a run, and of the choice of its method."""

    far_bent: float = float(np.radians(84.0))
    """Angle of a hinge beyond which a chain is a poor model of the beam [rad].

    The first and third of three axes at one point then nearly coincide, and cond(M) grows by a factor 1/cos² 84° = 90,
    so two decimal digits are lost.
    """
    a_degree: float = float(np.radians(1.0))
    """Increase of the largest hinge bend between two checks of M [rad]."""
    at_limit: float = 1e-9
    """Distance past a joint limit that is ignored [rad]: rounding error of a run that moves exactly to the limit."""
    tip_share: float = 0.05
    """Tip error, relative to the tip's motion, above which a result is wrong: 5 %, as in `balance.SHARE`."""
    doubt: float = 0.1
    """Fraction of the limits `balance.SHARE` and `tip_share` above which a run is doubtful.

    It is well below 1 because only energy errors and the steps' own errors are measured. These are amplified by
    sensitive motion, and by motion that drifts out of phase.
    """
    far_turned: float = 8.0
    """Angle travelled by all joints [rad] above which a verification run is made.

    Errors of rates then become errors of angles, and configurations never repeat. In the project's models of arms that
    swing or move from place to place, joints travel at most 7.1 rad. Where errors exceeded ten tolerances, joints
    travelled at least 29 rad (among a thousand arms after an impact), or at least 8.8 rad (among 300 arms whose motors
    saturate and so hold nothing).
    """
    long: int = 100
    """An adaptive step shorter than the duration over this number may use only a proportional part of the tolerance."""
    tolerable: float = 3.0
    """Largest error of a run, in units of its tolerance, that is accepted; ideally 1, and at most 10 at the end."""
    usual: float = 0.5
    """Error that is stated where nothing indicates a larger one, in tolerances: measured, they are 0.02 to 1.3."""
    lasting: float = 0.1
    """Error relative to the displacement by estimated errors of rates that last.

    Measured on free arms, it is 0.001 to 0.5; the larger numbers belong to vibrations that the steps do not resolve.
    """
    large: float = 0.5
    """Estimated error, in tolerances, from which a run is compared with another one; half of it, if it lasts."""
    seen: float = 0.1
    """Smallest error that is stated where two runs were compared, in tolerances."""
    coarser: float = 10.0
    """Tolerance of a coarser run with which a run is compared, relative to that of the run."""
    shrinks: float = 2.0
    """Ratio of their distance to the error of the run that is stated; measured, it is 1.5 to 15."""
    runs: int = 4
    """Largest number of runs with which one run is compared."""
    finer: str = "Radau9"
    """Method of the runs with which implicit ones are compared."""
    few: int = 8
    """Minimum number of attempted steps after a restart, and minimum number from which a cost rate is computed."""
    switch: float = 1e-4
    """CPU time of a switch to another method and back, without steps [s]."""
    trial: float = 0.03
    """Largest cost of the trial of a method, relative to the run so far; a trial takes at least twice `few` steps."""
    patience: Mapping[str, float] = MappingProxyType({"Radau5": 0.15, "Radau9": 0.4, "DOP853": 0.25})
    """Minimum cost of a run before it switches to a method, relative to the expected cost of the rest by that method.

    After a trial a third of it is enough, except for Radau9, to which the vibration after a start costs most; Radau5
    damps that vibration. On 90 random scenes with four tolerances, 0.15 or 0.3 for all three are equally good to 2 %.
    """


APART = 128
"""Number of steps between two error probes in a long run. A probe repeats a step as two half steps; this costs 2 %."""


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """Tolerance of a run [m]; relative tolerances refer to the arm's size, or to its largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.size)


def allowed_imbalance(run: RunSettings, chain: Chain, least: float, explicit: bool, compared: bool) -> Allowance:
    """Energy imbalance explained by position errors δ of the bodies as large as the tolerance: m g δ and m v δ/τ.

    τ, the time in which a body deviates by δ, is the length of a long step. If errors of `Thresholds.tolerable` δ are
    proportional to the motion, rates have the same relative error as positions, and energies twice that error. An
    implicit method damps vibrations with amplitudes below δ at any frequency, and these may contain all the energy, or
    the work of a drive. Such a run is `compared` with a second run, if there is one, which decides. δ is at least the
    `least` tolerance [m].
    """
    if not run.controlled or run.duration == 0:
        return balance.NOTHING
    momentum = math.sqrt(2 * chain.mass) * Thresholds.long / run.duration
    share = 2 * Thresholds.tolerable if explicit else math.inf
    part = run.tolerance_within(1.0) if run.accuracy == "deflection" else 0.0
    δ = max(tolerance_of(run, chain, 0.0), least)
    return Allowance(δ, part, chain.weight, momentum, share, not explicit, compared)


def probed(run: RunSettings, rows: slice) -> Indices:
    """Indices of the samples after which the error of a step is measured."""
    every = apart(run)
    return np.arange(-(-rows.start // every) * every, rows.stop, every)


def apart(run: RunSettings) -> int:
    """Number of samples between two measured steps."""
    fewest = 64  # minimum number of measured steps in a run with enough steps
    steps_apart = min(APART, (run.samples - 1) * run.steps_per_sample // fewest)
    return max(1, -(-steps_apart // run.steps_per_sample))
