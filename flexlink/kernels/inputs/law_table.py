"""T_EX = Σ_j c_j x^j at the driven joints, x = time since the last knot, whatever the arm does.

Torques that are held jump at their knots: the piece of a step is then that of its middle, so that a stage at the end of
the step does not see what follows.
"""

from typing import Any, NamedTuple

from flexlink.kernels.inputs.references import locate
from flexlink.kernels.tools.compiler import entry
from flexlink.kernels.tools.lanes import put_at, zero_of


class TableLaw(NamedTuple):
    """Torques of d driven joints in time."""

    joints: Any  # (d,)
    effort: Any  # (d,) largest torque [N m]
    knots: Any  # (m,) [s]
    coefficients: Any  # (m, order + 1, d) [N m / s^j]


@entry
def table_torque(law, t, middle, q, qd, tau):
    """Write T_EX to `tau` (n,); see `drive_torque`."""
    held = law.coefficients.shape[1] == 1
    piece = locate(law.knots, 0, len(law.knots), middle if held else t)
    x = max(0.0, t - law.knots[piece])
    c = law.coefficients[piece]
    for d in range(len(law.joints)):
        torque = 0.0
        for j in range(len(c) - 1, -1, -1):
            torque = torque * x + c[j, d]
        put_at(tau, zero_of(q) + torque, law.joints[d])
