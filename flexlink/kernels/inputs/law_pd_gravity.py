"""T_EX = k_p (r − q) + k_d (ṙ − q̇) + T_G(r) at the driven joints, T_G that of the rigid model at the reference r."""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rigid_model import model_torque
from flexlink.kernels.inputs.references import reference
from flexlink.kernels.tools.compiler import entry


class GravityPdLaw(NamedTuple):
    """Gains, reference and model of d driven joints."""

    joints: Any  # (d,)
    effort: Any  # (d,) largest torque [N m]
    reference: Any  # knots (m,) and coefficients (m, p + 1, d) [rad / s^j]
    kp: Any  # (d,) [N m/rad]
    kd: Any  # (d,) [N m s/rad]
    model: Any  # at rest


@entry
def pd_gravity_torque(law, t, middle, q, qd, tau):
    """Write T_EX to `tau` (n,); see `drive_torque`."""
    model = law.model
    for d in range(len(law.joints)):
        k = law.joints[d]
        r, rate, _ = reference(law.reference, t, middle, d)
        model.q[d] = r
        tau[k] = law.kp[d] * (r - q[k]) + law.kd[d] * (rate - qd[k])
    model_torque(model)
    for d in range(len(law.joints)):
        tau[law.joints[d]] += model.tau[d]
