"""Corners: a motor saturates, and a tie touches, during a whole step or not at all; a step ends where this changes.

A torque |u| ≤ E has a kink where its law u reaches E. Neither the polynomial of a step nor its error estimate can
represent this kink. A step therefore keeps the branch valid at its start, u, E or −E, so it is smooth. Afterwards a
search finds the fraction x of the step at which u leaves the branch. The torque error from there on is an impulse

    p = (1 − x) h max |off|

that displaces bodies, in a time τ without the drive, by δ = τ (M + τ D + τ² K)⁻¹ p. The largest δ over the times τ up
to the duration of the run counts. If it exceeds a small fraction of the tolerance, the step is repeated and ends just
after x. The gains of a saturated motor are zero in Newton's matrix and in the error norm.

The branches of a tie with a free range (`ties`) are this range and its ends, where it presses; its impulse p acts on
all joints, by Jᵀ p.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.inputs.laws import unlimited_torque
from flexlink.kernels.stepping.dense_output import between
from flexlink.kernels.stepping.error_norm import CLOSER, thrown
from flexlink.kernels.stepping.step_state import STEPPER
from flexlink.kernels.stepping.tie_rows import out_of_range
from flexlink.kernels.stepping.ties import find_at, rate
from flexlink.kernels.tools.compiler import entry, inlined, recursion, shared, subroutine

LOOKS = 4  # points checked in a step; a torque that leaves its branch only between two of them has a small error
OF_TIES = 16  # the same if ties have ranges, whose forces are steep
NEVER = 2.0  # value of x if no torque leaves its branch in the step
ROOT_PASSES, ROOT = 30, 1e-6  # passes of regula falsi; accuracy of x


class Saturation(NamedTuple):
    """Gains of the drive when it is not saturated, and scratch."""

    kp: Any  # (n,)
    kd: Any
    angles: Any  # (n,)
    rates: Any
    torque: Any
    off: Any  # distance of each torque beyond its branch [N m]; negative: on its branch
    impulse: Any  # impulse p of each torque in the rest of a step [N m s]


@inlined
def saturates(drive):
    """Whether a motor with a torque limit may saturate within a step; a sampled law's torque has no kink there."""
    least = math.inf
    for d in range(len(drive.joints)):
        least = min(least, drive.effort[d])
    return drive.rate == 0.0 and least < math.inf


@inlined
def ranges(work):
    """Whether ties may begin or cease to touch within a step."""
    if work.ties is not None:
        return work.ties.ranges[0] > 0
    return False


@shared
@entry
def choose_branches(t, drive, q, qd, springs, now):
    """Choose for every drive the branch of its torque at time t: u, E or −E; `now` are its gains and scratch."""
    unlimited_torque(drive, t, t, q, qd, now.torque)
    for d in range(len(drive.joints)):
        k, E = drive.joints[d], drive.effort[d]
        u = now.torque[k]
        drive.limits[0, d] = E if u > E else -E if u < -E else -math.inf
        drive.limits[1, d] = E if u > E else -E if u < -E else math.inf
    put_slopes(drive, springs, now)


@recursion
def put_slopes(drive, springs, now):
    """Write the gains of every drive to `springs`; 0 if it is saturated."""
    for d in range(len(drive.joints)):
        k, saturated = drive.joints[d], drive.limits[0, d] == drive.limits[1, d]
        springs.kp[k] = 0.0 if saturated else now.kp[k]
        springs.kd[k] = 0.0 if saturated else now.kd[k]


@recursion
def follow_limits(drive, springs, now):
    """In the next step, clip at ±E all torques that left their branch in the step just taken, in spite of the kinks."""
    for d in range(len(drive.joints)):
        if now.impulse[drive.joints[d]] > 0.0:
            drive.limits[0, d], drive.limits[1, d] = -drive.effort[d], drive.effort[d]
    put_slopes(drive, springs, now)


@recursion
def beyond(x, t, h, drive, state, work):
    """The largest distance of a torque beyond its branch at the fraction x of the step [N m]; writes all to `off`."""
    now, largest = work.saturation, -math.inf
    between(x, h, state, now.angles, now.rates, work)
    if work.ties is not None:
        largest = beyond_law(t + x * h, now.angles, now.rates, work)
        if not saturates(drive):
            return largest
    unlimited_torque(drive, t + x * h, t + 0.5 * h, now.angles, now.rates, now.torque)
    for d in range(len(drive.joints)):
        k, E = drive.joints[d], drive.effort[d]
        u, least, most = now.torque[k], drive.limits[0, d], drive.limits[1, d]
        now.off[k] = -math.inf  # a torque clipped at ±E has no branch to leave
        if least == -math.inf:
            now.off[k] = abs(u) - E
        elif least == most:
            now.off[k] = E - u if most > 0.0 else u + E
        largest = max(largest, now.off[k])
    return largest


