"""Slopes of T_GC along every angle and every rate, without a step size.

Along one angle every torque of a chain is a trigonometric polynomial of degree 2 at most, for which M. Riesz's
interpolation formula is exact, and along the rates it is a quadratic, for which the central difference is.

    f'(q) = Σ_k (−1)^(k+1) / (4 d sin²(x_k/2)) f(q + x_k),   x_k = (2k − 1) π / 2d,   k = 1 … 2d,   d = 2

Degree 2: q_j turns all bodies beyond hinge j, so that M(q) = Σ JᵀmJ + Jᵀ R I Rᵀ J contains cos q_j and sin q_j at most
twice; its derivatives (T_GC) do not raise the degree; T_G and Jᵀ w are of degree 1, with a follower wrench of degree 2.
"""

import math

import numpy as np

from flexlink.kernels.bodies.kinematics import forward_kinematics
from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.tools.compiler import kernel
from flexlink.kernels.tools.vec3 import apply, put, vector


@kernel
def add_load_stiffness(chain, wrench, follower, q, qd, K):
    """K += ∂T_GC/∂q (n, n) at constant rates; wrench (6,) in frame 0, or, a follower, in axes of the tip frame."""
    n = len(q)
    zero, torque, moved, work = np.zeros(n), np.empty(n), q.copy(), rne_workspace(chain)
    for j in range(n):
        for m in range(4):
            shift = (2 * m + 1) * math.pi / 4.0
            weight = (1.0 if m % 2 == 0 else -1.0) / (8.0 * math.sin(0.5 * shift) ** 2)
            moved[j] = q[j] + shift
            acting = turned_with_tip(chain, wrench, moved) if follower else wrench
            rne(chain, vector(chain.gravity), acting, moved, qd, zero, torque, work)
            for i in range(n):  # rounded before it is added, also where a product and a sum are one instruction
                torque[i] *= weight
            for i in range(n):
                K[i, j] += torque[i]
        moved[j] = q[j]


@kernel
def turned_with_tip(chain, wrench, q):
    """A wrench (6,) given in axes of the tip frame, in frame 0."""
    tip, turned = forward_kinematics(chain, q).rotations[-1], np.empty(6)
    put(turned[:3], apply(tip, vector(wrench)))
    put(turned[3:], apply(tip, vector(wrench[3:])))
    return turned


@kernel
def add_gyroscopic(chain, q, qd, G):
    """G += ∂T_GC/∂q̇ (n, n) of an arm that moves; at rest it is 0."""
    n = len(q)
    unit = 0.0  # same size as the rates: no cancellation
    for i in range(n):
        unit = max(unit, abs(qd[i]))
    zero, wrench, work = np.zeros(n), np.zeros(6), rne_workspace(chain)
    ahead, behind, moved = np.empty(n), np.empty(n), qd.copy()
    for j in range(n):
        moved[j] = qd[j] + unit
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, ahead, work)
        moved[j] = qd[j] - unit
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, behind, work)
        moved[j] = qd[j]
        for i in range(n):
            G[i, j] += (ahead[i] - behind[i]) / (2.0 * unit)
