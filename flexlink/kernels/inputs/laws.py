"""Control laws of the d driven joints. r(t) is the reference, g(t) a torque table, T_G and M belong to a rigid model.

    TABLE               T_EX = g(t)
    PD                  T_EX = k_p (r − q) + k_d (ṙ − q̇) + g(t)
    PD_GRAVITY          T_EX = k_p (r − q) + k_d (ṙ − q̇) + T_G(r)
    COMPUTED_TORQUE     T_EX = M(q) (r̈ + k_d (ṙ − q̇) + k_p (r − q)) + T_GC(q, q̇), q of the driven joints
    CASCADE, …_GRAVITY  has a memory, and is evaluated at sampling instants only (`cascade`)

If the arm is as rigid as its model, computed torque gives the error dynamics ë + k_d ė + k_p e = 0 with e = r − q
(Siciliano et al. 2009, section 8.5.2).

Piecewise constant torques jump at their knots. A step uses the piece at its midpoint, so a stage at the end of the step
is not affected by a jump there.
"""

from typing import Any, NamedTuple

from flexlink.kernels.bodies.rne import rne
from flexlink.kernels.inputs.references import locate, reference
from flexlink.kernels.tools.compiler import inlined, subroutine
from flexlink.kernels.tools.lanes import LANES, at, clipped, put_at, zero_of
from flexlink.kernels.tools.vec3 import vector

TABLE, PD, PD_GRAVITY, COMPUTED_TORQUE, CASCADE, CASCADE_GRAVITY = range(6)


class RigidModel(NamedTuple):
    """Model of the arm for its controller, one rigid link outboard of every driven joint: d hinges; motion, torques."""

    chain: Any
    rne: Any
    wrench: Any  # (6,) zeros
    q: Any  # (d,), like the next three
    qd: Any
    qdd: Any
    tau: Any


@inlined
def model_torque(model):
    """Write τ = M q̈ + T_GC of the model, for its q, q̇ and q̈."""
    gravity = vector(model.chain.gravity)
    rne(model.chain, gravity, model.wrench, model.q, model.qd, model.qdd, model.tau, model.rne)


@inlined
def law_torque(drive, t, middle, q, qd, tau):
    """Write T_EX at the driven joints to `tau` (n,), within the limits, at time t of a step with midpoint `middle`.

    It is inlined because passing the record of a drive takes longer than evaluating most laws.
    """
    unlimited_torque(drive, t, middle, q, qd, tau)
    for d in range(len(drive.joints)):
        k = drive.joints[d]
        put_at(tau, clipped(at(tau, k), drive.limits[0, d], drive.limits[1, d]), k)


@inlined
def unlimited_torque(drive, t, middle, q, qd, tau):
    """`law_torque` without torque limits."""
    joints, g = drive.joints, drive.feedforward
    if drive.law == TABLE:
        held = g.coefficients.shape[1] == 1
        piece = locate(g.knots, 0, len(g.knots), middle if held else t)
        x = max(0.0, t - g.knots[piece])
        c = g.coefficients[piece]
        for d in range(len(joints)):
            torque = 0.0
            for j in range(len(c) - 1, -1, -1):
                torque = torque * x + c[j, d]
            put_at(tau, zero_of(q) + torque, joints[d])
    elif drive.law == PD:
        for d in range(len(joints)):
            k = joints[d]
            r, rate, _ = reference(drive.reference, t, middle, d)
            torque, _, _ = reference(g, t, middle, d)
            put_at(tau, drive.kp[d] * (r - at(q, k)) + drive.kd[d] * (rate - at(qd, k)) + torque, k)
    elif drive.model is not None:
        torques_by_model(drive, t, middle, q, qd, tau)


@subroutine
def torques_by_model(drive, t, middle, q, qd, tau):
    """Write T_EX of a law that uses the rigid model; arms side by side have a tuple of models."""
    if q.ndim == 1:
        torques_of_one(drive, drive.model, t, middle, q, qd, tau)
    else:
        for lane in range(LANES):
            torques_of_one(drive, drive.model[lane], t, middle, q[:, lane], qd[:, lane], tau[:, lane])


@inlined
def torques_of_one(drive, model, t, middle, q, qd, tau):
    """`torques_by_model` of one arm."""
    computed = drive.law == COMPUTED_TORQUE
    for d in range(len(drive.joints)):
        k = drive.joints[d]
        r, rate, acceleration = reference(drive.reference, t, middle, d)
        if computed:
            model.q[d], model.qd[d] = q[k], qd[k]
            model.qdd[d] = acceleration + drive.kd[d] * (rate - qd[k]) + drive.kp[d] * (r - q[k])
        else:
            model.q[d] = r
            tau[k] = drive.kp[d] * (r - q[k]) + drive.kd[d] * (rate - qd[k])
    model_torque(model)
    for d in range(len(drive.joints)):
        k = drive.joints[d]
        tau[k] = model.tau[d] if computed else tau[k] + model.tau[d]
