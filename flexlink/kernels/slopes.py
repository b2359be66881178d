"""Slopes of T_GC along every angle and every rate, exact without a step size (see `flexlink.tangent`)."""

import math

import numpy as np

from flexlink.kernels.compiler import kernel
from flexlink.kernels.rne import rne, rne_workspace
from flexlink.kernels.vec3 import vector


@kernel
def add_load_stiffness(chain, wrench, q, qd, K):
    """K += ∂T_GC/∂q (n, n), wrench (6,) dead, by M. Riesz's formula for trigonometric polynomials of degree 2."""
    n = len(q)
    zero, torque, moved, work = np.zeros(n), np.empty(n), q.copy(), rne_workspace(chain)
    for j in range(n):
        for m in range(4):
            shift = (2 * m + 1) * math.pi / 4.0
            weight = (1.0 if m % 2 == 0 else -1.0) / (8.0 * math.sin(0.5 * shift) ** 2)
            moved[j] = q[j] + shift
            rne(chain, vector(chain.gravity), wrench, moved, qd, zero, torque, work)
            K[:, j] += weight * torque
        moved[j] = q[j]


@kernel
def add_gyroscopic(chain, q, qd, G):
    """G += ∂T_GC/∂q̇ (n, n): T_GC is quadratic in the rates, for which the central difference is exact."""
    n = len(q)
    unit = np.max(np.abs(qd))  # same size as the rates: no cancellation
    zero, wrench, work = np.zeros(n), np.zeros(6), rne_workspace(chain)
    ahead, behind, moved = np.empty(n), np.empty(n), qd.copy()
    for j in range(n):
        moved[j] = qd[j] + unit
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, ahead, work)
        moved[j] = qd[j] - unit
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, behind, work)
        moved[j] = qd[j]
        G[:, j] += (ahead - behind) / (2.0 * unit)
