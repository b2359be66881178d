"""Gyrators between two hinges: T_i = g q̇_j and T_j = −g q̇_i, which lose no power together.

A force law with a state of its own is a gyrator between its joint and an internal coordinate, whose rate is the state:
a hinge with a rotor that carries nothing. Viscous friction d that lags by τ behind the rate, as of a damper in series
with a spring, with the state ζ, has g = d, a rotor d τ and a damper d:

    T = d ζ        d τ ζ̇ = d q̇ − d ζ
"""

from typing import Any, NamedTuple

from flexlink.kernels.tools.compiler import kernel, recursion


class Gyrators(NamedTuple):
    """Force element: rows of dtype `GYRATOR`."""

    rows: Any


@kernel
def gyrators_of(chain):
    """Those of a chain."""
    return Gyrators(chain.rare.gyrators)


@recursion
def gyrator_torque(element, q, qd, torque):
    """Add T to `torque` (n,); no power is lost."""
    for gyrator in element.rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        torque[i] += g * qd[j]
        torque[j] -= g * qd[i]
    return 0.0


@recursion
def gyrator_slopes(element, q, qd, by_angle, by_rate):
    """Add g and −g to ∂T/∂q̇ (n, n)."""
    for gyrator in element.rows:
        i, j, g = gyrator.inner, gyrator.outer, gyrator.gyration
        by_rate[i, j] += g
        by_rate[j, i] -= g
