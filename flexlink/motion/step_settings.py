"""Settings of the steps of a method: the error that each may have, its shortest and its longest length."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.dynamics.vibration.rate_bound import rate_bound
from flexlink.dynamics.vibration.stability import bounding_eigenvalues, stable_step, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.stop_times import SHORTEST
from flexlink.motion.tolerable import Thresholds
from flexlink.results.record import Record


def longest_step(name: str, record: Record, span: float, t: float, state: tuple[Array, ...]) -> float:
    """Of an explicit method its largest stable step about a state t, q, q̇ [s], beyond which its error only grows.

    inf where that is surely longer than `span`, the time between two at which steps end.
    """
    chain, (q, qd, *_) = record.chain, state
    acting = acting_at(record.inputs, chain, t, q, qd)
    if _matters(name, span, rate_bound(chain, q, qd, **acting)):
        return stable_step(chain, q, qd, method=name, **acting)
    return np.inf


def longest_step_of(name: str, span: float, ω: float, δ: float) -> float:
    """The same where the fastest motions swing at ω [rad/s] and decay at δ [1/s]."""
    λ = bounding_eigenvalues(ω, δ)
    return stable_step_of(λ, name) if _matters(name, span, float(np.abs(λ).max())) else np.inf


def _matters(name: str, span: float, rate: float) -> bool:
    """Whether a step as long as `span` [s] may not be stable for eigenvalues up to a rate [1/s]."""
    return not 1.01 * span * rate < stable_half_disc(method(name))


def settings(run: RunSettings, rule: Method, record: Record, largest: float) -> tuple[float, ...]:
    """Settings of `advance`: error limits, order of the error estimate, shortest and longest step."""
    long_stages = 5  # implicit methods of so many stages take few, long steps
    exact = 1e-13  # residual of a fixed step over the arm's size; a larger one makes the energy drift
    if record.chain.has_free_base:
        exact = 1e-16  # one pass more: all steps leave momentum of one sign, and nothing takes it up
    of_the_iteration = 0.05  # residual of the Newton iteration over the error that a step may have
    of_a_deflection = 0.1  # stricter where the tolerance is on deflection: errors of all steps ring on in its vibration
    size = record.chain.size
    if not run.controlled:
        return np.inf, 0.0, run.fixed_step, exact * size, 0.0, 1.0, run.duration, run.fixed_step, run.fixed_step
    if run.accuracy == "deflection" and not (record.chain.hinges["stiffness"] > 0).any():
        raise SceneError(
            f"run.accuracy = 'deflection': no link of {record.chain.name!r} bends, so there is no deflection to take "
            "a fraction of; take accuracy = 'tip'",
            id="nothing-bends",
        )
    least = record.least_tolerance
    absolute, part = least, run.relative_tolerance or 0.0  # of no deflection what rounding leaves
    if run.accuracy == "tip":
        absolute, part = run.tolerance_within(size), 0.0
        if absolute < least:
            raise SceneError(
                f"run.tolerance = {absolute:.3g} m: below the rounding error of an arm of {size:.3g} m at "
                f"angles up to {np.abs(record.q[0]).max():.2g} rad; allowed are {least:.2g} m and more",
                id="tolerance-below-rounding",
            )
    order = float(rule.order if rule.explicit else rule.stages + 1)
    long = rule.stages >= long_stages
    # Error that one step may have, as a part of the tolerance, of which a run has `Thresholds.long` times as much for
    # all its steps. It is the error of a formula of lower order: that of the step itself is a few hundredths of it, or
    # less. Measured on 16 scenes with 7 tolerances: the errors at the end have a median of 0.14 of the tolerance, or
    # less, and are at most 6 times it where motion is sensitive. An explicit method's steps, small for stability's
    # sake, have the errors they tell, all in one direction.
    one = 0.02 if rule.explicit else 0.1 if long else 0.25
    errors = one * absolute, of_a_deflection * one * part, run.duration / Thresholds.long, np.inf, of_the_iteration
    return *errors, order, run.duration, SHORTEST * run.duration, largest
