"""Springs and dampers between two hinges: K_ij and D_ij beside the diagonals that hinges keep."""

import numpy as np

from flexlink.kernels.bodies.joint_torques import JOINT
from flexlink.kernels.tools.compiler import kernel, recursion, subroutine
from flexlink.kernels.tools.lanes import at, put_at, zero_of
from flexlink.kernels.tools.numbered import numbered

CONSTANT = numbered("stiffness damping")  # of a coupling


@kernel
def coupled_joints(couplings):
    """The two hinges of every coupling, (m, 2), and its K_ij and D_ij, (m, 2)."""
    pairs, constants = np.empty((len(couplings), 2), np.int64), np.empty((len(couplings), 2))
    for c in range(len(couplings)):
        pairs[c, 0], pairs[c, 1] = couplings[c].inner, couplings[c].outer
        constants[c, CONSTANT.stiffness], constants[c, CONSTANT.damping] = couplings[c].stiffness, couplings[c].damping
    return pairs, constants


@recursion
def subtract_couplings(rows, pairs, constants, q, qd, net):
    """Subtract K_ij (θ_j − θ₀_j) + D_ij q̇_j from column `net` of the row of hinge i, and the same of j from that of i.

    Returns the power that the dampers take [W].
    """
    power = zero_of(qd)
    for c in range(len(pairs)):
        i, j, k, d = pairs[c, 0], pairs[c, 1], at(constants, c, CONSTANT.stiffness), at(constants, c, CONSTANT.damping)
        put_at(rows, at(rows, i, net) - k * (at(q, j) - at(rows, j, JOINT.rest)) - d * at(qd, j), i, net)
        put_at(rows, at(rows, j, net) - k * (at(q, i) - at(rows, i, JOINT.rest)) - d * at(qd, i), j, net)
        power += 2.0 * d * at(qd, i) * at(qd, j)
    return power


@subroutine
def add_couplings(couplings, hinges, q, qd, torque):
    """Add T_FL and T_FR of the couplings to `torque` (n,); returns the power that their dampers take [W]."""
    power = 0.0
    for c in range(len(couplings)):
        pair = couplings[c]
        i, j = pair.inner, pair.outer
        torque[i] += pair.stiffness * (q[j] - hinges[j].rest) + pair.damping * qd[j]
        torque[j] += pair.stiffness * (q[i] - hinges[i].rest) + pair.damping * qd[i]
        power += 2.0 * pair.damping * qd[i] * qd[j]
    return power


@kernel
def cells_of(n, couplings):
    """First hinge of the cell of every hinge, (n,): a run of hinges that couplings overlap; (0,) without couplings."""
    if len(couplings) == 0:
        return np.empty(0, np.int64)
    first, furthest = np.arange(n), np.arange(n)
    for c in range(len(couplings)):
        furthest[couplings[c].inner] = max(furthest[couplings[c].inner], couplings[c].outer)
    begin = end = 0
    for k in range(n):
        if k > end:
            begin = end = k
        end, first[k] = max(end, furthest[k]), begin
    return first


@kernel
def factor_springs(chain, joints):
    """L D Lᵀ = K of some joints with springs, in ascending order, O(n): D_i, then L_{i,i−1}, L_{i,i−2}, … in row i."""
    place, width = np.full(len(chain.hinges), -1), 0
    for i in range(len(joints)):
        place[joints[i]] = i
    for pair in chain.couplings:
        if place[pair.inner] >= 0 and place[pair.outer] >= 0:
            width = max(width, place[pair.outer] - place[pair.inner])
    rows = np.zeros((len(joints), 1 + width))
    for i in range(len(joints)):
        rows[i, 0] = chain.hinges[joints[i]].stiffness
    for pair in chain.couplings:
        i, j = place[pair.outer], place[pair.inner]
        if i >= 0 and j >= 0:
            rows[i, i - j] = pair.stiffness
    for i in range(len(rows)):
        begin = max(0, i - width)
        for j in range(begin, i):
            for k in range(begin, j):
                rows[i, i - j] -= rows[i, i - k] * rows[k, 0] * rows[j, j - k]
            rows[i, i - j] /= rows[j, 0]
        for j in range(begin, i):
            rows[i, 0] -= rows[i, i - j] ** 2 * rows[j, 0]
    return rows


@recursion
def solve_springs(rows, x):
    """x ← K⁻¹ x, of the joints of `factor_springs`."""
    for i in range(len(x)):
        for j in range(max(0, i - rows.shape[1] + 1), i):
            x[i] -= rows[i, i - j] * x[j]
    for i in range(len(x) - 1, -1, -1):
        x[i] /= rows[i, 0]
        for j in range(i + 1, min(len(x), i + rows.shape[1])):
            x[i] -= rows[j, j - i] * x[j]


@kernel
def give_way(chain, joints, torques):
    """Torques (rows, joints) on springs become the angles by which they give way."""
    rows = factor_springs(chain, joints)
    for row in range(len(torques)):
        solve_springs(rows, torques[row])
