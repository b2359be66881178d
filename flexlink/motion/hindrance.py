"""Known causes of short steps and failed Newton iterations, each with a remedy."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.joint_units import in_words
from flexlink.describe.run_settings import AUTO, DEFAULT_TOLERANCE
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.tangent import load_torque
from flexlink.dynamics.terms import elastic_torque
from flexlink.dynamics.vibration.sampled import delay_in, with_queue
from flexlink.motion.inputs.drives import gains_of
from flexlink.motion.inputs.tip_wrench import wrench_at
from flexlink.results.record import Record
from flexlink.results.stop_reasons import Failure


def hindrance(record: Record, q: Array) -> tuple[str, str] | None:
    """Known cause of short steps in a state with angles q (n,), and its remedy; or None."""
    if loop_is_unstable(record):
        growth, _ = sampled_growth(record)
        drive = record.problem.scene.drive
        late, shorter = (f" and drive.delay = {drive.delay:g} s", "a shorter delay, ") if drive.delay else ("", "")
        return (
            f"the control loop is unstable at drive.rate = {drive.rate:g} Hz{late}: near the start, "
            f"motion grows by a factor of {growth:.3g} per sampling period",
            f"use {shorter}a higher rate, smaller gains, or no rate, or add armature to the joints",
        )
    return _locked_gimbal(record, q)


def slow_progress(record: Record, state: Sequence[Array], t: float, how: str) -> tuple[str, str]:
    """Time and cause of slow progress in a state q, q̇, q̈ at time t [s], and a remedy."""
    text, (q, _, qdd, *_), chain = f"t = {t:.6g} s: {how}", state, record.chain
    if known := hindrance(record, q):
        cause, advice = known
        return f"{text}; {cause}", advice
    k, own = int(np.argmax(np.abs(qdd))), "" if record.run.method == AUTO else "method = 'auto', "
    at = in_words(bool(chain.slides[k]), float(q[k]), ".3g" if chain.slides[k] else ".1f")
    worst = f"joint {chain.joint_name(k)!r} at {at} has the largest acceleration"
    return f"{text}; {worst}", f"try {own}a larger tolerance or fixed steps, or raise max_evaluations"


def stuck(record: Record, q: Array, t: float, h: float, *, unsolved: int | None, explicit: bool) -> Failure:
    """Failure of a run in which even steps of h [s] fail at time t [s]; `unsolved`: joint whose stages failed."""
    run, chain = record.run, record.chain
    text, id = f"even steps of {h:.3g} s miss the tolerance at t = {t:.6g} s", "tolerance-not-met"
    if unsolved is not None:
        reason, id = "Newton's iteration does not converge", "newton-failed"
        if explicit:
            reason, id = "the state is no longer finite", "diverged"
        text = f"even steps of {h:.3g} s fail at t = {t:.6g} s: {reason} (joint {chain.joint_name(unsolved)!r})"
    if known := hindrance(record, q):
        cause, advice = known
        return Failure(f"{text}; {cause}", advice, id=id)
    if not run.controlled and chain.hinges["coulomb"].any():
        cause, allowed = f"{text}; dry friction changes sign within the step", DEFAULT_TOLERANCE * chain.size
        return Failure(cause, f"use run.tolerance, such as {allowed:.1g} m, instead of run.step", id=id)
    fixed = f"try a tolerance (adaptive steps), or a step smaller than {run.fixed_step:g} s"
    return Failure(text, "" if run.controlled else fixed, id=id)


def loop_is_unstable(record: Record) -> bool:
    """Whether small motion grows from sampling instant to instant with a sampled drive, but not without the drive."""
    # minimum relative excess over the growth without the drive, since motion of a toppling arm grows anyway
    faster_growth = 1e-3
    growth, without = sampled_growth(record)
    return growth > max(1.0, without) * (1.0 + faster_growth)


def _locked_gimbal(record: Record, q: Array) -> tuple[str, str] | None:
    """Cause and remedy if the first and third axes of a three-axis hinge nearly coincide, else None."""
    # cosine of the second angle below which the first and third axes nearly coincide, so that the rates of these two
    # angles are ten times the angular rate of the body
    near_gimbal_lock = 0.1
    chain, places = record.chain, [(c.link, c.segment, c.of_root) for c in record.chain.coordinates]
    for place, group in itertools.groupby(range(chain.n), key=lambda k: places[k]):
        axes = [k for k in group if (place[1] or place[2]) and chain.coordinates[k].axis]
        if len(axes) == 3 and abs(np.cos(q[axes[1]])) < near_gimbal_lock:
            name, angle = chain.joint_name(axes[1]), np.degrees(q[axes[1]])
            return (
                f"hinge {name!r} is bent by {angle:.1f}°, near gimbal lock: two of its three axes nearly coincide",
                "use more segments or a shorter run",
            )
    return None


def sampled_growth(record: Record) -> tuple[float, float]:
    """Growth factor of the fastest growing motion per sampling period of a drive, with and without the drive.

    With the drive it is the largest |λ| of the arm linearized about its start, where it is held at rest, and sampled
    (`with_queue`), under torques −K x. If the drive is not sampled, both factors are 0. The factor without the drive is
    computed only if the first one exceeds 1, else it is 1.
    """
    if not record.inputs.drive.rate:
        return 0.0, 0.0
    about = record.q[0].tobytes(), float(record.t[0])
    growth: tuple[float, float] = record.kept("growth", about, lambda: _sampled_growth(record))
    return growth


def _sampled_growth(record: Record) -> tuple[float, float]:
    chain, drive, q = record.chain, record.inputs.drive, record.q[0]
    n, zero, start = chain.n, np.zeros(chain.n), float(record.t[0])
    moving = chain.active[chain.hinges["prescribed"][chain.active] == 0]
    K = np.hstack([gain[moving] for gain in gains_of(chain, drive._replace(rate=0.0), start, q, zero).matrices()])
    wrench, frame = wrench_at(record.inputs, start)
    try:
        held = load_torque(chain, q, zero, wrench) + elastic_torque(chain, q)
        slopes = forward_dynamics_derivatives(chain, q, zero, held, tip_wrench=wrench, frame=frame)
    except FlexlinkError:
        return 0.0, 0.0
    ω = np.sqrt(np.abs(np.diag(slopes.dq)))
    unit = np.where(ω > 0, ω, 1.0)  # angles in units of 1/ω, which balances A
    A = np.zeros((2 * n, 2 * n))
    A[np.arange(n), n + np.arange(n)] = unit
    A[n:] = np.hstack([slopes.dq / unit, slopes.dqd])
    B = np.vstack([np.zeros((n, len(moving))), slopes.dtau[:, moving]])
    period = 1.0 / drive.rate
    Φ, Γ = with_queue(A, B, period, delay_in(period, drive.delay))
    if not (np.isfinite(Φ).all() and np.isfinite(Γ).all()):  # without the drive, motion exceeds float64 in a period
        return np.inf, np.inf
    loop = Φ.copy()
    loop[:, : 2 * n] -= Γ @ (K / np.concatenate([unit, np.ones(n)]))
    growth = _spectral_radius(loop)
    return growth, _spectral_radius(Φ[: 2 * n, : 2 * n]) if growth > 1.0 else 1.0


def _spectral_radius(A: Array) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max())
