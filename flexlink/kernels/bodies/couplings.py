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
