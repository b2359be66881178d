"""Beams whose hinges are found: of one material and tapering between two sections, or tabulated along their length."""

import dataclasses
import functools

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.material import Section
from flexlink.describe.rigidity import Rigidity

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

    @property
    def off_axis(self) -> bool:
        """Whether the mass of any section is not centred on the axis, or its principal axes are not y and z."""
        return False

    def rotary(self, x: Array) -> Array:
        """Inertia per length of the sections about the axis, shape (*x.shape, 3, 3) [kg m]."""
        i_y, i_z = self.density * self.sections(x)[1:3]
        return inertias(i_y + i_z, i_y, i_z)

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
        """Mass (N,), centre from the slice's start (N, 3), and inertias about it (N, 3, 3) between edges.

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
        return mass, np.outer(center, [1.0, 0.0, 0.0]), inertias(y + z, y + bending, z + bending)


def inertias(*parts: Array) -> Array:
    """Matrices of I_x, I_y, I_z and, if given, I_yz, I_xy, I_xz, shape (N, 3, 3)."""
    found = np.zeros((*parts[0].shape, 3, 3))
    for part, (i, j) in zip(parts, ((0, 0), (1, 1), (2, 2), (1, 2), (0, 1), (0, 2)), strict=False):
        found[..., i, j] = found[..., j, i] = part
    return found


GAUSS = np.polynomial.legendre.leggauss(4)
"""Gauss rule that is exact for linear masses times x², and for their double integrals."""
LARGEST_RATIO = 2.0
"""Largest ratio of rigidities on a piece for ∫ f/EI; 12 Gauss points (more if f has a high degree): error 5.8^−24."""
Points = tuple[NDArray[np.intp], Array, Array]
"""Gauss points between neighbouring edges: index of the slice that contains each point, x, and weight for ∫ dx."""


def points_between(edges: Array, knots: Array, rule: tuple[Array, Array] = GAUSS) -> Points:
    """Quadrature points on every piece; pieces end at the edges, and at the knots between them."""
    if not len(knots) and len(edges) == 2 and edges[0] < edges[1]:  # one piece
        half = (edges[1] - edges[0]) / 2
        return np.zeros(len(rule[0]), np.intp), edges[0] + half * (1 + rule[0]), half * rule[1]
    cuts = np.unique(np.concatenate([edges, knots[(knots > edges[0]) & (knots < edges[-1])]]))
    halves = np.diff(cuts) / 2
    owner = np.clip(np.searchsorted(edges, cuts[:-1], side="right") - 1, 0, len(edges) - 2)
    x, weight = cuts[:-1, None] + halves[:, None] * (1 + rule[0]), halves[:, None] * rule[1]
    return np.repeat(owner, len(rule[0])), x.ravel(), weight.ravel()


@dataclasses.dataclass(frozen=True)
class TableBeam:
    """The continuous link with tabulated properties, x from 0 to 1; see `SectionBeam`."""

    length: float
    table: Rigidity
    strains: tuple[int, ...] = ()  # that its link has: 0 stretch along X, 1 and 2 shear along Y and Z

    @property
    def knots(self) -> Array:
        """Positions of kinks and jumps."""
        return np.unique(self._places)[1:-1]

    @property
    def _places(self) -> Array:
        x = self.table.rows.x
        return np.asarray(x / x[-1])

    @property
    def directions(self) -> list[int]:
        """Rows of K of a section: curvatures (0, 1, 2), and the `strains` of the link (3, 4, 5); others are free."""
        return [0, 1, 2, *(3 + axis for axis in self.strains)]

    @property
    def off_axis(self) -> bool:
        """Whether the mass of any section is not centred on the axis, or its principal axes are not y and z."""
        _, y, z, *_, yz = self.table.rows.masses
        return bool(np.any([y, z, yz]))

    def per_length(self, x: Array) -> Array:
        """Masses of the sections at every x, (7, *x.shape), see `Rows`; at a jump, the value of the outward side."""
        return np.array([np.interp(x, self._places, column) for column in self.table.rows.masses])

    def rigidities(self, x: Array) -> Array:
        """GJ, EI_y, EI_z at every x, shape (3, *x.shape) [N m²]."""
        return np.array([np.interp(x, self._places, column) for column in self.table.rows.rigidities])

    def compliance(self, x: Array) -> Array:
        """Strains of the sections (3 or 6) by forces in `directions`, at every x, shape (N, strains, directions)."""
        rows = self.table.rows.stiffness
        K = [np.interp(x, self._places, column) for column in rows.reshape(len(rows), -1).T]
        return np.asarray(np.linalg.inv(np.transpose(K).reshape(-1, *rows.shape[1:]))[:, :, self.directions])

    def rotary(self, x: Array) -> Array:
        """Inertia per length of the sections about the axis, shape (*x.shape, 3, 3) [kg m]."""
        return inertias(*self.per_length(x)[3:])

    def polar_moments(self, nodes: Array) -> tuple[Array, Array]:
        """∫ p dx and ∫ x p dx, p = I_x L about centres of mass, from each node to the next, or to the end [kg m²]."""
        owner, x, weight = points_between(np.append(nodes, 1.0), self.knots)
        mass, y, z, polar, *_ = weight * self.length * self.per_length(x)
        polar = polar - (y**2 + z**2) / mass
        return _sums(owner, polar, len(nodes)), _sums(owner, x * polar, len(nodes))

    def moments(self, nodes: Array) -> tuple[Array, Array]:
        """As `polar_moments` for p = L (ρA, I_y, I_z), (3, N) each [kg, kg m²]."""
        owner, x, weight = points_between(np.append(nodes, 1.0), self.knots)
        parts = weight * self.length * self.per_length(x)[[0, 4, 5]]
        first, second = (np.array([_sums(owner, p, len(nodes)) for p in each]) for each in (parts, x * parts))
        return first, second

    def masses(self, start: Array, end: Array) -> Array:
        """∫ ρA dx from each start to its end [kg], (N,), negative if the end is before the start."""
        both = np.concatenate([start, end])
        edges = np.unique(np.concatenate([[0.0], both, [1.0]]))
        owner, x, weight = points_between(edges, self.knots)
        pieces = _sums(owner, weight * self.length * self.per_length(x)[0], len(edges) - 1)
        up_to = np.concatenate([[0.0], np.cumsum(pieces)])[np.searchsorted(edges, both)]
        return np.asarray(up_to[len(start) :] - up_to[: len(start)])

    def slices(self, edges: Array) -> tuple[Array, Array, Array]:
        """Mass (N,), centre from the slice's start (N, 3), and inertias about it (N, 3, 3) between edges."""
        owner, x, weight = points_between(edges, self.knots)

        def total(part: Array) -> Array:
            return _sums(owner, part, len(edges) - 1)

        parts = weight * self.length * self.per_length(x)
        away = (x - edges[owner]) * self.length
        mass, my, mz, I_x, I_y, I_z, I_yz = map(total, parts)
        center = np.array([total(parts[0] * away), my, mz]) / mass
        away, (_, y, z) = away - center[0, owner], center
        bending, xy, xz = (total(part * away) for part in (parts[0] * away, -parts[1], -parts[2]))
        I_y, I_z = I_y + bending - mass * z**2, I_z + bending - mass * y**2
        return mass, center.T, inertias(I_x - mass * (y**2 + z**2), I_y, I_z, I_yz + mass * y * z, xy, xz)

    def flexibility(self, edges: Array, degree: int) -> tuple[Points, Array]:
        """Gauss points for ∫ f/GJ, f/EI_y, f/EI_z, f of this degree, and L/GJ, L/EI_y, L/EI_z there, (3, points).

        Of coupled sections: for ∫ f K⁻¹, and L K⁻¹ in its `directions`, (directions, directions, points).
        """
        found = points_between(edges, _fine(self.table), np.polynomial.legendre.leggauss(12 + degree // 2))
        if self.table.coupled:
            return found, self.length * self.compliance(found[1])[:, self.directions].transpose(1, 2, 0)
        return found, self.length / self.rigidities(found[1])


def table_of(arm: Arm, link: Link) -> TableBeam | None:
    """The beam of a link with a table of rigidities; None without one."""
    if link.rigidity is None:
        return None
    axes = link.strain_axes
    return TableBeam(link.beam.length, arm.rigidities[link.rigidity].of_flex(link.flex, axes), axes)


def _sums(owner: NDArray[np.intp], parts: Array, count: int) -> Array:
    """Sum the parts that belong to each of `count` slices."""
    return np.bincount(owner, parts, count).astype(np.float64)


@functools.lru_cache(maxsize=64)
def _fine(table: Rigidity) -> Array:
    """Knots between which no rigidity changes by more than `LARGEST_RATIO`.

    On a piece, K⁻¹ of coupled sections is a sum of terms that change like 1/EI whose EI grows from 1 to an eigenvalue
    λ of K_last v = λ K_first v.
    """
    x, columns = table.rows.x / table.rows.x[-1], table.rows.rigidities
    found = [x]
    for k in np.flatnonzero(np.diff(x) > 0):
        changes = columns[:, k : k + 2]
        if table.coupled:
            start, stop = table.rows.stiffness[k : k + 2]
            changes = np.array([(1.0, λ) for λ in np.linalg.eigvals(np.linalg.solve(start, stop)).real])
        for first, last in changes:
            count = int(np.ceil(abs(np.log(last / first)) / np.log(LARGEST_RATIO)))
            if count > 1:
                between = first * (last / first) ** (np.arange(1, count) / count)
                found.append(x[k] + (x[k + 1] - x[k]) * (between - first) / (last - first))
    return np.unique(np.concatenate(found))
