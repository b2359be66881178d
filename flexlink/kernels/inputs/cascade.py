"""Cascade control of a joint, as in industrial drives: P position loop, PI rate loop, filters of the torque.

At instant k, with e the rate error, u the torque before its filters, and y behind them:

    v_k = ±v_max of  k_p (r − q) + a ṙ
    e_k = v_k − q̇
    I_k = I_k−1 + k_i e_k / rate
    u_k = k_d e_k + I_k + J r̈ + g
    z_k = Φ z_k−1 + Γ u_k−1 + Ψ (u_k − u_k−1)
    y_k = C z_k + D u_k
    T_k = ±T_max of  y_k

If T_k is at its limit and e_k points beyond it, the memory keeps I_k−1 (anti-windup by conditional integration). At the
first instant, I_k−1 = 0 and z_k = S u_k, the steady state.

For each joint, `servo` contains k_i, v_max, a, J, and `filters` the rows (Φ, Γ, Ψ, S) and then (C, D, 0, 0). Its memory
is I, u, z; in each row of `held`, the memories of all joints follow the d torques.
"""

from flexlink.kernels.inputs.laws import CASCADE_GRAVITY, model_torque
from flexlink.kernels.inputs.references import reference
from flexlink.kernels.tools.compiler import entry, inlined, recursion, shared
from flexlink.kernels.tools.lanes import LANES, clip


@inlined
def cascades(drive, t, middle, q, qd, first, before, after):
    """`cascade` of one arm, or of each of eight arms side by side."""
    if q.ndim == 1:
        cascade(drive, drive.model, t, middle, q, qd, first, before, after)
    else:
        for lane in range(LANES):
            model = None if drive.model is None else drive.model[lane]
            cascade(drive, model, t, middle, q[:, lane], qd[:, lane], first, before[:, lane], after[:, lane])


@shared
@entry
def cascade(drive, model, t, middle, q, qd, first, before, after):
    """Write torques and memory of an instant to `after` (d + …,), from those `before` unless it is the `first`."""
    d, f = len(drive.joints), drive.filters.shape[1] - 1
    _feedforward(drive, model, t, middle, after)
    for i in range(d):
        k, own, F = drive.joints[i], d + i * (2 + f), drive.filters[i]
        gain, fastest, part, inertia = drive.servo[i, 0], drive.servo[i, 1], drive.servo[i, 2], drive.servo[i, 3]
        r, rate, acceleration = reference(drive.reference, t, middle, i)
        v = clip(drive.kp[i] * (r - q[k]) + part * rate, -fastest, fastest)
        e = v - qd[k]
        integral = before[own] + gain * e / drive.rate
        u = drive.kd[i] * e + integral + inertia * acceleration + after[i]
        u_before = u if first else before[own + 1]
        y = F[f, f] * u
        for row in range(f):
            z = F[row, f] * u_before + F[row, f + 1] * (u - u_before)
            for column in range(f):
                z += F[row, column] * before[own + 2 + column]
            if first:
                z = F[row, f + 2] * u
            after[own + 2 + row] = z
            y += F[f, row] * z
        after[i] = clip(y, drive.limits[0, i], drive.limits[1, i])
        beyond = (y - after[i]) * e > 0.0
        after[own] = before[own] if beyond else integral
        after[own + 1] = u


@recursion
def _feedforward(drive, model, t, middle, torque):
    """Write g to `torque` (d,): the gravity torque of the rigid model at the reference, or a table."""
    if model is not None:  # noqa: SIM102  decided by the compiler: loops for plain chains have no model
        if drive.law == CASCADE_GRAVITY:
            for i in range(len(drive.joints)):
                model.q[i], _, _ = reference(drive.reference, t, middle, i)
            model_torque(model)
            for i in range(len(drive.joints)):
                torque[i] = model.tau[i]
            return
    for i in range(len(drive.joints)):
        torque[i], _, _ = reference(drive.feedforward, t, middle, i)
