"""Known causes of short steps and failed Newton iterations, each with a remedy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexlink.chain.coordinates import Kind
from flexlink.common.errors import Diagnostic, FlexlinkError
from flexlink.common.types import Array
from flexlink.common.wording import short_list
from flexlink.describe.run_settings import AUTO, DEFAULT_TOLERANCE
from flexlink.dynamics.free_motion import DENSE
from flexlink.dynamics.ties import gaps
from flexlink.results.record import Record
from flexlink.results.stop_reasons import Failure

if TYPE_CHECKING:
    from flexlink.motion.loop.loop import Loop


def hindrance(record: Record, q: Array, t: float) -> tuple[str, str] | None:
    """Known cause of short steps in a state with angles q (n,) at time t [s], and its remedy; or None."""
    if loop_is_unstable(record):
        return unstable_loop(record)
    return _singular_ties(record, q, t) or _locked_gimbal(record, q)


def slow_progress(record: Record, state: Sequence[Array], t: float, how: str) -> tuple[str, str]:
    """Time and cause of slow progress in a state q, q̇, q̈ at time t [s], and a remedy."""
    text, (q, _, qdd, *_), chain = f"t = {t:.6g} s: {how}", state, record.chain
    if known := hindrance(record, q, t):
        cause, advice = known
        return f"{text}; {cause}", advice
    k, own = int(np.argmax(np.abs(qdd))), "" if record.run.method == AUTO else "method = 'auto', "
    at = chain.place_in_words(k, float(q[k]), ".3g")
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
    if known := hindrance(record, q, t):
        cause, advice = known
        return Failure(f"{text}; {cause}", advice, id=id)
    if not run.controlled and chain.hinges["coulomb"].any():
        cause, allowed = f"{text}; dry friction changes sign within the step", DEFAULT_TOLERANCE * chain.size
        return Failure(cause, f"use run.tolerance, such as {allowed:.1g} m, instead of run.step", id=id)
    fixed = f"try a tolerance (adaptive steps), or a step smaller than {run.fixed_step:g} s"
    return Failure(text, "" if run.controlled else fixed, id=id)


def loop_is_unstable(record: Record) -> bool:
    """Whether small motion grows from sampling instant to instant with a sampled drive, but not without the drive."""
    growth, without = sampled_growth(record)
    return growth > max(1.0, without) * (1.0 + 1e-3)  # motion of a toppling arm grows anyway


def loop_grows(record: Record) -> bool:
    """Whether the drive's sampled loop makes small motion grow notably within the run."""
    # Growth of motion due to a sampled loop within a run, relative to the growth without the drive, that is notable.
    # In 44 random loops, this growth was at most 2.1 if stable, else at least 4e3.
    notable_growth = 10.0
    growth, without = sampled_growth(record)
    more, rate = growth / max(1.0, without), record.inputs.drive.rate
    return more > 1.0 and math.log(more) * rate * record.run.duration > math.log(notable_growth)


def loop_warning(record: Record) -> tuple[Diagnostic, ...]:
    """Warning before a run whose sampled loop is unstable; only for up to `DENSE` joints, as it takes O(n³)."""
    if not record.inputs.drive.rate or record.chain.n > DENSE or not loop_grows(record):
        return ()
    return (Diagnostic("; ".join(unstable_loop(record)), "unstable-loop"),)


def unstable_loop(record: Record) -> tuple[str, str]:
    """What grows in an unstable loop, and what makes it stable."""
    if (loop := _loop(record)) is None:
        return "control loop unstable", "use lower gains"
    from flexlink.motion.loop.instability import instability  # noqa: PLC0415  explains what has failed

    return record.kept("unstable loop", (record.q[0].tobytes(), float(record.t[0])), lambda: instability(loop))


def held_torques_advice(between: float) -> str:
    """Remedy if torques held for `between` [s] destabilize an arm although its steps are stable."""
    likely = f"likely the control loop sampled at {1 / between:.6g} Hz is unstable, not the steps"
    return f"{likely}: use lower gains, a higher rate, or add armature to the joints"


def _singular_ties(record: Record, q: Array, t: float) -> tuple[str, str] | None:
    """Cause and remedy if exact ties nearly lose a row at angles q, as of links in one line, else None.

    The least singular value of their rows, among as many as are independent at the start, is compared with that there.
    """
    near_a_singular_posture = 0.05
    ties = record.problem.ties
    if ties is None or not (held := np.isinf(ties[0]["stiffness"])).any():
        return None
    before, now = (
        np.linalg.svd(gaps(ties, record.chain, at, time)[1][held], compute_uv=False)
        for at, time in ((record.q[0], float(record.t[0])), (q, t))
    )
    least = int((before > 1e-9 * before[0]).sum()) - 1
    if now[least] > near_a_singular_posture * before[least]:
        return None
    names = [repr(tie.name) for tie in record.problem.scene.ties if tie.exact]
    exact = "exact tie" if len(names) == 1 else "exact ties"
    remedy = "keep the arm away from it, as by shorter lengths of a cylinder, or give a tie stiffness"
    return f"singular posture of {exact} {short_list(names)}, as of links in one line", remedy


def _locked_gimbal(record: Record, q: Array) -> tuple[str, str] | None:
    """Cause and remedy if the first and third axes of a three-axis hinge nearly coincide, else None."""
    # cosine of the second angle below which the first and third axes nearly coincide, so that the rates of these two
    # angles are ten times the angular rate of the body
    near_gimbal_lock = 0.1
    chain, springs = record.chain, record.chain.where(Kind.ROOT, Kind.HINGE).tolist()
    for _, group in itertools.groupby(springs, key=lambda k: chain.coordinates[k].body):
        axes = [*group]
        if len(axes) == 3 and abs(np.cos(q[axes[1]])) < near_gimbal_lock:
            name, angle = chain.joint_name(axes[1]), np.degrees(q[axes[1]])
            cause = f"hinge {name!r} is bent by {angle:.1f}°, near gimbal lock: two of its three axes nearly coincide"
            return cause, "use more segments or a shorter run"
    return None


def sampled_growth(record: Record) -> tuple[float, float]:
    """Growth factor of the fastest growing motion per sampling period of a drive, with and without the drive.

    They are those of the `Loop` about the start of the run. If the drive is not sampled, both factors are 0. The factor
    without the drive is computed only if the first one exceeds 1, else it is 1.
    """
    if (loop := _loop(record)) is None:
        return 0.0, 0.0
    return loop.growth, loop.growth_without if loop.growth > 1.0 else 1.0


def _loop(record: Record) -> Loop | None:
    """The sampled loop about the start; None if the drive is not sampled, or the loop cannot be linearized there."""
    if not record.inputs.drive.rate or record.tied:
        return None

    def linearized() -> Loop | None:
        from flexlink.motion.loop.loop import loop_of  # noqa: PLC0415  only sampled drives have a loop

        try:
            return loop_of(record.problem, (record.q[0].copy(), float(record.t[0])))
        except FlexlinkError:
            return None

    return record.kept("loop", (record.q[0].tobytes(), float(record.t[0])), linearized)
