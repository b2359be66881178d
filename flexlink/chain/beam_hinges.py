"""Add the segments, hinges and slides of a beam at the running frame of a builder, with their springs.

Spring constants are computed from the rigidities of sections, or from the integrals of a table.
"""

import functools
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.beam_slides import Stations, stations_of
from flexlink.chain.beams import SectionBeam, TableBeam, inertias, points_between
from flexlink.chain.builder import Builder
from flexlink.chain.compliance import cell_constants, coupled_constants, spring_constants
from flexlink.chain.coordinates import Kind
from flexlink.chain.rest_angles import Turns, turns_at_rest
from flexlink.chain.rigid import SpatialInertia
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import AXES, Link
from flexlink.describe.schemes.cells import Cells
from flexlink.describe.schemes.lumping_rules import LumpingRule, lumping_rule
from flexlink.kernels.layout import SLIDES, SPRINGS

TWIST = 1  # number of the twist axis in a `Coordinate`
PAIR = 2  # number of hinges in cells whose springs act on the curvature of the rotation between them
Constants = tuple[Array, Array]
"""K_ii (b, hinges) and K_ij (b, couplings) of b arms, or (hinges,) and (couplings,) of all [N m/rad; N/m of slides]."""


class Springs(NamedTuple):
    """Springs of a beam's hinges, or of its slides."""

    link: Link
    rows: NDArray[np.intp]  # index of each hinge in the chain
    coupled: slice  # range of the beam's couplings among the couplings of the chain
    constants: Callable[[Array, Array], Constants]  # from E and G of b arms, (b, 1) each [Pa]

    def write(self, arms: Sequence[Arm], hinges: NDArray[np.void], couplings: NDArray[np.void]) -> None:
        """Write spring and damping constants of arms that differ in materials, (b, …) each."""
        loss = np.array([arm.loss_time(self.link) for arm in arms])[:, None]
        materials = [] if self.link.material is None else [arm.materials[self.link.material] for arm in arms]
        young = np.array([material.young for material in materials])[:, None]
        k, coupled = self.constants(young, np.array([material.shear for material in materials])[:, None])
        hinges["stiffness"][:, self.rows], hinges["damping"][:, self.rows] = k, loss * k
        couplings["stiffness"][:, self.coupled], couplings["damping"][:, self.coupled] = coupled, loss * coupled


def add_beam(
    builder: Builder, link: Link, number: int, beam: SectionBeam | TableBeam, nodes: Array, weights: Array
) -> list[Springs]:
    """Add segments, hinges and slides of a beam along the x axis of the running frame; return its springs."""
    rule = lumping_rule(link.lumping)
    if link.rest_shape is not None and link.flex == "rigid":
        _add_rigid(builder, link, number, beam)
        return []
    segments, stations = segments_of(link, rule, beam, nodes), None
    rest, before, after = _turns(link, rule, nodes)
    if link.strains:
        stations = stations_of(link, beam, nodes, weights, [body for body, _, _ in segments])
    rotors = np.zeros((3, len(nodes))) if stations is None else stations.inertias.copy()
    rotors[TWIST - 1] += _twist_rotors(link, rule, beam, nodes, weights)
    hinges: Places = {}
    slides: Places = {}
    for segment, (body, part, end) in enumerate(segments):
        if segment and stations is not None and segment % 2:
            slides |= _add_slides(builder, link, number, segment, stations)
        if segment:
            builder.turn(before[segment - 1])
            each = rotors[:, segment - 1].tolist(), rest[segment - 1].tolist()
            hinges |= _add_hinges(builder, link, number, segment, rule, *each)
            builder.turn_section(after[segment - 1])
        if segment and stations is not None and not segment % 2:
            slides |= _add_slides(builder, link, number, segment, stations)
        if body is not None:
            builder.add(body)
        builder.advance(number, part, end)
    if not hinges:
        return []
    if rule.cells is not None and body is not None:
        builder.body.lent = rule.cells.lent(body.mass, end[0])
    if isinstance(beam, TableBeam) and beam.table.coupled:
        moves = hinges | {(SLIDES + axis, station): row for (axis, station), row in slides.items()}
        return [_springs_of_sections(builder, link, beam, nodes, weights, moves)]
    springs = [_springs(builder, link, beam, nodes, weights, hinges)]
    if stations is not None:
        axes, at = np.array(list(slides)).T
        sections, shears, rows = stations.sections[axes, at], axes > 0, np.array(list(slides.values()), dtype=np.intp)

        def constants(young: Array, shear: Array) -> Constants:
            return sections * np.where(shears, shear, young), np.empty(0)

        springs.append(Springs(link, rows, slice(0, 0), constants))
    return springs


Places = dict[tuple[int, int], int]
"""(axis from 0, station along the beam from 0) → index in the chain."""


