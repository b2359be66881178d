"""Errors that a tolerance allows a run, and the steps whose errors are measured."""

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

    The outer two of three axes at one point then nearly coincide: cond(M) grows by 1/cos² 84° = 90, two decimal digits.
    """
    a_degree: float = float(np.radians(1.0))
    """Bend of a hinge between two checks of M [rad]."""
    at_limit: float = 1e-9
    """Distance past a joint limit that still counts as at it [rad]: rounding error of a run that moves to the limit."""
    tip_share: float = 0.05
    """Tip error relative to the tip's motion that counts as wrong: 5 %, as in `balance.SHARE`."""
    doubt: float = 0.1
    """Fraction of `balance.SHARE` and `tip_share` above which a run is doubtful.

    Only energy losses and the steps' own errors are measured. Sensitive motion, and motion that drifts out of phase,
    amplify them.
    """
    far_turned: float = 8.0
    """Angle travelled by all joints [rad] above which a verification run is made.

    Errors of rates become errors of angles, and configurations never repeat. The project's models that swing or move
    from place to place travel at most 7.1 rad. Arms with errors above ten tolerances travelled at least 29 rad, among a
    thousand that were hit, and at least 8.8 rad among 300 whose motors saturate and so hold nothing.
    """
    long: int = 100
    """An adaptive step shorter than the duration over this number gets a proportional part of the tolerance."""
    tolerable: float = 3.0
    """Error of a run in tolerances that is accepted; it should be 1, and at most 10 at the end."""
    few: int = 8
    """Minimum number of attempted steps: the first ones after a restart, and those that give a method's rate."""
    switch: float = 1e-4
    """CPU time of a switch of methods and back, without their steps [s]."""
    trial: float = 0.03
    """Fraction of a run's cost that a trial of a method may cost; a trial takes at least twice `few` steps."""
    patience: Mapping[str, float] = MappingProxyType({"Radau5": 0.15, "Radau9": 0.4, "DOP853": 0.25})
    """Fraction of a method's promised cost for the rest of the run that a run must have cost before it switches.

    After a trial a third of it is enough, except for Radau9: the vibration after a start costs it most, and Radau5
    damps that. Measured on 90 random scenes with four tolerances: 0.15 and 0.3 for all three are as good within 2 %.
    """


APART = 128
"""Error probes: one step in 128 of a long run is repeated as two half steps, at a cost of 2 %."""


def tolerance_of(run: RunSettings, chain: Chain, deflection: float) -> float:
    """Tolerance of a run [m]; a relative one refers to the size, or to the largest deflection so far [m]."""
    return run.tolerance_within(deflection if run.accuracy == "deflection" else chain.size)


def allowed_imbalance(run: RunSettings, chain: Chain, least: float, explicit: bool, compared: bool) -> Allowance:
    """Energy imbalance explained by position errors δ of the bodies as large as the tolerance: m g δ and m v δ/τ.

    τ, the time in which a body deviates by δ, is a long step. If errors of `Thresholds.tolerable` δ are proportional to
    the motion, rates have the same relative error as positions, and energies have twice that. An implicit method damps
    vibrations below δ at any frequency, and these may contain all the energy, or the work of a drive. Such a run is
    `compared` with a second run, if there is one, which decides. δ is at least the `least` tolerance [m].
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
    """Distance between measured steps [samples]."""
    fewest = 64  # measured steps of a run, if it has enough steps
    steps_apart = min(APART, (run.samples - 1) * run.steps_per_sample // fewest)
    return max(1, -(-steps_apart // run.steps_per_sample))
