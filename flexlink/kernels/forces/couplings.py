"""Springs and dampers between two hinges: off-diagonal K_ij and D_ij. Diagonal entries are stored with the hinges."""

from typing import Any, NamedTuple

import numpy as np

from flexlink.kernels.tools.compiler import allocating, kernel, recursion
from flexlink.kernels.tools.lanes import LANES, at, empty_lanes, put_at, put_lane, zero_of
from flexlink.kernels.tools.numbered import numbered
from flexlink.kernels.tools.records import keep

CONSTANT = numbered("stiffness damping inner_rest outer_rest")  # of a coupling i, j: K_ij, D_ij, θ₀ of i and of j


class Couplings(NamedTuple):
    """Force element: torque K_ij (θ_j − θ₀_j) + D_ij q̇_j on hinge i, and the same with i and j swapped on hinge j."""

    pairs: Any  # (m, 2) the two hinges i, j of each coupling
    constants: Any  # (m, CONSTANT.size), or (m, CONSTANT.size, 8) of eight chains


@allocating
def couplings_of(couplings, hinges):
    """The couplings of a chain between its hinges, as a force element."""
    pairs, constants = np.empty((len(couplings), 2), np.int64), np.empty((len(couplings), CONSTANT.size))
    for c in range(len(couplings)):
        pair = couplings[c]
        pairs[c, 0], pairs[c, 1] = pair.inner, pair.outer
        keep(constants, c, (pair.stiffness, pair.damping, hinges[pair.inner].rest, hinges[pair.outer].rest))
    return Couplings(pairs, constants)


@allocating
def couplings_side_by_side(chains):
    """The couplings of eight chains with the same hinges and pairs; one chain per lane."""
    couplings, hinges = chains.rare.couplings, chains.hinges
    pairs = couplings_of(couplings[0], hinges[0]).pairs
    constants = empty_lanes((len(pairs), CONSTANT.size))
    for lane in range(LANES):
        put_lane(couplings_of(couplings[lane], hinges[lane]).constants, lane, constants)
    return Couplings(pairs, constants)


@recursion
def coupling_torque(element, q, qd, torque):
    """Add the torques to `torque` (n,), or (n, 8) of eight states; returns the power that dampers dissipate [W]."""
    pairs, constants, power = element.pairs, element.constants, zero_of(qd)
    for c in range(len(pairs)):
        i, j, k, d = pairs[c, 0], pairs[c, 1], at(constants, c, CONSTANT.stiffness), at(constants, c, CONSTANT.damping)
        inner, outer = at(constants, c, CONSTANT.inner_rest), at(constants, c, CONSTANT.outer_rest)
        put_at(torque, at(torque, i) + k * (at(q, j) - outer) + d * at(qd, j), i)
        put_at(torque, at(torque, j) + k * (at(q, i) - inner) + d * at(qd, i), j)
        power += 2.0 * d * at(qd, i) * at(qd, j)
    return power


@recursion
def coupling_energy(element, q):
    """Elastic energy Σ K_ij (θ_i − θ₀_i) (θ_j − θ₀_j) [J]."""
    energy, constants = 0.0, element.constants
    for c in range(len(element.pairs)):
        i, j = element.pairs[c, 0], element.pairs[c, 1]
        bent = (q[i] - constants[c, CONSTANT.inner_rest]) * (q[j] - constants[c, CONSTANT.outer_rest])
        energy += constants[c, CONSTANT.stiffness] * bent
    return energy


@recursion
def coupling_slopes(element, q, qd, by_angle, by_rate):
    """Add K_ij and D_ij to ∂T/∂q and ∂T/∂q̇ (n, n)."""
    for c in range(len(element.pairs)):
        i, j = element.pairs[c, 0], element.pairs[c, 1]
        for row, column in ((i, j), (j, i)):
            by_angle[row, column] += element.constants[c, CONSTANT.stiffness]
            by_rate[row, column] += element.constants[c, CONSTANT.damping]


@kernel
def cells_of(n, rare):
    """(n,) the first hinge of the cell of each hinge; (0,) without couplings; None for a plain chain."""
    if rare is None:
        return None
    if len(rare.couplings) == 0:
        return np.empty(0, np.int64)
    first, furthest = np.arange(n), np.arange(n)
    for pair in rare.couplings:
        furthest[pair.inner] = max(furthest[pair.inner], pair.outer)
    begin = end = 0
    for k in range(n):
        if k > end:
            begin = end = k
        end, first[k] = max(end, furthest[k]), begin
    return first


@allocating
def factor_springs(chain, joints):
    """Factors of K = L D Lᵀ of joints with springs, in ascending order, O(n): row i is D_i, L_{i,i−1}, L_{i,i−2}, …"""
    place, width = np.full(len(chain.hinges), -1), 0
    for i in range(len(joints)):
        place[joints[i]] = i
    if chain.rare is not None:
        for pair in chain.rare.couplings:
            if place[pair.inner] >= 0 and place[pair.outer] >= 0:
                width = max(width, place[pair.outer] - place[pair.inner])
    rows = np.zeros((len(joints), 1 + width))
    for i in range(len(joints)):
        rows[i, 0] = chain.hinges[joints[i]].stiffness
    if chain.rare is not None:
        for pair in chain.rare.couplings:
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
    """x ← K⁻¹ x in place, with the factors `rows` of `factor_springs`."""
    for i in range(len(x)):
        for j in range(max(0, i - rows.shape[1] + 1), i):
            x[i] -= rows[i, i - j] * x[j]
    for i in range(len(x) - 1, -1, -1):
        x[i] /= rows[i, 0]
        for j in range(i + 1, min(len(x), i + rows.shape[1])):
            x[i] -= rows[j, j - i] * x[j]


@kernel
def give_way(chain, joints, torques):
    """Replace torques (rows, joints) on springs by the deflections K⁻¹ τ [rad], in place."""
    rows = factor_springs(chain, joints)
    for row in range(len(torques)):
        solve_springs(rows, torques[row])