def _add_hinges(
    builder: Builder, link: Link, number: int, segment: int, rule: LumpingRule, rotors: list[float], rest: list[float]
) -> Places:
    """Add a body with the hinges before a segment."""
    builder.start_body(link=link.beam.frame.T)
    places: Places = {}
    backward = rule.alternate_axes and segment % 2 == 0
    friction = (link.friction.coulomb, link.friction.coulomb_width) if link.friction else ()
    for axis in AXES[link.flex][:: -1 if backward else 1]:
        places[axis - 1, segment - 1] = len(builder.hinges)
        at = Kind.HINGE.at(number, segment, axis - 1)
        builder.add_hinge(at, axis - 1, 0.0, 0.0, *friction, armature=rotors[axis - 1], rest=rest[axis - 1])
    if rule.springs == "rotation" and AXES[link.flex] == AXES["xyz"]:
        leads = rule.cells is not None and rule.cells.hinges == PAIR and segment % PAIR == 1
        builder.body.springs = int(SPRINGS.cell if leads else SPRINGS.rotation)
    return places


def _turns(link: Link, rule: LumpingRule, nodes: Array) -> Turns:
    """Turns of the hinges of a link at rest; refuses springs of rotation vectors, which act on the angles from rest."""
    if link.rest_shape is None:
        return np.zeros((len(nodes), 3)), [None] * len(nodes), [None] * len(nodes)
    if rule.springs == "rotation" and AXES[link.flex] == AXES["xyz"]:
        text = "its springs act on rotations of links that are straight at rest; use 'gauss' or 'lobatto2'"
        raise SceneError(f"link {link.name!r}: lumping = {link.lumping!r}: {text}", id="rotation-curved")
    return turns_at_rest(link, rule, nodes)


def _add_rigid(builder: Builder, link: Link, number: int, beam: SectionBeam | TableBeam) -> None:
    """Add a rigid beam that is curved at rest, as straight pieces of one body."""
    rule = lumping_rule("lobatto4")
    nodes, _ = rule.hinges(128)  # so that the centre of mass of a quarter circle is right to 1e-5 of its length
    _, turns, _ = turns_at_rest(link, rule, nodes)
    for segment, (body, part, end) in enumerate(_segments(beam, nodes.tobytes())):
        if segment:
            builder.turn(turns[segment - 1])
        if body is not None:
            builder.add(body)
        builder.advance(number, part, end)


def _add_slides(builder: Builder, link: Link, number: int, segment: int, stations: Stations) -> Places:
    """Add a body with the slides at the station before a segment."""
    builder.start_body(link=link.beam.frame.T)
    places: Places = {}
    for axis in stations.axes:
        places[axis, segment - 1] = len(builder.hinges)
        at, matched = Kind.STRAIN.at(number, segment, axis), float(stations.masses[axis, segment - 1])
        builder.add_hinge(at, SLIDES + axis, armature=matched)
    return places


def _springs(
    builder: Builder, link: Link, beam: SectionBeam | TableBeam, nodes: Array, weights: Array, places: Places
) -> Springs:
    """Springs of a beam's hinges, and their couplings in cells."""
    rule, rows = lumping_rule(link.lumping), np.array(list(places.values()), dtype=np.intp)
    among = np.array([axis * len(nodes) + hinge for axis, hinge in places], dtype=np.intp)
    if rule.cells is not None:
        return _springs_of_cells(builder, link, rule.cells, beam, len(nodes), places, rows, among)
    none = slice(len(builder.couplings), len(builder.couplings))
    if isinstance(beam, TableBeam):
        k = spring_constants(beam, rule, nodes, weights).reshape(-1)[among]
        return Springs(link, rows, none, lambda young, shear: (k, np.empty(0)))
    sections, lengths = beam.sections(nodes), weights * beam.length

    def constants(young: Array, shear: Array) -> Constants:
        held = _rigidities(sections, young, shear) / lengths
        return held.reshape(len(held), -1)[:, among], np.zeros((len(held), 0))

    return Springs(link, rows, none, constants)


