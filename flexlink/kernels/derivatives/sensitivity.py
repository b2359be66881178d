"""A run of an explicit Runge-Kutta method and its derivatives along parameters, differentiated stage by stage.

With δ = ∂/∂p of the numbers that `runge_kutta.step` gives, for every parameter p,

    δL_i = δq̇ + h Σ_j<i a_ij δK_j         δq_i = δq + h Σ_j<i a_ij δL_j
    δK_i = ∂q̈/∂q δq_i + ∂q̈/∂q̇ δL_i + M⁻¹ (δT_EX − δ(M q̈ + T_GC + T_FL + T_FR))        the last at constant q, q̇, q̈
    δq ← δq + h Σ b_i δL_i                δq̇ ← δq̇ + h Σ b_i δK_i

The torques of the drive are affine, T_EX = u + v q + w q̇, v and w joint by joint. δ(M q̈ + T_GC) is the imaginary part
of recursive Newton-Euler on complex bodies c + i ε δc, ε so small that ε² is nothing (Squire & Trapp 1998): no
difference, no digit lost.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from flexlink.kernels.bodies.branches import rows_of_forks
from flexlink.kernels.bodies.kinematics import KinematicsWork, kinematics
from flexlink.kernels.bodies.plane import PlanarWork
from flexlink.kernels.bodies.rne import RneWork, rne
from flexlink.kernels.derivatives.forward_derivatives import forward_derivatives
from flexlink.kernels.derivatives.planar_derivatives import planar_derivatives
from flexlink.kernels.forces.rotation_springs import add_excess, put_constants, rotation_springs
from flexlink.kernels.forward.articulated_rows import ArticulatedWork
from flexlink.kernels.forward.solvers import DenseWork, forward_dynamics
from flexlink.kernels.inputs.drive_torque import follow, stage_torque
from flexlink.kernels.layout import ChainArrays as Arrays
from flexlink.kernels.stepping.runge_kutta import add_stage, step_workspace
from flexlink.kernels.tools.compiler import ARITHMETIC, kernel
from flexlink.kernels.tools.finite import is_finite
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.vec3 import vector

EPSILON = 1e-100
"""ε of the imaginary parts."""
DERIVATIVES = {PlanarWork: planar_derivatives, ArticulatedWork: forward_derivatives, DenseWork: forward_derivatives}
AFFINE = numbered("u v w")  # rows of an affine drive


class Parametric(NamedTuple):
    """A chain, its drive, and how both change with p parameters."""

    chain: Any
    bodies: Any  # (p, bodies) complex, c + i ε δc
    hinges: Any  # (p, n)
    couplings: Any  # (p, couplings)
    drive: Any  # (3, n) u, v, w
    drive_derivatives: Any  # (p, 3, n)


def acceleration_derivatives(work, chain, wrench, q, qd, tau, found):
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX into `found` (3, n, n), by the recursion that the scratch is for."""
    arrays = chain.bodies, chain.hinges, chain.gravity, chain.couplings
    return DERIVATIVES[type(work)](*arrays, wrench, q, qd, tau, found)


@overload(acceleration_derivatives, jit_options=ARITHMETIC)
def _slopes_of(work, chain, wrench, q, qd, tau, found):
    slopes = DERIVATIVES[work.instance_class]
    return lambda work, chain, wrench, q, qd, tau, found: slopes(
        chain.bodies, chain.hinges, chain.gravity, chain.couplings, wrench, q, qd, tau, found
    )


@kernel
def integrate_derivatives(work, tableau, inputs, varied, h, first, last, state, slopes):
    """Advance q, q̇ (n,) and δq, δq̇ (n · p,) in place, from step number `first`, counted from t = 0, to `last`.

    q and q̇ are those of `runge_kutta.integrate` to the bit. Returns whether all numbers are finite.
    """
    A, b, c = tableau
    (q, qd), (δq, δqd) = state, slopes
    n, p = len(q), len(varied.bodies)
    stages, found, known = step_workspace(tableau, q), np.empty((3, n, n)), np.empty((n, p))
    q_stage, tau, K, L = stages.q, stages.tau, stages.K, stages.L
    δ_stage, δK, δL = np.empty(n * p), np.empty((len(c), n * p)), np.empty((len(c), n * p))
    for number in range(first, last):
        for i in range(len(c)):
            t = (number + c[i]) * h
            q_stage[:], L[i], δ_stage[:], δL[i] = q, qd, δq, δqd
            for j in range(i):
                add_stage(A[i, j] * h, L, K, j, q_stage, L[i])
                add_stage(A[i, j] * h, δL, δK, j, δ_stage, δL[i])
            follow(inputs.motion, t, q_stage, L[i], K[i])
            stage_torque(inputs.drive, t, (number + 0.5) * h, q_stage, L[i], tau)
            forward_dynamics(inputs.wrench, q_stage, L[i], tau, K[i], work)
            acceleration_derivatives(work, varied.chain, inputs.wrench, q_stage, L[i], tau, found)
            δq_i, δqd_i = δ_stage.reshape(n, p), δL[i].reshape(n, p)
            parameter_torques(varied, inputs.wrench, q_stage, L[i], K[i], δq_i, δqd_i, known)
            add_products(found, δq_i, δqd_i, known, δK[i].reshape(n, p))
        for i in range(len(c)):
            add_stage(b[i] * h, L, K, i, q, qd)
            add_stage(b[i] * h, δL, δK, i, δq, δqd)
        follow(inputs.motion, (number + 1) * h, q, qd, K[0])
    return is_finite(δq) and is_finite(δqd)


