"""Compliance of the hinges of a beam with tabulated EI, from ∫ M/EI dx with moments at hinges, or in cells.

The hinges of a rule are nodes for the moment M, with weights for ∫ M dx. M is smooth even if EI varies, jumps or has
kinks, so M is interpolated between nodes, and the integral of the interpolated M divided by EI is exact:

    θ = ∫ M/EI dx = Σ_j c_j M_j        c_j = ∫ ℓ_j/EI dx        k_j = 1/c_j

ℓ_j are the Lagrange polynomials of the nodes of an element; for `jacobi` rules, of all nodes. With a single node the
integral is ∫ dx/EI over its interval. In cells with Gauss points x_q, M is the polynomial through M_q, and the
complementary energy gives

    ½ ∫ M²/EI dx = ½ M·F M        F_qr = ∫ ℓ_q ℓ_r/EI dx        K = (W C)ᵀ F⁻¹ (W C)        W = diag(w_q)

The matrix C of `Cell` converts hinge angles to curvatures, and w_q are the weights of the Gauss points.
For constant EI this is the K of `schemes.cells`. If ℓ_j would give a hinge a negative compliance, or less than `LEAST`
times the compliance of its interval, as next to a jump, all hinges of the element use this compliance (order 2).

With sections that couple axes, K⁻¹ takes the place of 1/EI, M is the vector of moments, c_j is a matrix (3, 3), and F
and K of a cell have such blocks. If the beam stretches or shears, M also contains the forces in these directions, and
c_j their rows and columns of K⁻¹, up to (6, 6): forces in other directions do no work, so their strains are free.
"""

import numpy as np

from flexlink.chain.beams import TableBeam
from flexlink.common.types import Array
from flexlink.describe.schemes.cells import Cells
from flexlink.describe.schemes.lumping_rules import LumpingRule

LEAST = 0.25
"""Smallest c_j, relative to the compliance of the hinge's interval."""
ROUNDING = 1e-9
"""Rounding error of sums of weights, relative to the link's length."""
MOST_NODES = 100
"""Largest number of nodes of one polynomial; rules with more nodes on a link use intervals."""


def spring_constants(beam: TableBeam, rule: LumpingRule, nodes: Array, weights: Array) -> Array:
    """1/c_j of every hinge about X, Y and Z, (3, N), or c_j⁻¹ of coupled sections in their `directions`, (d, d, N)."""
    axes = (len(beam.directions),) * (2 if beam.table.coupled else 1)
    given = np.empty((*axes, len(nodes)))
    for which, edges, stretches in _panels(rule, nodes, weights):
        by_intervals = np.empty((*axes, len(stretches)))  # w_j times the mean of L/EI over the interval of each hinge
        for j, (ends, w) in enumerate(zip(stretches, weights[which], strict=True)):
            (_, _, weight), per = beam.flexibility(ends, 0)
            by_intervals[..., j] = per @ weight * (w / (ends[1] - ends[0]))
        found = by_intervals
        if rule.grid is None and len(stretches) <= MOST_NODES:
            (_, x, weight), per = beam.flexibility(np.array(edges), len(nodes[which]))
            basis = lagrange(nodes[which], x)  # with the factor g(x)/g(x_j) of a `jacobi` rule
            if rule.jacobi is not None:
                tip, root = rule.jacobi.tip, rule.jacobi.root
                basis *= ((1 - x) ** tip * x**root)[:, None] / ((1 - nodes[which]) ** tip * nodes[which] ** root)
            found = np.asarray((per * weight) @ basis)
        if len(axes) == 1:
            good = (found > LEAST * by_intervals).all(axis=1, keepdims=True)
            given[:, which] = 1 / np.where(good, found, by_intervals)
        else:
            least = np.linalg.eigvalsh((found - LEAST * by_intervals).T).min()
            given[..., which] = np.linalg.inv((found if least > 0 else by_intervals).T).T
    return given