@subroutine
def first_switch(t, h, drive, state, work):
    """Fraction x of the step just taken at which a torque first leaves its branch; `NEVER` if none does."""
    a, f_a = 0.0, min(0.0, beyond(0.0, t, h, drive, state, work))
    b, f_b, look, looks = 0.0, f_a, 0, OF_TIES if ranges(work) else LOOKS
    while f_b <= 0.0 and look < looks:
        look += 1
        a, f_a = b, f_b
        b = look / looks
        f_b = beyond(b, t, h, drive, state, work)
    if not f_b > 0.0:
        return NEVER
    for _ in range(ROOT_PASSES):  # the Illinois rule; at b a torque is always beyond its branch
        if b - a <= ROOT:
            break
        x = (a * f_b - b * f_a) / (f_b - f_a) if f_b < math.inf and f_a > -math.inf else 0.5 * (a + b)
        x = min(max(x, a + 0.01 * (b - a)), b - 0.01 * (b - a))
        f = beyond(x, t, h, drive, state, work)
        if f > 0.0:
            b, f_b, f_a = x, f, 0.5 * f_a
        else:
            a, f_a, f_b = x, f, 0.5 * f_b
    return b


@subroutine
def thrown_by(x, t, h, longest, drive, state, work):
    """Largest displacement [m] of a body, in any time up to `longest`, due to torque errors after the fraction x."""
    springs, now, looks = work.springs, work.saturation, OF_TIES if ranges(work) else LOOKS
    now.impulse[:] = 0.0
    for look in range(looks, 0, -1):
        if look > x * looks:
            beyond(look / looks, t, h, drive, state, work)
            if work.ties is not None:
                off = work.ties.off  # beyond the law of each row, and the largest impulse of that
                for k in range(off.shape[1]):
                    off[1, k] = max(0.0 if look == looks else off[1, k], (1.0 - x) * h * off[0, k])
            if saturates(drive):
                for k in drive.joints:
                    now.impulse[k] = max(now.impulse[k], (1.0 - x) * h * now.off[k])
    if work.ties is not None:
        for k in range(len(work.ties.rows)):
            for j in range(len(now.impulse)):
                now.impulse[j] += work.ties.J[k, j] * work.ties.off[1, k]
    if saturates(drive):
        for k in drive.joints:
            springs.kp[k] = springs.kd[k] = 0.0
    τ, largest = longest, 0.0
    while τ > h or τ == longest:
        for k in range(len(now.impulse)):
            springs.r[k] = τ * now.impulse[k]
        work.stepper[STEPPER.weighed] += 1.0
        largest = max(largest, thrown(τ, springs, work.posture, work.chain))
        τ *= CLOSER
    put_slopes(drive, springs, now)
    return largest


@recursion
def ends_at_switch(x, t, h, shortest, longest, allowed, drive, state, work):
    """Whether to repeat the step up to just after x, since later errors displace a body by more than `allowed` [m]."""
    off = thrown_by(x, t, h, longest, drive, state, work)
    if off <= allowed:
        return False
    again = (x + 0.5 * math.sqrt(allowed / off) * (1.0 - x)) * h  # δ grows with the square of the time after x
    work.stepper[STEPPER.switch] = t + again
    if again <= shortest:
        work.stepper[STEPPER.switch] = 0.0
        if saturates(drive):
            follow_limits(drive, work.springs, work.saturation)
        if work.ties is not None:
            for k in range(len(work.ties.rows)):  # rows that leave their law at once take another one from t on
                if work.ties.off[1, k] > 0.0:
                    work.ties.left[k] = t
    return True


@recursion
def beyond_law(t, q, qd, work):
    """How far the multiplier that is farthest beyond its law is beyond it [N], at a state of the step just taken."""
    ties, largest = work.ties, -math.inf
    find_at(t, q, ties.gap[0], ties, work.chain)
    for k in range(len(ties.rows)):
        v = rate(k, qd, ties)
        ties.off[0, k] = out_of_range(ties.rows[k], ties.law[k], ties.gap[0, k], v, ties.moved[0, k])
        largest = max(largest, ties.off[0, k])
    return largest
