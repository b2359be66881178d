"""Explicit Runge-Kutta with fixed step for q̈ = f(t, q, q̇), the paper's equations 5 to 12, whole loop compiled.

    L_i = q̇ + h Σ_j<i a_ij K_j        K_i = f(t + c_i h, q + h Σ_j<i a_ij L_j, L_i)
    q ← q + h Σ b_i L_i               q̇ ← q̇ + h Σ b_i K_i
"""

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.forward import forward_dynamics, forward_workspace
from flexlink.kernels.inputs import drive_torque, follow


@kernel
def integrate(chain, solver, tableau, drive, motion, wrench, h, first_step, steps_per_sample, qs, qds):
    """Fill rows 1 … of `qs`, `qds` (samples, n) from row 0, at step number `first_step`.

    Returns the number of steps done; it is smaller than asked for if the state left the finite numbers, and then
    the row of that sample holds the last, non-finite state.
    """
    A, b, c = tableau
    stages, n = len(c), len(chain.hinges)
    q, qd = qs[0].copy(), qds[0].copy()
    q_stage, tau = np.empty(n), np.zeros(n)
    K, L = np.empty((stages, n)), np.empty((stages, n))
    work = forward_workspace(chain, solver)
    done = 0
    for row in range(1, len(qs)):
        for _ in range(steps_per_sample):
            t = (first_step + done) * h
            for i in range(stages):
                q_stage[:] = q
                L[i] = qd
                for j in range(i):
                    a = A[i, j] * h
                    if a != 0.0:
                        for k in range(n):
                            q_stage[k] += a * L[j, k]
                            L[i, k] += a * K[j, k]
                follow(motion, t + c[i] * h, q_stage, L[i], K[i])
                drive_torque(drive, t + c[i] * h, q_stage, L[i], tau)
                forward_dynamics(chain, solver, wrench, q_stage, L[i], tau, K[i], work)
            total = 0.0
            for i in range(stages):
                for k in range(n):
                    q[k] += b[i] * h * L[i, k]
                    qd[k] += b[i] * h * K[i, k]
            follow(motion, (first_step + done + 1) * h, q, qd, K[0])
            for k in range(n):
                total += q[k] - q[k] + qd[k] - qd[k]  # 0 if finite, nan otherwise
            done += 1
            if total != 0.0:
                qs[row], qds[row] = q, qd
                return done
        qs[row], qds[row] = q, qd
    return done
