"""Slopes of forward dynamics along all angles, rates and torques, O(n²).

    ∂q̈/∂(q, q̇, T_EX) = M⁻¹ (−∂T/∂q, −∂T/∂q̇, 1)        T = M q̈ + T_GC + T_FL + T_FR at constant q̈

by `inverse_slopes` and a recursion for every eight columns. The rows and columns of joints with prescribed motion have
no M: q̈ is given there, and their columns of ∂q̈/∂T_EX hold ∂q̈/∂q̈_given, −M⁻¹ M_given and 1.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload

from flexlink.kernels.articulated_rows import ArticulatedWork, articulated_workspace
from flexlink.kernels.compiler import INLINED, kernel, recursion
from flexlink.kernels.forward import forward_dynamics
from flexlink.kernels.inverse_mass import solve_on_articulated
from flexlink.kernels.inverse_slopes import inverse_slopes, slopes_workspace
from flexlink.kernels.lanes import LANES, at, put_at
from flexlink.kernels.planar import planar_workspace
from flexlink.kernels.shifted_plane import A, PlanePosture, factor_in_plane, place_in_plane, solve_in_plane


class PlaneFactors(NamedTuple):
    """M of a planar chain, factored."""

    factors: Any  # (n, 8)
    posture: Any


@kernel
def slopes_in_plane(chain, wrench, q, qd, tau):
    """q̈ (n,), and ∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX as (3, n, n), of a planar chain."""
    n = len(q)
    work = planar_workspace(chain.bodies, chain.hinges, chain.gravity)
    qdd = np.zeros(n)
    forward_dynamics(wrench, q, qd, tau.copy(), qdd, work)
    posture = PlanePosture(work.links, work.given, work.trig, np.empty((n, 2)), np.empty((n, 2)))
    factors = np.zeros((n, 8))
    for k in range(n):
        factors[k, A] = chain.hinges[k].armature
    place_in_plane(q, posture)
    factor_in_plane(factors, posture)
    return qdd, solve_all(chain, wrench, q, qd, qdd, PlaneFactors(factors, posture))


@kernel
def slopes_in_space(chain, wrench, q, qd, tau):
    """The same of any chain."""
    work = articulated_workspace(chain.bodies, chain.hinges, chain.gravity)
    qdd = np.zeros(len(q))
    forward_dynamics(wrench, q, qd, tau.copy(), qdd, work)
    return qdd, solve_all(chain, wrench, q, qd, qdd, work)


@recursion
def in_plane(r, x, factored):
    """x of M x = r, both (n, 8)."""
    solve_in_plane(factored.factors, r, x, factored.posture)


SOLVE = {PlaneFactors: in_plane, ArticulatedWork: solve_on_articulated}  # by what M is factored in


def solve(r, x, factored):
    """Write x of M x = r, both (n, 8), 0 at prescribed joints."""
    SOLVE[type(factored)](r, x, factored)


@overload(solve, jit_options=INLINED)
def _solve(r, x, factored):
    algorithm = SOLVE[factored.instance_class]
    return lambda r, x, factored: algorithm(r, x, factored)  # noqa: PLW0108


@kernel
def solve_all(chain, wrench, q, qd, qdd, factored):
    """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂T_EX, (3, n, n)."""
    n, slopes = len(q), slopes_workspace(chain)
    inverse_slopes(chain, wrench, False, q, qd, qdd, slopes)
    add_joints(chain.hinges, qd, slopes)
    found, r, x = np.empty((3, n, n)), np.empty((n, LANES)), np.empty((n, LANES))
    solve_columns(slopes.by_angle, r, x, factored, found[0])
    solve_columns(slopes.by_rate, r, x, factored, found[1])
    solve_columns(slopes.by_acceleration, r, x, factored, found[2])
    for k in range(n):
        if chain.hinges[k].prescribed:
            found[2, k, k] = 1.0
    return found


@recursion
def add_joints(hinges, qd, slopes):
    """Add the slopes of T_FL and T_FR, and replace M by −∂T_EX: of given q̈ it stays what it is."""
    for j in range(len(hinges)):
        hinge, block, lane = hinges[j], j // LANES, j % LANES
        slopes.by_angle[j, block, lane] += hinge.stiffness
        slopes.by_rate[j, block, lane] += friction_slope(hinge, qd[j])
        if not hinge.prescribed:
            for k in range(len(hinges)):
                slopes.by_acceleration[k, block, lane] = 0.0
            slopes.by_acceleration[j, block, lane] = -1.0


@recursion
def solve_columns(slopes, r, x, factored, found):
    """Write −M⁻¹ times (n, n) slopes, eight columns side by side."""
    n = len(found)
    for block in range(slopes.shape[1]):
        for k in range(n):
            put_at(r, -at(slopes, k, block), k)
        solve(r, x, factored)
        for k in range(n):
            for lane in range(min(LANES, n - block * LANES)):
                found[k, block * LANES + lane] = x[k, lane]


@recursion
def friction_slope(hinge, rate):
    """∂T_FR/∂q̇ = d + c / w sech²(q̇ / w) of one hinge."""
    slope = hinge.damping
    if hinge.coulomb > 0.0:
        decay = math.exp(-abs(rate) / hinge.coulomb_width)
        sech = 2.0 * decay / (1.0 + decay * decay)
        slope += hinge.coulomb / hinge.coulomb_width * sech * sech
    return slope
