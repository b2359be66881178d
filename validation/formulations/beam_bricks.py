"""A uniform straight beam as bricks of 12 nodes, for programs that take mass and stiffness of a finite element model.

Shapes are quadratic along the beam and linear across it. Poisson's ratio is 0, so a section stays plane and keeps its
size: nothing else is needed for bending. All integrals over a brick are products of integrals along its three edges;
two points along the beam, in place of three, avoid locking.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from flexlink.common.types import Array

SLENDERNESS = 500  # length over height: shear, EI / GA L², is 7e-7, rotary inertia, h² / 12 L², 3e-7, rounding 2e-6
WIDTH = 2.0  # over height: bending out of the plane has other frequencies, so modes do not mix
ALONG, ACROSS = 2, 1  # degrees of the shapes
CORNERS = 4  # nodes of a section


class Bricks(NamedTuple):
    """Nodes, section by section from the root, and mass and stiffness of their displacements (x, y, z of node 0, …)."""

    nodes: Array
    M: Array
    K: Array


Edge = dict[tuple[bool, bool], Array]
"""(whether the row's shape is differentiated, whether the column's is) → integrals along an edge of their products."""


def bricks(length: float, EI: float, ρA: float, count: int, tip_mass: float = 0.0) -> Bricks:
    """A beam along x that bends about z, with a point mass spread over the nodes of its last section."""
    h = length / SLENDERNESS
    b = WIDTH * h
    E, ρ = 12 * EI / (b * h**3), ρA / (b * h)
    height, width = (_edge(size, 1, ACROSS, 2) for size in (h, b))
    edges = _edge(length, count, ALONG, ALONG), height, width
    G = [[_volume(edges, i, j) for j in range(3)] for i in range(3)]
    shear = sum(G[i][i] for i in range(3))
    K = [[E / 2 * (G[i][i] + shear if i == j else G[j][i]) for j in range(3)] for i in range(3)]
    mass = ρ * _volume((_edge(length, count, ALONG, ALONG + 1), height, width))
    mass[-CORNERS:, -CORNERS:] += np.eye(CORNERS) * tip_mass / CORNERS
    sides = (np.linspace(0, length, ALONG * count + 1), np.array([-h, h]) / 2, np.array([-b, b]) / 2)
    nodes = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    size = 3 * len(nodes)
    M = np.asarray(np.kron(mass, np.eye(3)))
    return Bricks(nodes, M, np.transpose(K, (2, 0, 3, 1)).reshape(size, size))


def _volume(edges: tuple[Edge, ...], row: int = -1, column: int = -1) -> Array:
    """Integrals over the beam of the products of all shapes, differentiated in these directions; −1: not at all."""
    x, y, z = (edge[row == k, column == k] for k, edge in enumerate(edges))
    return np.asarray(np.kron(np.kron(x, y), z))


def _edge(length: float, count: int, degree: int, points: int) -> Edge:
    """Integrals along `count` elements in a row, by Gauss' rule."""
    x, weights = leggauss(points)
    x, step = (1 + x) / 2, length / count
    polynomials = np.linalg.inv(np.vander(np.linspace(0, 1, degree + 1))).T
    shapes = np.array([np.polyval(one, x) for one in polynomials])
    slopes = np.array([np.polyval(np.polyder(one), x) for one in polynomials]) / step
    found: Edge = {}
    for row, left in ((False, shapes), (True, slopes)):
        for column, right in ((False, shapes), (True, slopes)):
            whole = np.zeros((degree * count + 1,) * 2)
            for begin in range(0, degree * count, degree):
                own = slice(begin, begin + degree + 1)
                whole[own, own] += (left * weights * step / 2) @ right.T
            found[row, column] = whole
    return found
