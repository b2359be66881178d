"""What the driven and the prescribed joints are asked for in time: drive torques by a law, prescribed motions."""

from flexlink.kernels.inputs.laws import law_torque
from flexlink.kernels.inputs.references import locate
from flexlink.kernels.tools.compiler import entry, inlined
from flexlink.kernels.tools.lanes import put_at, zero_of

LATE = 1.0 + 8.0 * 2.0**-52  # an instant's number by its time, which is off by less


@inlined
def stage_torque(drive, t, middle, q, qd, tau):
    """Write T_EX at the driven joints by the drive's law, within ± effort; `tau` (n,) stays as it is elsewhere.

    `middle` of the step that t belongs to. A sampled law gives what it gave at its last instant (`sample_law`).
    """
    if drive.rate > 0.0:
        last = int(middle * drive.rate * LATE) % len(drive.held)
        for d in range(len(drive.joints)):
            tau[drive.joints[d]] = drive.held[last, d]
    elif len(drive.joints) > 0:
        law_torque(drive, t, middle, q, qd, tau)


@entry
def drive_torque(drive, t, middle, q, qd, tau):
    """`stage_torque` for Python."""
    stage_torque(drive, t, middle, q, qd, tau)


@entry
def drive_slopes(drive, t, state, nudge, ends, slopes):
    """−∂T_EX/∂q and −∂T_EX/∂q̇ (2, n, d) by the angle and rate of each driven joint, at q and q̇ of a `state` (2, n).

    By central differences, a `nudge` to either side, which are exact for a linear law but for rounding; `ends` (2, n)
    are the torques there, zero before.
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
    """`sample_law`, whose record is handed over only where there is an instant."""
    if drive.rate > 0.0:
        sample_law(drive, t, middle, q, qd, tau)


@entry
def sample_law(drive, t, middle, q, qd, tau):
    """At an instant t = k / rate of a sampled law, the start of a step, hold what it gives; of others nothing is held.

    `middle` of the step that begins at t; scratch `tau` (n,).
    """
    now = int(middle * drive.rate * LATE)
    if q.ndim == 1:  # noqa: SIM102  to the compiler; arms side by side have no sampled law
        if drive.rate > 0.0 and now >= drive.next_instant[0]:
            law_torque(drive, t, middle, q, qd, tau)
            for d in range(len(drive.joints)):
                drive.held[now % len(drive.held), d] = tau[drive.joints[d]]
            drive.next_instant[0] = now + 1


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
