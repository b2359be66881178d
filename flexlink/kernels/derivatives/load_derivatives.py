"""Slopes of T_GC along every angle and every rate, without a step size.

Along one angle every torque of a chain is a trigonometric polynomial of degree 2 at most, for which M. Riesz's
interpolation formula is exact, and along the rates it is a quadratic, for which the central difference is.

    f'(q) = Σ_k (−1)^(k+1) / (4 d sin²(x_k/2)) f(q + x_k),   x_k = (2k − 1) π / 2d,   k = 1 … 2d,   d = 2

Degree 2: q_j turns all bodies beyond hinge j, so that M(q) = Σ JᵀmJ + Jᵀ R I Rᵀ J contains cos q_j and sin q_j at most
twice; its derivatives (T_GC) do not raise the degree; T_G and Jᵀ w are of degree 1, with a follower wrench of degree 2.
Along a slide, which puts q_j into J once, every torque is a polynomial of degree 2 at most: there, too, the central
difference is exact, and loses no digits over a way as long as the arm.
"""

import math

import numpy as np

from flexlink.kernels.bodies.branches import loaded_body
from flexlink.kernels.bodies.kinematics import forward_kinematics
from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import inlined, kernel
from flexlink.kernels.tools.vec3 import apply, dot, put, vector


@kernel
def add_load_stiffness(chain, wrench, follower, q, qd, K):
    """K += ∂T_GC/∂q (n, n) at constant rates; wrench (6,) in frame 0, or, a follower, in axes of the tip frame."""
    n = len(q)
    zero, torque, moved, work = np.zeros(n), np.empty(n), q.copy(), rne_workspace(chain)
    length = arm_length(chain.bodies)
    for j in range(n):
        slides = chain.hinges[j].axis >= SLIDES
        for m in range(2 if slides else 4):
            shift, weight = along_slide(m, length) if slides else along_turn(m)
            moved[j] = q[j] + shift
            acting = turned_with_tip(chain, wrench, moved) if follower else wrench
            rne(chain, vector(chain.gravity), acting, moved, qd, zero, torque, work)
            for i in range(n):  # rounded before it is added, also where a product and a sum are one instruction
                torque[i] *= weight
            for i in range(n):
                K[i, j] += torque[i]
        moved[j] = q[j]


@inlined
def along_turn(m):
    """One of the four shifts of Riesz's formula, and its weight."""
    shift = (2 * m + 1) * math.pi / 4.0
    return shift, (1.0 if m % 2 == 0 else -1.0) / (8.0 * math.sin(0.5 * shift) ** 2)


@inlined
def along_slide(m, length):
    """One of the two of the central difference."""
    shift = length if m == 0 else -length
    return shift, 0.5 / shift


@kernel
def arm_length(bodies):
    """How far along all bodies [m], 1 where that is nothing: what a slide by as much compares with a turn by 1 rad."""
    length = 0.0
    for i in range(len(bodies)):
        r = vector(bodies[i].translation)
        length += math.sqrt(dot(r, r))
    return length if length > 0.0 else 1.0


@kernel
def turned_with_tip(chain, wrench, q):
    """A wrench (6,) given in axes of the tip frame that it acts on, in frame 0."""
    tip, turned = forward_kinematics(chain, q).rotations[loaded_body(chain.bodies)], np.empty(6)
    put(turned[:3], apply(tip, vector(wrench)))
    put(turned[3:], apply(tip, vector(wrench[3:])))
    return turned


@kernel
def add_gyroscopic(chain, q, qd, G):
    """G += ∂T_GC/∂q̇ (n, n) of an arm that moves; at rest it is 0."""
    n, length = len(q), arm_length(chain.bodies)
    unit = 0.0  # same size as the rates: no cancellation
    for i in range(n):
        unit = max(unit, abs(qd[i]) / (length if chain.hinges[i].axis >= SLIDES else 1.0))
    zero, wrench, work = np.zeros(n), np.zeros(6), rne_workspace(chain)
    ahead, behind, moved = np.empty(n), np.empty(n), qd.copy()
    for j in range(n):
        step = unit * length if chain.hinges[j].axis >= SLIDES else unit
        moved[j] = qd[j] + step
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, ahead, work)
        moved[j] = qd[j] - step
        rne(chain, vector(chain.gravity), wrench, q, moved, zero, behind, work)
        moved[j] = qd[j]
        for i in range(n):
            G[i, j] += (ahead[i] - behind[i]) / (2.0 * step)
