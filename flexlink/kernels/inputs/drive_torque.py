"""What acts on a run in time: drive torques by a law, continuous or sampled, and prescribed joint motions.

The type of the drive says which law it is, so that machine code is made for the one in use only.
"""

from typing import Any, NamedTuple

from numba.extending import overload

from flexlink.kernels.inputs.law_computed_torque import ComputedTorqueLaw, computed_torque
from flexlink.kernels.inputs.law_pd import PdLaw, pd_torque
from flexlink.kernels.inputs.law_pd_gravity import GravityPdLaw, pd_gravity_torque
from flexlink.kernels.inputs.law_table import TableLaw, table_torque
from flexlink.kernels.inputs.references import locate
from flexlink.kernels.tools.compiler import INLINED, entry
from flexlink.kernels.tools.lanes import at, clipped, put_at, zero_of

LATE = 1.0 + 8.0 * 2.0**-52  # an instant's number by its time, which is off by less


class SampledLaw(NamedTuple):
    """A law that is asked at instants t = k / rate, and held in between."""

    law: Any
    joints: Any  # (d,) of the law
    effort: Any  # (d,) of the law
    rate: Any  # [Hz]
    held: Any  # (m, d) what the last m instants gave [N m]
    asked: Any  # (1,) number of the instant that comes next


@entry
def sampled_torque(drive, t, middle, q, qd, tau):
    """Write what is held to `tau` (n,); see `drive_torque`."""
    row = int(middle * drive.rate * LATE) % len(drive.held)
    for d in range(len(drive.joints)):
        tau[drive.joints[d]] = drive.held[row, d]


LAWS = {
    TableLaw: table_torque,
    PdLaw: pd_torque,
    GravityPdLaw: pd_gravity_torque,
    ComputedTorqueLaw: computed_torque,
    SampledLaw: sampled_torque,
}  # by the type of their arrays


@entry
def limit(drive, tau):
    """Keep T_EX within ± effort."""
    for d in range(len(drive.joints)):
        k = drive.joints[d]
        put_at(tau, clipped(at(tau, k), drive.effort[d]), k)


def drive_torque(drive: Any, t: float, middle: float, q: Any, qd: Any, tau: Any) -> None:
    """Write T_EX at the driven joints by the drive's law, within ± effort; `tau` (n,) stays as it is elsewhere.

    `middle` of the step that t belongs to.
    """
    LAWS[type(drive)](drive, t, middle, q, qd, tau)
    limit(drive, tau)


@overload(drive_torque, jit_options=INLINED)
def _drive_torque(drive, t, middle, q, qd, tau):
    law = LAWS[drive.instance_class]

    def torque(drive, t, middle, q, qd, tau):
        law(drive, t, middle, q, qd, tau)
        limit(drive, tau)

    return torque


def ask(drive: Any, t: float, middle: float, q: Any, qd: Any, tau: Any) -> None:
    """At an instant of a sampled law, the start of a step, hold what it gives; of others nothing is held.

    `middle` of the step that begins at t; scratch `tau` (n,).
    """
    if type(drive) is SampledLaw and int(middle * drive.rate * LATE) >= drive.asked[0]:
        drive_torque(drive.law, t, middle, q, qd, tau)
        hold(drive, middle, tau)


@overload(ask, jit_options=INLINED)
def _ask(drive, t, middle, q, qd, tau):
    if drive.instance_class is not SampledLaw:
        return lambda drive, t, middle, q, qd, tau: None

    def at_instants(drive, t, middle, q, qd, tau):
        if int(middle * drive.rate * LATE) >= drive.asked[0]:
            drive_torque(drive.law, t, middle, q, qd, tau)
            hold(drive, middle, tau)

    return at_instants


@entry
def hold(drive, middle, tau):
    """Hold the torques of the driven joints, from the instant before `middle` to the next."""
    now = int(middle * drive.rate * LATE)
    for d in range(len(drive.joints)):
        drive.held[now % len(drive.held), d] = tau[drive.joints[d]]
    drive.asked[0] = now + 1


@entry
def follow(motion, t, q, qd, qdd):
    """Put angle, rate and acceleration of the prescribed joints at time t into `q`, `qd`, `qdd` (n,)."""
    for m in range(len(motion.joints)):
        k = motion.joints[m]
        piece = locate(motion.knots, motion.first[m], motion.first[m + 1], t)
        x = max(0.0, t - motion.knots[piece])
        c = motion.coefficients[piece]
        angle, rate, half_acceleration = 0.0, 0.0, 0.0
        for j in range(len(c) - 1, -1, -1):  # Horner's scheme for the value and its first two derivatives
            half_acceleration = half_acceleration * x + rate
            rate = rate * x + angle
            angle = angle * x + c[j]
        o = zero_of(q)
        put_at(q, o + angle, k)
        put_at(qd, o + rate, k)
        put_at(qdd, o + 2.0 * half_acceleration, k)
