"""Explicit Runge-Kutta with fixed step for q̈ = f(t, q, q̇), the paper's equations 5 to 12, whole loop compiled.

L_i = q̇ + h Σ_j<i a_ij K_j        K_i = f(t + c_i h, q + h Σ_j<i a_ij L_j, L_i)
q ← q + h Σ b_i L_i               q̇ ← q̇ + h Σ b_i K_i
"""

import numpy as np

from flexlink.kernels.compiler import inlined, kernel, recursion
from flexlink.kernels.finite import is_finite
from flexlink.kernels.forward import forward_dynamics
from flexlink.kernels.inputs import drive_torque, follow
from flexlink.kernels.lanes import at, put_at


@kernel
def integrate(chain, work, tableau, drive, motion, wrench, h, first_step, steps_per_sample, qs, qds):
    """Fill rows 1 … of `qs`, `qds` (samples, n) from row 0, at step number `first_step`, with scratch of a solver.

    Returns the number of steps done; it is smaller than asked for if the state left the finite numbers, and then
    the row of that sample holds the last, non-finite state. With scratch of eight chains side by side the states are
    (samples, n, 8), and the first chain that leaves the finite numbers stops all.
    """
    q, qd = qs[0].copy(), qds[0].copy()
    stages = np.empty((2, len(tableau[2]), *q.shape))
    K, L = stages[0], stages[1]
    q_stage, tau = np.empty_like(q), np.zeros_like(q)
    done = 0
    for row in range(1, len(qs)):
        for _ in range(steps_per_sample):
            step(chain, work, tableau, drive, motion, wrench, h, first_step + done, q, qd, q_stage, tau, K, L)
            done += 1
            if not (is_finite(q) and is_finite(qd)):
                qs[row], qds[row] = q, qd
                return done
        qs[row], qds[row] = q, qd
    return done


@recursion
def step(chain, work, tableau, drive, motion, wrench, h, number, q, qd, q_stage, tau, K, L):
    """Advance q and q̇ (n,) from t = number · h by h."""
    A, b, c = tableau
    for i in range(len(c)):
        t = (number + c[i]) * h
        q_dot, q_dot_dot = L[i], K[i]
        for k in range(len(q)):
            put_at(q_stage, at(q, k), k)
            put_at(q_dot, at(qd, k), k)
        for j in range(i):
            add_stage(A[i, j] * h, L, K, j, q_stage, q_dot)
        follow(motion, t, q_stage, q_dot, q_dot_dot)
        drive_torque(drive, t, q_stage, q_dot, tau)
        forward_dynamics(chain, wrench, q_stage, q_dot, tau, q_dot_dot, work)
    for i in range(len(c)):
        add_stage(b[i] * h, L, K, i, q, qd)
    follow(motion, (number + 1) * h, q, qd, K[0])


@inlined
def add_stage(weight, L, K, i, q, qd):
    """q += weight L_i and q̇ += weight K_i; nothing to do for the many zeros of high-order tableaus."""
    if weight != 0.0:
        for k in range(len(q)):
            put_at(q, at(q, k) + weight * at(L, i, k), k)
            put_at(qd, at(qd, k) + weight * at(K, i, k), k)
