"""Computed torque on the rigid model: T_EX = M(q) (r̈ + k_d (ṙ − q̇) + k_p (r − q)) + T_GC(q, q̇), q the driven joints'.

Of an arm that is as rigid as its model the errors e = r − q go by ë + k_d ė + k_p e = 0 (Siciliano et al. 2009, section
8.5.2).
"""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rigid_model import model_torque
from flexlink.kernels.inputs.references import reference
from flexlink.kernels.tools.compiler import entry


class ComputedTorqueLaw(NamedTuple):
    """Gains, reference and model of d driven joints."""

    joints: Any  # (d,)
    effort: Any  # (d,) largest torque [N m]
    reference: Any  # knots (m,) and coefficients (m, p + 1, d) [rad / s^j]
    kp: Any  # (d,) [1/s²]
    kd: Any  # (d,) [1/s]
    model: Any


@entry
def computed_torque(law, t, middle, q, qd, tau):
    """Write T_EX to `tau` (n,); see `drive_torque`."""
    model = law.model
    for d in range(len(law.joints)):
        k = law.joints[d]
        r, rate, acceleration = reference(law.reference, t, middle, d)
        model.q[d], model.qd[d] = q[k], qd[k]
        model.qdd[d] = acceleration + law.kd[d] * (rate - qd[k]) + law.kp[d] * (r - q[k])
    model_torque(model)
    for d in range(len(law.joints)):
        tau[law.joints[d]] = model.tau[d]
