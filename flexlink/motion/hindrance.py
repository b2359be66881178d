"""Known causes of short steps and failed Newton iterations, each with a remedy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.describe.joint_units import in_words
from flexlink.describe.run_settings import AUTO, DEFAULT_TOLERANCE
from flexlink.describe.whole_steps import is_whole
from flexlink.dynamics.derivatives import forward_dynamics_derivatives
from flexlink.dynamics.tangent import load_torque
from flexlink.dynamics.terms import elastic_torque
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

    With the drive it is the largest |λ| of the `sampled_loop` of the arm linearized about its start, where it is held
    at rest. If the drive is not sampled, both factors are 0. The factor without the drive is computed only if the first
    one exceeds 1, else it is 1.
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
    size = 2 * n + len(moving)
    A = np.zeros((size, size))
    A[np.arange(n), n + np.arange(n)] = unit
    A[n : 2 * n] = np.hstack([slopes.dq / unit, slopes.dqd, slopes.dtau[:, moving]])
    Φ, loop = sampled_loop(A, K / np.concatenate([unit, np.ones(n)]), 1.0 / drive.rate, drive.delay)
    if not np.isfinite(loop).all():  # without the drive, the motion of the arm exceeds float64 within a period
        return np.inf, np.inf
    growth = _spectral_radius(loop)
    return growth, _spectral_radius(Φ) if growth > 1.0 else 1.0


def sampled_loop(A: Array, K: Array, T: float, delay: float) -> tuple[Array, Array]:
    """Φ of a linear system over a sampling period T [s], and the matrix of its loop with torques −K x after a `delay`.

        x_k+1 = Φ x_k + Γ_f u_k-m-1 + Γ_r u_k-m,   u_k = −K x_k,   delay = (m + f) T,   0 ≤ f < 1

    u_k-m-1 acts during the first part f T of a period, u_k-m during the rest (Franklin, Powell and Workman, Digital
    Control of Dynamic Systems, 1998, section 4.3). The loop's state is x_k, u_k-1, …, u_k-m-1.

    Parameters
    ----------
    A
        Slopes of ẋ with respect to x and u in the first rows, zeros below, shape (x + u, x + u).
    K
        Gains of the law, shape (u, x).
    T, delay
        Sampling period and delay [s].
    """
    d, n = K.shape
    periods = delay / T
    m = round(periods) if is_whole(periods) else math.floor(periods)
    f = max(0.0, periods - m) if not is_whole(periods) else 0.0
    first, rest = scipy.linalg.expm(A * (f * T)), scipy.linalg.expm(A * ((1.0 - f) * T))
    Φ = rest[:n, :n] @ first[:n, :n]
    Γ = [rest[:n, n:], rest[:n, :n] @ first[:n, n:]]  # of u_k-m and u_k-m-1
    queue = m + (f > 0.0)
    loop = np.zeros((n + d * queue, n + d * queue))
    loop[:n, :n] = Φ
    outputs = np.hstack([-K, np.zeros((d, d * queue))])  # u_k
    before = np.vstack([outputs, np.eye(n + d * queue)[n:]])  # u_k, u_k-1, …
    for late, part in enumerate(Γ[: 1 + (f > 0.0)], m):
        loop[:n] += part @ before[d * late : d * (late + 1)]
    loop[n:] = before[: d * queue]
    return Φ, loop


def _spectral_radius(A: Array) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max())
