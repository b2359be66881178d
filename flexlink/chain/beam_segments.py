"""Rigid segments of a beam: slices between hinges or, in cells of coupled springs, segments with exact mass matrix."""

from __future__ import annotations

import functools
import itertools

import numpy as np

from flexlink.chain.rigid import SpatialInertia
from flexlink.chain.section_beam import SectionBeam
from flexlink.chain.table_beam import TableBeam, points_between
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.describe.link import Link
from flexlink.describe.schemes.cells import Cells
from flexlink.describe.schemes.lumping_rules import LumpingRule

Segment = tuple[SpatialInertia | None, tuple[float, float], Array]
"""A segment: its rigid body, the interval of the link that it covers (0 to 1), and its end [m]."""


def segments_of(link: Link, rule: LumpingRule, beam: SectionBeam | TableBeam, nodes: Array) -> list[Segment]:
    """Segments of a link, cached; they do not depend on the stiffness, and identical links share them."""
    if rule.cells is None or not nodes.size:  # a rigid link has no hinges under any rule
        return _segments(beam, nodes.tobytes())
    try:
        return _cell_segments(beam, rule.cells, len(nodes))
    except ArgumentError as error:
        raise SceneError(f"link {link.name!r}: lumping = {link.lumping!r}: {error}") from None


@functools.lru_cache(maxsize=256)
def _segments(beam: SectionBeam | TableBeam, nodes: bytes) -> list[Segment]:
    """Slices of the beam between hinges; a hinge at the root has no slice before it."""
    edges = np.array([0.0, *np.frombuffer(nodes), 1.0])
    slices = zip(*beam.slices(edges), np.diff(edges) * beam.length, strict=True)
    return [
        (SpatialInertia(float(mass), np.array([center, 0, 0]), np.diag(inertia)) if length > 0 else None,
         part, np.array([length, 0, 0]))
        for part, (mass, center, inertia, length) in zip(itertools.pairwise(edges.tolist()), slices, strict=True)
    ]  # fmt: skip


@functools.lru_cache(maxsize=256)
def _cell_segments(beam: SectionBeam | TableBeam, cells: Cells, count: int) -> list[Segment]:
    """Segments with the exact M of a beam whose angle at each Lobatto node s is the angle of the segment there.

    Segment i, from S_i−1 to S_i, contains the node s_i and has length l_i and mass m_i. Its centre c_i, measured from
    the segment's start, follows from m_i c_i = l_i ∫ ρA from s_i to S_i. Its inertia about the centre is

        J_i = l_i [(s_i − S_i−1) ν(s_i) + ∫ ν dx − Σ_j w_j ν(s_j)] − m_i c_i²        ν(x) = ∫ ρA from x to S_i

    The integral extends from s_i to the end of the cell that begins at or contains s_i; the sum includes the cell's
    nodes beyond s_i. The rotary inertia of sections, also about x, is l ρI at s, from ½ ∫ ρI θ̇² by Lobatto quadrature
    of order 2p.
    """
    nodes, lengths = cells.segments(count)
    edges = np.append(0.0, np.cumsum(lengths))
    edges[-1] = 1.0
    mass = beam.slices(edges)[0]
    l = lengths * beam.length
    center = l * beam.masses(nodes, edges[1:]) / mass
    J = np.array([_cell_inertia(beam, cells, i, nodes, edges) for i in range(count + 1)]) - mass * center**2
    rounding = 16 * np.finfo(float).eps * l * (cells.hinges * l.max()) * (cells.hinges * mass.max())
    given = cells.lent(mass[-1], l[-1])
    J[np.abs(J) <= rounding] = 0.0  # the first segment is a point mass at its end, the last one at its hinge
    J[-1] += given
    J[-2] -= given
    if isinstance(beam, TableBeam):
        _pass_on(J)
    if (J < 0).any() and isinstance(beam, TableBeam):
        raise ArgumentError(
            f"the mass per length of its table changes so much within a cell that segment {int(np.argmin(J))} would "
            "have a negative moment of inertia; use more segments, or a rule without cells, such as 'gauss'",
            id="segment-inertia-negative",
        )
    if (J < 0).any():
        raise ArgumentError(
            f"tip = {cells.tip:g}: segment {int(np.argmin(J))} would have a negative moment of inertia; "
            "use a smaller tip in the rule",
            id="segment-inertia-negative",
        )
    y, z = l * beam.rotary(nodes)
    moments = np.column_stack([y + z, J + y, J + z])
    return [
        (SpatialInertia(float(m), np.array([c, 0, 0]), np.diag(I)), part, np.array([length, 0, 0]))
        for part, m, c, I, length in zip(itertools.pairwise(edges.tolist()), mass, center, moments, l, strict=True)
    ]


def _pass_on(J: Array) -> None:
    """Add negative inertias, which occur next to a jump, to the next segment, which turns almost equally; in place."""
    for first, then in ((range(len(J) - 1), 1), (range(len(J) - 1, 0, -1), -1)):
        for i in first:
            if J[i] < 0:
                J[i + then] += J[i]
                J[i] = 0.0


def _cell_inertia(beam: SectionBeam | TableBeam, cells: Cells, i: int, nodes: Array, edges: Array) -> float:
    """Inertia J_i + m_i c_i² of segment i about its start [kg m²], see `_cell_segments`."""
    p, count, L = cells.hinges, len(nodes) - 1, beam.length
    e = min(i // p, count // p - 1)
    beyond = np.arange(i + 1, (e + 1) * p + 1)
    weights = cells.cell.lengths[beyond - e * p] * p / count
    s, start, end, stop = nodes[i], edges[i], edges[i + 1], nodes[(e + 1) * p]
    _, x, weight = points_between(np.array([s, stop]), beam.knots)
    ν = beam.masses(np.concatenate([[s], x, nodes[beyond]]), np.full(1 + len(x) + len(beyond), end))
    integral = weight @ ν[1 : 1 + len(x)]
    return float((end - start) * L**2 * ((s - start) * ν[0] + integral - weights @ ν[1 + len(x) :]))