def cell_constants(beam: TableBeam, cells: Cells, count: int) -> Array:
    """K of every cell about X, Y and Z, shape (3, cells, p, p) [N m/rad]."""
    p, cell = cells.hinges, cells.cell
    edges = np.linspace(0.0, 1.0, count // p + 1)
    (owner, x, weight), per = beam.flexibility(edges, 2 * (p - 1))
    basis = lagrange(cell.points, (x - edges[owner]) * (count // p))
    F = np.zeros((3, count // p, p, p))
    for axis in range(3):
        np.add.at(F[axis], owner, (weight * per[axis])[:, None, None] * basis[:, :, None] * basis[:, None, :])
    WC = cell.weights[:, None] * cell.curvature
    return np.asarray(WC.T @ np.linalg.solve(F, np.broadcast_to(WC, F.shape)))


def coupled_constants(beam: TableBeam, rule: LumpingRule, nodes: Array, weights: Array) -> Array:
    """K of every cell, or of every hinge (p = 1), of coupled sections, shape (cells, d, p, d, p) [N m/rad]."""
    if rule.cells is None:
        return np.asarray(spring_constants(beam, rule, nodes, weights).T[:, :, None, :, None])
    cell, p, parts = rule.cells.cell, rule.cells.hinges, len(nodes) // rule.cells.hinges
    edges = np.linspace(0.0, 1.0, parts + 1)
    (owner, x, weight), per = beam.flexibility(edges, 2 * (p - 1))
    basis, F = lagrange(cell.points, (x - edges[owner]) * parts), np.zeros((parts, 3, p, 3, p))
    np.add.at(F, owner, np.einsum("k,abk,kq,kr->kaqbr", weight, per, basis, basis))
    both = np.kron(np.eye(3), cell.weights[:, None] * cell.curvature)
    # F_qr of every cell, (cells, 3p, 3p): of twist, of bending about y and about z
    return np.asarray(both.T @ np.linalg.solve(F.reshape(parts, 3 * p, 3 * p), both)).reshape(-1, 3, p, 3, p)


def section_forces(beam: TableBeam, rule: LumpingRule, hinges: tuple[Array, Array], moved: Array) -> Array:
    """Forces in `directions` of coupled sections at hinges, or Gauss points of cells, for their movements (…, N, d)."""
    K = coupled_constants(beam, rule, *hinges)
    each = moved.reshape(*moved.shape[:-2], len(K), K.shape[2], K.shape[1])
    M = np.einsum("eaibj,...ejb->...eia", K, each)
    if rule.cells is not None:
        WC = rule.cells.cell.weights[:, None] * rule.cells.cell.curvature
        M = np.einsum("qi,...eia->...eqa", np.linalg.inv(WC.T), M)
    return np.asarray(M.reshape(moved.shape))


def curvatures(beam: TableBeam, rule: LumpingRule, hinges: tuple[Array, Array], angles: Array) -> Array:
    """κ = M/EI about X, Y and Z at hinges, or Gauss points of cells, (3, …, N), for angles (…, N) about this axis."""
    nodes, weights = hinges
    if rule.cells is None:
        rows = spring_constants(beam, rule, nodes, weights) / beam.rigidities(nodes)
        return np.asarray([row * angles for row in rows])
    cell, p = rule.cells.cell, rule.cells.hinges
    K, points = cell_constants(beam, rule.cells, len(nodes)), rule.cells.gauss_points(len(nodes))
    M = np.linalg.solve((cell.weights[:, None] * cell.curvature).T, K)  # (3, cells, p, p), moments per angle
    moments = np.einsum("aeij,...ej->a...ei", M, angles.reshape(*angles.shape[:-1], -1, p)).reshape(3, *angles.shape)
    return np.asarray([part / row for part, row in zip(moments, beam.rigidities(points), strict=True)])


Panel = tuple[slice, tuple[float, float], Array]
"""Hinges whose moments define one polynomial, the part of the link they are on, and the interval of each, (N, 2)."""


def _panels(rule: LumpingRule, nodes: Array, weights: Array) -> list[Panel]:
    if rule.grid is not None:
        half = np.diff(nodes).mean() / 2 if len(nodes) > 1 else 0.5
        return [(slice(None), (0.0, 1.0), np.clip(np.column_stack([nodes - half, nodes + half]), 0.0, 1.0))]
    size = len(nodes) if rule.element is None else len(rule.element.nodes)
    count, panels = len(nodes) // size, list[Panel]()
    for e in range(count):
        which, edges = slice(e * size, (e + 1) * size), (e / count, (e + 1) / count)
        ends = edges[0] + np.append(0.0, np.cumsum(weights[which]))
        if abs(ends[-1] - edges[1]) > ROUNDING:  # the weights do not integrate constants
            ends[1:-1] = (nodes[which][1:] + nodes[which][:-1]) / 2
        ends[-1] = edges[1]
        panels.append((which, edges, np.column_stack([ends[:-1], ends[1:]])))
    return panels


def lagrange(nodes: Array, x: Array) -> Array:
    """Lagrange polynomials ℓ_j(x), shape (points, N)."""
    found = np.ones((len(x), len(nodes)))
    for j, node in enumerate(nodes):
        for other in np.delete(nodes, j):
            found[:, j] *= (x - other) / (node - other)
    return found
