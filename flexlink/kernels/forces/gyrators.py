"""Gyrators between two hinges: T_i = g q̇_j and T_j = −g q̇_i, which together dissipate no power.

A force law with an internal state is a gyrator between its joint and an internal coordinate, whose rate is the state.
The internal coordinate is a hinge with a rotor and no body. Example: viscous friction d that lags behind the rate by
the time constant τ, as in a damper in series with a spring. The state ζ of this law is the rate of a hinge with rotor
inertia d τ and damping d, connected to the joint by a gyrator with g = d:

    T = d ζ        d τ ζ̇ = d q̇ − d ζ
"""

from flexlink.kernels.tools.compiler import recursion


@recursion
def gyrator_torque(rows, q, qd, torque):
    """Add T to `torque` (n,); returns the dissipated power, 0."""
    for gyrator in rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        torque[i] += g * qd[j]
        torque[j] -= g * qd[i]
    return 0.0


@recursion
def gyrator_slopes(rows, q, qd, by_angle, by_rate):
    """Add g and −g to ∂T/∂q̇, `by_rate` (n, n)."""
    for gyrator in rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        by_rate[i, j] += g
        by_rate[j, i] -= g
