"""Settings of a method's steps: limits of their errors and lengths, and the largest stable step."""

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.memo import Memo, contents
from flexlink.common.types import Array
from flexlink.data.documents import is_user_file
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.schemes.methods import Method, method
from flexlink.dynamics.vibration.stability import bounding_eigenvalues, eigenvalue_bounds, stable_step, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.kernels.inputs.record import Inputs
from flexlink.motion.inputs.actuation import acting_at
from flexlink.motion.stop_times import SHORTEST
from flexlink.motion.tolerable import Thresholds
from flexlink.results.record import Record


def with_own_limits(inputs: Inputs) -> Inputs:
    """Inputs with a copy of the torque limits if steps may write to them; see `saturation.saturates` of the kernels."""
    drive = inputs.drive
    if drive.rate or min(drive.effort.tolist(), default=np.inf) == np.inf:  # no motor saturates within a step
        return inputs
    return inputs._replace(drive=drive._replace(limits=drive.limits.copy()))


LONGEST = Memo(16)  # cache of stable steps, which a run and those that it is compared with share


def longest_step(name: str, record: Record, span: float, t: float, state: tuple[Array, ...]) -> float:
    """Largest stable step [s] of an explicit method about a state; inf if beyond `span`, the time between two stops."""
    chain, (q, qd, *_) = record.chain, state
    acting = acting_at(record.inputs, chain, t, q, qd)

    def find() -> float:
        if _matters(name, span, *eigenvalue_bounds([(chain, q, qd)], [acting])):
            return stable_step(chain, q, qd, method=name, **acting)
        return np.inf

    return find() if is_user_file(name) else LONGEST(chain, contents((name, span, q, qd, *acting.values())), find)


def longest_step_of(name: str, span: float, ω: float, δ: float) -> float:
    """Return `longest_step` for motion whose fastest oscillation is ω [rad/s] and fastest decay δ [1/s]."""
    λ = bounding_eigenvalues(ω, δ)
    return stable_step_of(λ, name) if _matters(name, span, float(np.abs(λ).max())) else np.inf


def _matters(name: str, span: float, rate: float) -> bool:
    """Whether a step of length `span` [s] may be unstable for eigenvalues λ with |λ| up to `rate` [1/s]."""
    return not 1.01 * span * rate < stable_half_disc(method(name))


def settings(run: RunSettings, rule: Method, record: Record, largest: float) -> tuple[float, ...]:
    """Settings of `advance`: error limits, order of the error estimate, shortest and longest step."""
    long_stages = 5  # implicit methods with this number of stages or more take few, long steps
    exact = 1e-13  # residual of a fixed step, relative to the arm's size; a larger one makes the energy drift
    if record.chain.has_free_base:
        exact = 1e-16  # free base: one more iteration, since momentum errors of all steps add up and nothing damps them
    of_the_iteration = 0.05  # residual of the Newton iteration, relative to the allowed error of a step
    of_a_deflection = 0.1  # factor on a tolerance for deflection, since errors of all steps persist as vibration
    size = record.chain.size
    if not run.controlled:
        return np.inf, 0.0, run.fixed_step, exact * size, 0.0, 1.0, run.duration, run.fixed_step, run.fixed_step
    if run.accuracy == "deflection" and not (record.chain.hinges["stiffness"] > 0).any():
        why = f"no link of {record.chain.name!r} bends, so its deflection is always zero; use accuracy = 'tip'"
        raise SceneError(f"run.accuracy = 'deflection': {why}", id="nothing-bends")
    least = record.least_tolerance
    absolute, part = run.tolerance_within(size), 0.0
    if run.accuracy == "deflection":
        absolute, part = least, run.tolerance_within(1.0)  # `least`, due to rounding, if the deflection is zero
    elif absolute < least:
        why = f"below the rounding error of an arm of {size:.3g} m at angles up to {np.abs(record.q[0]).max():.2g} rad"
        text = f"run.tolerance = {absolute:.3g} m: {why}; expected at least {least:.2g} m"
        raise SceneError(text, id="tolerance-below-rounding")
    elif record.follows_vibrations:
        absolute, part = least, absolute / size
    order = float(rule.order if rule.explicit else rule.stages + 1)
    long = rule.stages >= long_stages
    # Largest error, relative to the tolerance, of a step of length duration / `Thresholds.long`; a shorter step may
    # have proportionally less. This refers to the embedded lower-order formula; the step's own error is a few
    # hundredths of it or less. Measured on 16 scenes with 7 tolerances, errors at the end have a median of at most 0.14
    # tolerances, and are at most 6 tolerances where motion is sensitive. Explicit steps limited by stability actually
    # have the errors that they estimate, all of one sign.
    one = 0.02 if rule.explicit else 0.1 if long else 0.25
    errors = one * absolute, of_a_deflection * one * part, run.duration / Thresholds.long, np.inf, of_the_iteration
    return *errors, order, run.duration, SHORTEST * run.duration, largest
