"""Static equilibria of a chain with springs under gravity, for a sequence of positions of the held joints.

Newton's method solves T_G(q) + T_FL(q) = 0 for the free joints. It reuses its factored matrix as long as every
correction is at most a tenth of the last one, because the deflection hardly changes from one position to the next.
"""

import math

import numpy as np

from flexlink.kernels.bodies.rne import rne, rne_workspace
from flexlink.kernels.derivatives.inverse_derivatives import derivatives_workspace, inverse_derivatives
from flexlink.kernels.forces.elements import add_slopes, add_torques, force_slopes_of, forces_of
from flexlink.kernels.geometry.kinematics import arm_length
from flexlink.kernels.layout import SLIDES
from flexlink.kernels.tools.compiler import kernel, recursion
from flexlink.kernels.tools.vec3 import vector


@kernel
def follow_equilibria(chain, held, free, angles, q, postures):
    """Write equilibria `postures` (rows, n) with joints `held` at `angles` (rows, held), starting from equilibrium q.

    q (n,) is overwritten. Returns the number of rows found. The sequence ends where Newton's method fails, where its
    corrections add up to more than a limit, or where the equilibrium is unstable.
    """
    most, far, shrinks, small = 30, 0.1, 0.1, 1e-11  # of corrections: number, sum [rad, arm lengths], ratio, size
    n, f = len(q), len(free)
    zero, none, torque, x, work = np.zeros(n), np.zeros(6), np.zeros(n), np.zeros(f), rne_workspace(chain)
    forces, spare = forces_of(chain), np.empty((n, n))
    slopes_of_forces = force_slopes_of(chain, forces)
    K, L, known = np.zeros((n, n)), np.zeros((f, f)), False
    slopes, found = derivatives_workspace(chain), np.empty((3, n, n))
    sizes, length = np.ones(f), arm_length(chain.bodies)
    for i in range(f):
        if chain.rare is not None and chain.hinges[free[i]].axis >= SLIDES:
            sizes[i] = length
    for row in range(len(angles)):
        for j in range(len(held)):
            q[held[j]] = angles[row, j]
        last, moved = math.inf, 0.0
        for correction in range(most + 1):
            rne(chain, vector(chain.gravity), none, q, zero, zero, torque, work)
            if not known:
                for i in range(n):
                    for j in range(n):
                        K[i, j] = chain.hinges[i].stiffness if i == j else 0.0
                if chain.rare is not None:
                    add_slopes(slopes_of_forces.elements, q, zero, K, spare)
                inverse_derivatives(chain, none, q, zero, zero, (found[0], found[1], found[2]), slopes)
                K += found[0]
                known = factor_block(K, free, L)
                last = math.inf
            if not known or correction == most:
                return row
            if chain.rare is not None:
                add_torques(forces.elements, q, zero, torque)
            for i in range(f):
                hinge = chain.hinges[free[i]]
                x[i] = torque[free[i]] + hinge.stiffness * (q[free[i]] - hinge.rest)
            size = solve_block(L, x, sizes)
            moved += size
            if not moved < far:
                return row
            for i in range(f):
                q[free[i]] -= x[i]
            if size == 0.0 or (size < small and size > shrinks * last):  # only rounding errors remain
                break
            known = size <= shrinks * last
            last = size
        known = True
        postures[row] = q
    return len(angles)


@kernel
def gravity_torques(chain, postures, torques):
    """Write the gravity torques T_G (rows, n) at every posture (rows, n)."""
    zero, none, work = np.zeros(postures.shape[1]), np.zeros(6), rne_workspace(chain)
    for row in range(len(postures)):
        rne(chain, vector(chain.gravity), none, postures[row], zero, zero, torques[row], work)


@recursion
def factor_block(K, free, L):
    """Write the Cholesky factor L of K, restricted to the joints `free`; return False if K is not positive definite."""
    for j in range(len(free)):
        for i in range(j, len(free)):
            total = K[free[i], free[j]]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i > j:
                L[i, j] = total / L[j, j]
            elif total > 0.0:
                L[j, j] = math.sqrt(total)
            else:
                return False
    return True


@recursion
def solve_block(L, x, sizes):
    """x ← (L Lᵀ)⁻¹ x; return the largest |x_i| / sizes_i, or nan if some x_i is not finite."""
    for i in range(len(x)):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    size = 0.0
    for i in range(len(x) - 1, -1, -1):
        for k in range(i + 1, len(x)):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
        size = max(size, abs(x[i]) / sizes[i]) + (x[i] - x[i])
    return size
