"""What is given in time: drive torques and prescribed joint motions, as piecewise polynomials.

On piece i, from knot i to the next, value = Σ_j c_ij x^j with x = t − knot_i; before the first knot x = 0, and the last
piece goes on for ever. Torques that are held jump at their knots: the piece of a step is then that of its middle, so
that a stage at the end of the step does not see what follows.
"""

from flexlink.kernels.compiler import entry, recursion
from flexlink.kernels.lanes import at, put_at, zero_of


@recursion
def locate(knots, first, stop, t):
    """Number of the piece that holds time t, among pieces first … stop − 1, by bisection."""
    low, high = first, stop
    while high - low > 1:
        middle = (low + high) // 2
        if knots[middle] <= t:
            low = middle
        else:
            high = middle
    return low


@entry
def drive_torque(drive, t, middle, q, qd, tau):
    """T_EX = table(t) + kp (target − q) − kd q̇ at the driven joints; `tau` (n,) stays as it is elsewhere.

    `middle` of the step that t belongs to.
    """
    held = drive.coefficients.shape[1] == 1
    piece = locate(drive.knots, 0, len(drive.knots), middle if held else t)
    x = max(0.0, t - drive.knots[piece])
    c = drive.coefficients[piece]
    for d in range(len(drive.joints)):
        k = drive.joints[d]
        torque = 0.0
        for j in range(len(c) - 1, -1, -1):
            torque = torque * x + c[j, d]
        put_at(tau, torque + drive.kp[d] * (drive.target[d] - at(q, k)) - drive.kd[d] * at(qd, k), k)


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