def _springs_of_sections(
    builder: Builder, link: Link, beam: TableBeam, nodes: Array, weights: Array, moves: Places
) -> Springs:
    """As `_springs`, for sections that couple axes: all hinges and slides of a cell or station are coupled."""
    K = coupled_constants(beam, lumping_rule(link.lumping), nodes, weights)
    first, p, row = len(builder.couplings), K.shape[2], {axis: k for k, axis in enumerate(beam.directions)}
    places = dict(sorted(moves.items(), key=lambda move: move[1]))
    own, both = [K[i // p, row[a], i % p, row[a], i % p] for a, i in places], list[float]()
    for cell, members in itertools.groupby(places, lambda place: place[1] // p):
        for (a, i), (b, j) in itertools.combinations(members, 2):
            builder.couplings.append((places[a, i], places[b, j], 0.0, 0.0))
            both.append(float(K[cell, row[a], i % p, row[b], j % p]))
    given, rows = (np.array(own), np.array(both)), np.array(list(places.values()), dtype=np.intp)
    return Springs(link, rows, slice(first, len(builder.couplings)), lambda young, shear: given)


def _springs_of_cells(
    builder: Builder, link: Link, cells: Cells, beam: SectionBeam | TableBeam, count: int, places: Places,
    rows: NDArray[np.intp], among: NDArray[np.intp],
) -> Springs:  # fmt: skip
    """As `_springs`, for cells whose springs are coupled."""
    cell, first, coupling = cells.cell, len(builder.couplings), []
    for about, hinge in sorted(places):  # the hinges of each cell about the same axis are coupled
        number, place = divmod(hinge, cells.hinges)
        for k, (i, j) in enumerate(cell.pairs):
            if i == place:
                builder.couplings.append((places[about, hinge], places[about, hinge + j - i], 0.0, 0.0))
                coupling.append((about, number, k))
    coupled = slice(first, len(builder.couplings))
    axis, e, pair = np.array(coupling, dtype=np.intp).reshape(-1, 3).T
    if isinstance(beam, TableBeam):
        K, (i, j) = cell_constants(beam, cells, count), np.array(cell.pairs).T
        given = K.diagonal(axis1=2, axis2=3).reshape(-1)[among], K[axis, e, i[pair], j[pair]]
        return Springs(link, rows, coupled, lambda young, shear: given)
    number = count // cells.hinges
    sections = beam.sections(cells.gauss_points(count))
    lengths = beam.length / number / np.tile(cell.weights, number)

    def constants(young: Array, shear: Array) -> Constants:
        held = (_rigidities(sections, young, shear) / lengths).reshape(len(young), 3, number, -1)
        own = np.stack([cell.stiffness(i, i, held) for i in range(cells.hinges)], axis=-1)
        both = np.stack([cell.stiffness(i, j, held) for i, j in cell.pairs], axis=-1)
        return own.reshape(len(held), -1)[:, among], both[:, axis, e, pair]

    return Springs(link, rows, coupled, constants)


def _rigidities(sections: Array, young: Array, shear: Array) -> Array:
    """GJ, EI_y, EI_z of b arms at sections (4, N), (b, 3, N) [N m²]."""
    _, i_y, i_z, torsion = sections
    return np.stack([shear * torsion, young * i_y, young * i_z], axis=1)


def _twist_rotors(link: Link, rule: LumpingRule, beam: SectionBeam | TableBeam, nodes: Array, weights: Array) -> Array:
    """Rotor inertias of the twist hinges [kg m²]; raises an error if the twist's mass matrix is not positive definite.

    For this check, A, the articulated inertia about X of the beam beyond a hinge, is computed from the tip inward;
    bodies on the beam, which are left out, could only increase A.
    """
    if not rule.matched_twist or TWIST not in AXES[link.flex]:
        return np.zeros(len(nodes))
    inertias, moments = beam.polar_moments(nodes)
    rotors = rule.twist_inertias(weights, inertias, moments)
    A = 0.0
    for i in reversed(range(len(nodes))):
        A = inertias[i] + A
        if A + rotors[i] <= 0:
            text = f"link {link.name!r}: lumping = {link.lumping!r}: its twist inertia {rotors[i]:.3g} kg m² at hinge "
            text += f"{i + 1} exceeds the inertia beyond it, {A:.3g} kg m², so M is not positive definite; use a rule "
            text += "without matched_twist, such as 'gauss', or more segments"
            raise SceneError(text, id="twist-inertia-outweighs")
        A = A * rotors[i] / (A + rotors[i])
    return rotors


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
        (SpatialInertia(float(mass), center, inertia) if length > 0 else None,
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
    if beam.off_axis:
        text = "its cells need sections whose mass is centred on the axis, with principal axes y and z; use 'gauss'"
        raise ArgumentError(text, id="cells-off-axis")
    J = np.array([_cell_inertia(beam, cells, i, nodes, edges) for i in range(count + 1)]) - mass * center**2
    rounding = 16 * np.finfo(float).eps * l * (cells.hinges * l.max()) * (cells.hinges * mass.max())
    given = cells.lent(mass[-1], l[-1])
    J[np.abs(J) <= rounding] = 0.0  # the first segment is a point mass at its end, the last one at its hinge
    J[-1] += given
    J[-2] -= given
    forward, backward = (range(count), 1), (range(count, 0, -1), -1)
    for order, then in (forward, backward) if isinstance(beam, TableBeam) else ():
        for i in order:  # negative inertias, next to a jump, are added to the next segment, which turns almost equally
            if J[i] < 0:
                J[i + then], J[i] = J[i + then] + J[i], 0.0
    if (J < 0).any():
        text = f"segment {int(np.argmin(J))} would have a negative moment of inertia; use "
        if isinstance(beam, TableBeam):
            text = f"the mass per length of its table changes so much within a cell that {text}"
            text += "more segments, or a rule without cells, such as 'gauss'"
        else:
            text = f"tip = {cells.tip:g}: {text}a smaller tip in the rule"
        raise ArgumentError(text, id="segment-inertia-negative")
    moments = l[:, None, None] * beam.rotary(nodes) + inertias(np.zeros(len(J)), J, J)
    return [
        (SpatialInertia(float(m), np.array([c, 0, 0]), I), part, np.array([length, 0, 0]))
        for part, m, c, I, length in zip(itertools.pairwise(edges.tolist()), mass, center, moments, l, strict=True)
    ]


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
