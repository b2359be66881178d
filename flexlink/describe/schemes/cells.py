"""Cells of hinges with coupled springs, which have order 4 under axial load and in large bending.

With one spring per hinge, by any rule, a chain under a tension T acts as if EI were larger by T L² / (12 N²), because
the angle of the chain is a step function instead of a continuous one. Here the segments have the beam's angle θ at the
p + 1 Gauss-Lobatto nodes t_k of every cell [0, 1], and their lengths are the weights b_k, so the steps integrate θ to
order 2p. Between nodes θ is the interpolating polynomial. The springs act on its derivative, the curvature, at
the p Gauss points x_q with weights w_q. With hinge angles φ_j, cell length h and Lagrange polynomials L_k of the nodes,

    κ(x_q) = 1/h Σ_j C_qj φ_j        C_qj = Σ_k≥j L_k'(x_q)        K = 1/h Cᵀ diag(w_q EI(x_q)) C

Two segments at a cell boundary have the same angle and form one segment. Statics converge with order 2p, motion with 4,
limited by the kink of the mass kernel (see `lumping_rules`).
"""

import functools
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.polynomial import Legendre, legendre

from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.spec import NonNegative, Spec


class Cell(NamedTuple):
    """Quadrature rules of a cell [0, 1], and the curvature due to its hinge angles."""

    nodes: Array  # t (p + 1,), Gauss-Lobatto
    lengths: Array  # b (p + 1,), weights of the nodes
    points: Array  # x_q (p,), Gauss-Legendre
    weights: Array  # w_q (p,)
    curvature: Array  # C (p, p)

    @property
    def pairs(self) -> tuple[tuple[int, int], ...]:
        """Coupled pairs of hinges i < j in a cell."""
        return tuple((i, j) for i in range(len(self.points)) for j in range(i + 1, len(self.points)))

    def curvatures(self, angles: Array, length: float) -> Array:
        """κ [rad/m] at the Gauss points of consecutive cells, each of `length` [m], for angles (…, hinges) [rad]."""
        each = angles.reshape(*angles.shape[:-1], -1, len(self.points))
        return np.asarray((each @ self.curvature.T / length).reshape(angles.shape))

    def stiffness(self, i: int, j: int, held: Array) -> Array:
        """K_ij of cells, where `held` is EI w_q / h at the Gauss points, shape (…, p)."""
        return np.asarray(sum(row[i] * row[j] * held[..., q] for q, row in enumerate(self.curvature)))


class Cells(Spec, frozen=True):
    """Equal cells of p hinges each, with coupled springs."""

    hinges: Annotated[int, msgspec.Meta(ge=2, le=6)]
    """Number of hinges p per cell, 2 to 6 [1]."""
    tip: NonNegative
    """Inertia of the last segment about its hinge, divided by m l²/3, the inertia of a uniform bar; the inertia of the
    previous segment is reduced by it. The exact value is 0, but then M is singular without a body at the tip [1]."""

    @property
    def cell(self) -> Cell:
        """The cell that is repeated."""
        return cell_of(self.hinges)

    def lent(self, mass: float, length: float) -> float:
        """Inertia of the last segment about its hinge [kg m²], taken from the segment before; see `tip`."""
        return self.tip * mass * length**2 / 3

    def gauss_points(self, count: int) -> Array:
        """Gauss points of `count` hinges on a link of length 1, shape (count,); springs act on the curvature there."""
        cells = count // self.hinges
        return np.asarray((np.arange(cells)[:, None] + self.cell.points).ravel() / cells)

    def segments(self, count: int) -> tuple[Array, Array]:
        """Positions where segments have the beam's angle, and their lengths, (N + 1,) each, on a link of length 1."""
        p, cells = self.hinges, count // self.hinges
        positions, lengths = np.zeros((2, count + 1))
        for e in range(cells):
            part = slice(e * p, e * p + p + 1)
            positions[part] = (e + self.cell.nodes) / cells
            lengths[part] += self.cell.lengths / cells
        return positions, lengths

    def place(self, count: int) -> tuple[Array, Array]:
        """Nodes and weights of `count` hinges; the weights correspond to the diagonal of K."""
        if count % self.hinges:
            raise no_multiple(count, self.hinges)
        cells, one = count // self.hinges, self.cell
        own = np.array([one.stiffness(i, i, one.weights) for i in range(self.hinges)])
        return np.cumsum(self.segments(count)[1])[:-1], np.tile(1 / own, cells) / cells


def no_multiple(count: int, size: int) -> ArgumentError:
    """Error for `count` hinges with a rule that needs multiples of `size`."""
    below = count - count % size
    near = " or ".join(str(k + 1) for k in (below, below + size) if k)
    return ArgumentError(f"needs a multiple of {size} hinges; the nearest are {near} segments", id="hinges-of-rule")


@functools.cache
def cell_of(p: int) -> Cell:
    """Return a cell of p hinges."""
    P = Legendre.basis(p)
    inner = np.sort(P.deriv().roots().real)
    for _ in range(3):  # Newton iterations remove the rounding error of the roots
        inner = inner - P.deriv()(inner) / P.deriv(2)(inner)
    t = np.concatenate([[-1.0], (inner - inner[::-1]) / 2, [1.0]])  # Gauss-Lobatto nodes: ±1 and the roots of P_p'
    x, w = legendre.leggauss(p)
    b = 2 / (p * (p + 1) * P(t) ** 2)
    lagrange = np.linalg.inv(legendre.legvander(t, p))  # column k: coefficients of L_k in Legendre polynomials
    slopes = 2 * legendre.legval(x, legendre.legder(lagrange)).T  # L_k'(x_q), on [0, 1]
    beyond = np.cumsum(slopes[:, ::-1], axis=1)[:, ::-1]  # Σ_k≥j L_k'(x_q)
    return Cell((1 + t) / 2, np.asarray(b / 2), (1 + x) / 2, w / 2, np.asarray(beyond[:, 1:], dtype=np.float64))
