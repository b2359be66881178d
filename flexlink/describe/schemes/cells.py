"""Cells of hinges whose springs are coupled: order 4 under axial load and in large bending.

One spring a hinge makes a chain too stiff by T L² / (12 N²) under a tension T, whatever its rule: the angle of the
chain is a staircase, which misses a line by that much. Here the segments carry the beam's angle θ at the p + 1
Gauss-Lobatto nodes t_k of every cell [0, 1], and are as long as the weights b_k, so that the staircase has the
integrals of θ to order 2p. In between θ is the polynomial through the nodes, and the springs hold its slope, the
curvature, at the p Gauss points x_q with weights w_q. With φ_j the hinge angles, h the length of a cell and L_k
Lagrange's polynomials of the nodes,

    κ(x_q) = 1/h Σ_j C_qj φ_j        C_qj = Σ_k≥j L_k'(x_q)        K = 1/h Cᵀ diag(w_q EI(x_q)) C

Two segments at a boundary of cells have one angle, and are one segment. Statics are of order 2p, motion of order 4,
which the kink of the mass kernel leaves (see `lumping_rules`).
"""

from __future__ import annotations

import functools
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.polynomial import Legendre, legendre

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.spec import NonNegative, Spec


class Cell(NamedTuple):
    """Quadratures of a cell [0, 1], and the curvature that its hinge angles make."""

    nodes: Array  # t (p + 1,), Gauss-Lobatto
    lengths: Array  # b (p + 1,), their weights
    points: Array  # x_q (p,), Gauss-Legendre
    weights: Array  # w_q (p,)
    curvature: Array  # C (p, p)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Hinges i < j of a cell that a coupling joins."""
        return tuple((i, j) for i in range(len(self.points)) for j in range(i + 1, len(self.points)))

    def curvatures(self, angles: Array, length: float) -> Array:
        """κ [rad/m] at the Gauss points of cells in a row, each of so much length [m], of angles (…, hinges) [rad]."""
        each = angles.reshape(*angles.shape[:-1], -1, len(self.points))
        return np.asarray((each @ self.curvature.T / length).reshape(angles.shape))

    def stiffness(self, i: int, j: int, held: Array) -> Array:
        """K_ij of cells whose rigidity EI w_q / h at the Gauss points is `held`, shape (…, p)."""
        return np.asarray(sum(row[i] * row[j] * held[..., q] for q, row in enumerate(self.curvature)))


class Cells(Spec, frozen=True):
    """Equal cells with p hinges each, whose springs are coupled."""

    hinges: Annotated[int, msgspec.Meta(ge=2, le=6)]
    """Hinges p of a cell, 2 to 6 [1]."""
    tip: NonNegative
    """Inertia of the last segment about its hinge, in those of a uniform bar, m l²/3, which the segment before gives
    it; with 0, the exact one, M is singular unless something is at the tip [1]."""

    @property
    def cell(self) -> Cell:
        """What all cells have in common."""
        return cell_of(self.hinges)

    def gauss_points(self, count: int) -> Array:
        """Where the springs of `count` hinges hold the curvature, (count,), on a link of length 1."""
        cells = count // self.hinges
        return np.asarray((np.arange(cells)[:, None] + self.cell.points).ravel() / cells)

    def segments(self, count: int) -> tuple[Array, Array]:
        """Where the beam has the angle of each segment, and their lengths, (N + 1,) each, on a link of length 1."""
        p, cells = self.hinges, count // self.hinges
        places, lengths = np.zeros((2, count + 1))
        for e in range(cells):
            part = slice(e * p, e * p + p + 1)
            places[part] = (e + self.cell.nodes) / cells
            lengths[part] += self.cell.lengths / cells
        return places, lengths

    def place(self, count: int) -> tuple[Array, Array]:
        """Nodes and weights of `count` hinges; weights are those that the diagonal of K stands for.

        Raises
        ------
        ArgumentError
            `count` is no multiple of p; the message names the two nearest.
        """
        if count % self.hinges:
            raise no_multiple(count, self.hinges)
        cells, one = count // self.hinges, self.cell
        own = np.array([one.stiffness(i, i, one.weights) for i in range(self.hinges)])
        return np.cumsum(self.segments(count)[1])[:-1], np.tile(1 / own, cells) / cells


def no_multiple(count: int, size: int) -> ArgumentError:
    """The error of `count` hinges where a rule takes `size` at a time."""
    below = count - count % size
    near = " or ".join(str(k + 1) for k in (below, below + size) if k)
    return ArgumentError(f"needs a multiple of {size} hinges; the nearest are {near} segments", id="hinges-of-rule")


@functools.cache
def cell_of(p: int) -> Cell:
    """A cell of p hinges."""
    t, (x, w) = _lobatto_nodes(p), np.polynomial.legendre.leggauss(p)
    b = 2 / (p * (p + 1) * Legendre.basis(p)(t) ** 2)
    lagrange = np.linalg.inv(legendre.legvander(t, p))  # column k: L_k in Legendre's polynomials
    slopes = 2 * legendre.legval(x, legendre.legder(lagrange)).T  # L_k'(x_q), on [0, 1]
    beyond = np.cumsum(slopes[:, ::-1], axis=1)[:, ::-1]  # Σ_k≥j
    return Cell((1 + t) / 2, np.asarray(b / 2), (1 + x) / 2, w / 2, np.asarray(beyond[:, 1:], dtype=np.float64))


def _lobatto_nodes(p: int) -> Array:
    """±1 and the roots of P_p' between them."""
    P = Legendre.basis(p)
    inner = np.sort(P.deriv().roots().real)
    for _ in range(3):  # Newton's method takes off the rounding of the roots
        inner = inner - P.deriv()(inner) / P.deriv(2)(inner)
    return np.concatenate([[-1.0], (inner - inner[::-1]) / 2, [1.0]])
