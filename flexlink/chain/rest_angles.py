"""Rest angles of the hinges of a beam that is curved or twisted at rest, from its curvature κ₀.

As in `compliance`, moments are interpolated between hinges, M = Σ_j ℓ_j M_j. The rotations v_j of the hinges at rest do
the work of the curvature κ₀ for every such M, about each axis of the section:

    Σ_j M_j v_j = ∫ M κ₀ dx        v_j = ∫ ℓ_j κ₀ dx

In cells M is given at Gauss points x_q with weights w_q, and Cᵀ W M are the moments at the hinges: W C v = ∫ ℓ_q κ₀ dx.
By rules on a grid, M is linear between hinges, and beyond the outer ones. So the hinges turn by exactly ∫ κ₀ dx in
sum, and so is the first moment of these turns, whatever κ₀ is (except by elements of one hinge).

The rest angles of a station's hinges are the components of v. Frames before and after the hinges are turned once and
for all, so that all turns together are exp [v]×, and the hinges have the axes of the section halfway; with those at its
beginning, statics would be of order 1. Of three hinges, the second turns the axes of the others by half of its angle in
opposite directions, which an order that alternates from station to station compensates (`lumping_rules`).
"""

from collections.abc import Sequence

import numpy as np

from flexlink.chain.beams import points_between
from flexlink.chain.compliance import MOST_NODES, lagrange
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.link import AXES, Link
from flexlink.describe.rest_shape import Along
from flexlink.describe.schemes.lumping_rules import LumpingRule

Turns = tuple[Array, Sequence[Array | None], Sequence[Array | None]]
"""Angles (N, 3) of the hinges about x, y, z at rest [rad], 0 without a hinge; and turns (3, 3) of the frames before and
after the hinges of each station, or None."""


def turns_at_rest(link: Link, rule: LumpingRule, nodes: Array) -> Turns:
    """Turns of the hinges of a link at rest, or of equally many places of a rigid link."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415  few links are curved

    shape, bends = link.rest_shape or (), [axis - 1 for axis in AXES[link.flex]]
    v = np.transpose([rotations(part, rule, nodes) * link.beam.length for part in shape])
    if not bends:
        return np.zeros_like(v), [*Rotation.from_rotvec(v).as_matrix()], [None] * len(v)
    largest = np.linalg.norm(v, axis=1).max()
    if largest >= np.pi / 2:  # where Euler angles are singular
        text = f"link {link.name!r}: at rest a hinge turns by {np.degrees(largest):.0f}°, which must be less than 90°"
        raise SceneError(f"{text}; use more segments, or check curvature, twist, thermal", id="rest-angle-too-large")
    planar = len(bends) == 1 and not np.delete(v, bends, axis=1).any()
    if planar:
        return v, [None] * len(v), [None] * len(v)
    angles, (before, after) = np.where(np.isin(range(3), bends), v, 0.0), np.empty((2, len(v), 3, 3))
    for start, order in enumerate((bends, bends[:: -1 if rule.alternate_axes else 1])):  # of every second station
        turn = v[start::2]
        if len(turn):
            halfway = turn / 2
            halfway[:, order[0]] *= -1.0  # so that hinges which this one turns are halfway as well
            halfway[:, order[1:-1]] = 0.0
            first = Rotation.from_rotvec(halfway)
            hinges = Rotation.from_euler("".join("XYZ"[axis] for axis in order), turn[:, order])
            before[start::2] = first.as_matrix()
            after[start::2] = ((first * hinges).inv() * Rotation.from_rotvec(turn)).as_matrix()
    return angles, [*before], [*after]


def rotations(κ: Along, rule: LumpingRule, nodes: Array) -> Array:
    """Rotations v of hinges [rad], (N,), due to a curvature κ per length of the beam, about one axis."""
    if rule.cells is not None:
        cell, size = rule.cells.cell, rule.cells.hinges
        WC = cell.weights[:, None] * cell.curvature
        return np.asarray(np.linalg.solve(WC, _shares(κ, cell.points, len(nodes)).reshape(-1, size).T).T.ravel())
    if rule.element is not None:
        return _shares(κ, np.array(rule.element.nodes), len(nodes))
    if len(nodes) == 1 or (rule.jacobi is not None and len(nodes) <= MOST_NODES):
        return _shares(κ, nodes, len(nodes))
    _, x, weight = points_between(np.array([0.0, 1.0]), np.union1d(nodes, κ.x))
    left = np.clip(np.searchsorted(nodes, x) - 1, 0, len(nodes) - 2)
    share, turned = (x - nodes[left]) / (nodes[left + 1] - nodes[left]), weight * κ.at(x)
    found = np.zeros(len(nodes))
    np.add.at(found, [left, left + 1], turned * [1 - share, share])
    return found


def _shares(κ: Along, points: Array, count: int) -> Array:
    """∫ ℓ_j κ dx for the Lagrange polynomials of points in equal parts of the beam, (count,)."""
    parts = count // len(points)
    edges, gauss = np.linspace(0.0, 1.0, parts + 1), np.polynomial.legendre.leggauss(len(points) // 2 + 1)
    owner, x, weight = points_between(edges, κ.x, gauss)
    found = np.zeros((parts, len(points)))
    np.add.at(found, owner, (weight * κ.at(x))[:, None] * lagrange(points, (x - edges[owner]) * parts))
    return found.ravel()
