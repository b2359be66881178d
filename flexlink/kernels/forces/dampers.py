"""Quadratic dampers of single joints, as of a hydraulic brake: T = c |q̇| q̇ resists, and c |q̇|³ ≥ 0 is lost."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.tools.compiler import kernel, recursion


class Dampers(NamedTuple):
    """Force element: c of every joint."""

    c: Any  # (n,) [N m s²/rad²]


@kernel
def dampers_of(chain):
    """Those of a chain."""
    c = np.zeros(len(chain.hinges))
    for damper in chain.rare.dampers:
        c[damper.hinge] += damper.quadratic
    return Dampers(c)


@recursion
def damper_torque(element, q, qd, torque):
    """Add T to `torque` (n,); returns the power that is lost [W]."""
    power = 0.0
    for k in range(len(torque)):
        taken = element.c[k] * abs(qd[k]) * qd[k]
        torque[k] += taken
        power += taken * qd[k]
    return power


@recursion
def damper_slopes(element, q, qd, by_angle, by_rate):
    """Add ∂T/∂q̇ = 2 c |q̇| to the diagonal of (n, n)."""
    for k in range(len(qd)):
        by_rate[k, k] += 2.0 * element.c[k] * abs(qd[k])


@recursion
def damper_brakes(element, q, qd, brakes):
    """Add the same to (n,)."""
    for k in range(len(qd)):
        brakes[k] += 2.0 * element.c[k] * abs(qd[k])
