"""Inputs of joints: torques of the drives by their control law, and prescribed motions.

A sampled law with rate 1/T and delay τ applies, from t_k + τ to t_k+1 + τ, the torque of its instant t_k = k T. Before
its first torque acts, the arm is taken to have been in its first state, so that torque acts from the beginning.
"""

import math

from flexlink.kernels.inputs.cascade import cascades
from flexlink.kernels.inputs.laws import CASCADE, law_torque
from flexlink.kernels.inputs.references import locate
from flexlink.kernels.tools.compiler import entry, inlined, shared
from flexlink.kernels.tools.lanes import at, put_at, zero_of

LATE = 1.0 + 8.0 * 2.0**-52  # factor that allows for rounding of time · rate, a sampling instant's number


@inlined
def stage_torque(drive, t, middle, q, qd, tau):
    """Write T_EX of the drive's law at the driven joints, within ± effort; the rest of `tau` (n,) is not changed.

    `middle` is the midpoint of the step that contains t. A sampled law applies the torque of its last instant that is
    at least its delay ago (`sample_law`).
    """
    if drive.rate > 0.0:
        last = math.floor(middle * drive.rate * LATE - drive.delay * drive.rate) % len(drive.held)
        for d in range(len(drive.joints)):
            put_at(tau, at(drive.held, last, d), drive.joints[d])
    elif len(drive.joints) > 0:
        law_torque(drive, t, middle, q, qd, tau)


@entry
def drive_torque(drive, t, middle, q, qd, tau):
    """`stage_torque` for calls from Python."""
    stage_torque(drive, t, middle, q, qd, tau)


@entry
def drive_slopes(drive, t, state, nudge, ends, slopes):
    """Write −∂T_EX/∂q and −∂T_EX/∂q̇, (2, n, d), for angle and rate of each driven joint at a `state` (2, n).

    They are central differences with step `nudge`, exact for a linear law except for rounding. `ends` (2, n), initially
    zero, receives the torques at both ends of the step.
    """
    for part in range(2):
        for d in range(len(drive.joints)):
            own = state[part, drive.joints[d]]
            for side in range(2):
                state[part, drive.joints[d]] = own + (2 * side - 1) * nudge
                drive_torque(drive, t, t, state[0], state[1], ends[side])
            state[part, drive.joints[d]] = own
            for k in range(state.shape[1]):
                slopes[part, k, d] = (ends[0, k] - ends[1, k]) / (2 * nudge)


@inlined
def sample_at_step(drive, t, middle, q, qd, tau):
    """Call `sample_law` only if the drive is sampled, so that other drives save the time to pass its record."""
    if drive.rate > 0.0:
        sample_law(drive, t, middle, q, qd, tau)


@shared
@entry
def sample_law(drive, t, middle, q, qd, tau):
    """Evaluate a sampled law at one of its instants t = k / rate, the start of a step, and store its torques.

    Other laws store nothing. `middle` is the midpoint of the step that begins at t; `tau` (n,) is scratch. The first
    torques are also those of all earlier instants.
    """
    now = int(middle * drive.rate * LATE)
    if drive.rate > 0.0 and now >= drive.next_instant[0]:
        first, row = drive.next_instant[0] == 0, now % len(drive.held)
        if drive.law >= CASCADE:
            cascades(drive, t, middle, q, qd, first, drive.held[(now - 1) % len(drive.held)], drive.held[row])
        else:
            law_torque(drive, t, middle, q, qd, tau)
            for d in range(len(drive.joints)):
                put_at(drive.held, at(tau, drive.joints[d]), row, d)
        earliest = now - len(drive.held) + 1 if first else now
        for k in range(earliest, now):
            for d in range(len(drive.joints)):
                put_at(drive.held, at(drive.held, row, d), k % len(drive.held), d)
        drive.next_instant[0] = now + 1


@entry
def follow(motion, t, q, qd, qdd):
    """Write position, rate and acceleration of the prescribed joints at time t into `q`, `qd`, `qdd` (n,)."""
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
