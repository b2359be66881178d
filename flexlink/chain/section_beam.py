"""A beam of one material that tapers between two sections; its mass and inertia are integrated at Gauss points."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.material import Section

GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)


@functools.lru_cache(maxsize=256)
def _sections(root: Section, tip: Section, positions: bytes) -> Array:
    """`SectionBeam.sections` at positions (m,), shape (4, m); beams of all materials share them."""
    x = np.frombuffer(positions)
    if root == tip:
        return np.multiply.outer(root.properties, np.ones(len(x)))
    return np.transpose([root.towards(tip, position) for position in x.tolist()])


@dataclasses.dataclass(frozen=True)
class SectionBeam:
    """The continuous link, x from 0 to 1, whose dimensions vary linearly from the root section to the tip section."""

    length: float
    density: float
    root: Section
    tip: Section

    def sections(self, x: Array) -> Array:
        """Area, I_y, I_z and J at every x, shape (4, *x.shape) [m², m⁴]."""
        return _sections(self.root, self.tip, x.tobytes()).reshape(4, *x.shape)

    @property
    def knots(self) -> Array:
        """Positions of kinks; this beam has none."""
        return np.empty(0)

    def rotary(self, x: Array) -> Array:
        """ρI_y and ρI_z at every x, shape (2, *x.shape) [kg m]."""
        return self.density * self.sections(x)[1:3]

    def polar_moments(self, nodes: Array) -> tuple[Array, Array]:
        """∫ p dx and ∫ x p dx, p = ρ (I_y + I_z) L, from each node to the next, or from the last to the end [kg m²]."""
        x, weight, (_, i_y, i_z, _) = self._beyond(nodes)
        polar = weight * (i_y + i_z)
        return polar.sum(axis=1), (x * polar).sum(axis=1)

    def moments(self, nodes: Array) -> tuple[Array, Array]:
        """As `polar_moments` for p = ρ L (A, I_y, I_z), (3, N) each [kg, kg m²]."""
        x, weight, sections = self._beyond(nodes)
        p = weight * sections[:3]
        return p.sum(axis=-1), (x * p).sum(axis=-1)

    def _beyond(self, nodes: Array) -> tuple[Array, Array, Array]:
        """Four Gauss points from each node to the next or to the end, as in `slices`; ρ L dx, and sections there."""
        edges = np.append(nodes, 1.0)
        half = np.diff(edges)[:, None] / 2
        x = edges[:-1, None] + half * (1 + GAUSS_NODES)
        return x, half * GAUSS_WEIGHTS * self.density * self.length, self.sections(x)

    def shear_factors(self, x: Array) -> Array:
        """Shear correction factors κ for forces along y and z at every x, (2, N); nan if the section has no shape."""
        known = [self.root.shear_factors(self.tip, position) for position in x.tolist()]
        return np.transpose([(np.nan, np.nan) if factors is None else factors for factors in known])

    def masses(self, start: Array, end: Array) -> Array:
        """∫ ρA dx from each start to its end [kg], (N,), negative if the end is before the start."""
        x = start[:, None] + (end - start)[:, None] * (1 + GAUSS_NODES) / 2
        area = self.density * self.length * self.sections(x)[0]
        return np.asarray((area * GAUSS_WEIGHTS).sum(axis=1) * (end - start) / 2)

    def slices(self, edges: Array) -> tuple[Array, Array, Array]:
        """Mass (N,), distance of the centre from the slice's start (N,), and inertias about it (N, 3) between edges.

        Four Gauss points are exact for sections whose area is quadratic and whose I are of degree 4 in x. For a prism
        I_xx = ρl (I_y + I_z), I_yy = ρl I_y + m l²/12, I_zz = ρl I_z + m l²/12.
        """
        u = (GAUSS_NODES + 1) / 2
        part = (edges[1:] - edges[:-1])[:, None]
        x, length = edges[:-1, None] + part * u, part * self.length
        areas, i_y, i_z, _ = self.density * length * GAUSS_WEIGHTS / 2 * self.sections(x)
        mass = areas.sum(axis=1)
        center = (areas * u * length).sum(axis=1) / mass
        bending = (areas * (u * length - center[:, None]) ** 2).sum(axis=1)
        y, z = i_y.sum(axis=1), i_z.sum(axis=1)
        return mass, center, np.array([y + z, y + bending, z + bending]).T
