"""T_EX = k_p (r − q) + k_d (ṙ − q̇) + g at the driven joints, towards a reference r, with a feed-forward g in time."""

from typing import Any, NamedTuple

from flexlink.kernels.inputs.references import reference
from flexlink.kernels.tools.compiler import entry
from flexlink.kernels.tools.lanes import at, put_at


class PdLaw(NamedTuple):
    """Gains, reference and feed-forward of d driven joints."""

    joints: Any  # (d,)
    effort: Any  # (d,) largest torque [N m]
    reference: Any  # knots (m,) and coefficients (m, p + 1, d) [rad / s^j]
    kp: Any  # (d,) [N m/rad]
    kd: Any  # (d,) [N m s/rad]
    gravity: Any  # g, in the form of a reference [N m / s^j]


@entry
def pd_torque(law, t, middle, q, qd, tau):
    """Write T_EX to `tau` (n,); see `drive_torque`."""
    for d in range(len(law.joints)):
        k = law.joints[d]
        r, rate, _ = reference(law.reference, t, middle, d)
        g, _, _ = reference(law.gravity, t, middle, d)
        put_at(tau, law.kp[d] * (r - at(q, k)) + law.kd[d] * (rate - at(qd, k)) + g, k)
