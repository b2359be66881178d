"""Quadratic dampers of single joints, as in a hydraulic brake: T = c |q̇| q̇ resists motion; c |q̇|³ is dissipated."""

from typing import Any, NamedTuple

from flexlink.kernels.tools.compiler import kernel, recursion


class Dampers(NamedTuple):
    """Force element: one row of dtype `DAMPER` per damper."""

    rows: Any


@kernel
def dampers_of(chain):
    """The quadratic dampers of a chain, as a force element."""
    return Dampers(chain.rare.dampers)


@recursion
def damper_torque(element, q, qd, torque):
    """Add T to `torque` (n,); returns the dissipated power [W]."""
    power = 0.0
    for damper in element.rows:
        k = damper.hinge
        taken = damper.quadratic * abs(qd[k]) * qd[k]
        torque[k] += taken
        power += taken * qd[k]
    return power


@recursion
def damper_slopes(element, q, qd, by_angle, by_rate):
    """Add ∂T/∂q̇ = 2 c |q̇| to the diagonal of `by_rate` (n, n)."""
    for damper in element.rows:
        k = damper.hinge
        by_rate[k, k] += 2.0 * damper.quadratic * abs(qd[k])


@recursion
def damper_brakes(element, q, qd, brakes):
    """Add ∂T/∂q̇ = 2 c |q̇| to `brakes` (n,)."""
    for damper in element.rows:
        k = damper.hinge
        brakes[k] += 2.0 * damper.quadratic * abs(qd[k])