@kernel
def parameter_torques(varied, wrench, q, qd, qdd, δq, δqd, known):
    """δT_EX − δ(M q̈ + T_GC + T_FL + T_FR) of every joint and parameter, (n, p), the drive's feedback with it."""
    own, drive, n, m = varied.chain.hinges, varied.drive, len(q), len(varied.chain.bodies)
    torque, springs = np.empty(n, np.complex128), rotation_springs(varied.chain.bodies, own, varied.chain.couplings)
    forks = np.empty((rows_of_forks(varied.chain.bodies), 15), np.complex128)
    work = RneWork(np.empty((n, 2)), np.empty((m, 6), np.complex128), forks)
    for j in range(len(varied.bodies)):
        hinges, slopes = varied.hinges[j], varied.drive_derivatives[j]
        chain = Arrays(varied.bodies[j], hinges, varied.chain.gravity, varied.couplings[j])
        rne(chain, vector(chain.gravity), wrench, q, qd, qdd, torque, work)
        for k in range(n):
            if own[k].prescribed:  # its motion is given, and so is T_EX
                known[k, j] = 0.0
            else:
                given = slopes[AFFINE.u, k] + slopes[AFFINE.v, k] * q[k] + slopes[AFFINE.w, k] * qd[k]
                fed_back = drive[AFFINE.v, k] * δq[k, j] + drive[AFFINE.w, k] * δqd[k, j]
                taken = torque[k].imag / EPSILON + of_joint(own[k], hinges[k], q[k], qd[k])
                known[k, j] = given + fed_back - taken
        subtract_couplings(varied.chain, chain, q, qd, known[:, j])
        if len(springs.hinges) > 0:
            subtract_rotation(chain, q, springs, known[:, j])


@kernel
def of_joint(own, varied, angle, rate):
    """δ(T_FL + T_FR) of one joint at constant angle and rate, from its numbers and their complex ones."""
    stretched = varied.stiffness.imag * (angle - own.rest) - own.stiffness * varied.rest.imag
    tanh = math.tanh(rate / own.coulomb_width)
    slope = own.coulomb * (1.0 - tanh * tanh) * rate / own.coulomb_width**2
    rubbed = varied.damping.imag * rate + varied.coulomb.imag * tanh - slope * varied.coulomb_width.imag
    return (stretched + rubbed) / EPSILON


@kernel
def subtract_couplings(own, varied, q, qd, known):
    """Subtract δ(T_FL + T_FR) of couplings from the torques (n,) of joints whose motion is not prescribed."""
    for c in range(len(own.couplings)):
        pair, changed = own.couplings[c], varied.couplings[c]
        for k, other in ((pair.inner, pair.outer), (pair.outer, pair.inner)):
            if not own.hinges[k].prescribed:
                stretched = changed.stiffness.imag * (q[other] - own.hinges[other].rest)
                stretched -= pair.stiffness * varied.hinges[other].rest.imag
                known[k] -= (stretched + changed.damping.imag * qd[other]) / EPSILON


@kernel
def subtract_rotation(varied, q, springs, known):
    """Subtract δ of what springs of rotation vectors take more, linear in K; they are slack at angles that stay."""
    own, both, excess = np.empty(len(q)), np.empty(len(varied.couplings)), np.zeros(len(q))
    for k in range(len(own)):
        own[k] = varied.hinges[k].stiffness.imag / EPSILON
    for c in range(len(both)):
        both[c] = varied.couplings[c].stiffness.imag / EPSILON
    put_constants(springs, own, both)
    add_excess(q, springs, excess)
    for k in range(len(q)):
        known[k] -= excess[k]


@kernel
def add_products(found, δq, δqd, known, δqdd):
    """δq̈ = ∂q̈/∂q δq + ∂q̈/∂q̇ δq̇ + M⁻¹ known, all (n, p)."""
    n, p = δqdd.shape
    δqdd[:] = 0.0
    for i in range(n):
        for k in range(n):
            by_angle, by_rate, by_torque = found[0, i, k], found[1, i, k], found[2, i, k]
            for j in range(p):
                δqdd[i, j] += by_angle * δq[k, j] + by_rate * δqd[k, j] + by_torque * known[k, j]


@kernel
def torque_derivatives(varied, wrench, q, qd, qdd):
    """−δ(M q̈ + T_GC + T_FL + T_FR) + δT_EX at a state, (n, p)."""
    n, p = len(q), len(varied.bodies)
    nothing, known = np.zeros((n, p)), np.empty((n, p))
    parameter_torques(varied, wrench, q, qd, qdd, nothing, nothing, known)
    return known


@kernel
def tip_derivatives(varied, q):
    """δ of the tip's place at constant angles, (3, p)."""
    n, m, p = len(q), len(varied.chain.bodies), len(varied.bodies)
    found = np.empty((3, p))
    work = KinematicsWork(
        np.empty((m, 3, 3), np.complex128), np.empty((m, 3), np.complex128), np.empty((n, 3), np.complex128)
    )
    for j in range(p):
        kinematics(Arrays(varied.bodies[j], varied.hinges[j], varied.chain.gravity, varied.couplings[j]), q, work)
        for k in range(3):
            found[k, j] = work.points[-1, k].imag / EPSILON
    return found
