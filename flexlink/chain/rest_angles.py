"""Rest angles of the hinges of a beam that is curved or twisted at rest, from its curvature κ₀.

As in `compliance`, moments are interpolated between hinges, M = Σ_j ℓ_j M_j. The rotations v_j of the hinges at rest do
the work of the curvature κ₀ for every such M, about each axis of the section:

    Σ_j M_j v_j = ∫ M κ₀ dx        v_j = ∫ ℓ_j κ₀ dx

In cells M is given at Gauss points x_q with weights w_q, and Cᵀ W M are the moments at the hinges: W C v = ∫ ℓ_q κ₀ dx.
By rules on a grid, M is linear between hinges, and beyond the outer ones. So the hinges turn by exactly ∫ κ₀ dx in
sum, and so is the first moment of these turns, whatever κ₀ is (except by elements of one hinge).

The rest angles of a station are the Euler angles of its rotation exp [v]×, in the order of its hinges; about axes in
which the link does not bend, its body is turned once and for all before them.
"""

import numpy as np

from flexlink.chain.beams import points_between
from flexlink.chain.compliance import MOST_NODES, lagrange
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.link import AXES, Link
from flexlink.describe.rest_shape import Along
from flexlink.describe.schemes.lumping_rules import LumpingRule

Turns = tuple[Array, Array | None]
"""Angles (N, 3) of the hinges about x, y, z at rest [rad], 0 if there is no hinge about an axis; and turns (N, 3, 3)
before the hinges, about axes in which the link does not bend, or None."""


def turns_at_rest(link: Link, rule: LumpingRule, nodes: Array) -> Turns:
    """Turns of the hinges of a link at rest, or of equally many places of a rigid link."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415  few links are curved

    shape, bends = link.rest_shape or (), [axis - 1 for axis in AXES[link.flex]]
    v = np.transpose([rotations(part, rule, nodes) * link.beam.length for part in shape])
    if not bends:
        return np.zeros_like(v), Rotation.from_rotvec(v).as_matrix()
    largest = np.linalg.norm(v, axis=1).max()
    if largest >= np.pi / 2:  # where Euler angles are singular
        text = f"link {link.name!r}: at rest a hinge turns by {np.degrees(largest):.0f}°, which must be less than 90°"
        raise SceneError(f"{text}; use more segments, or check curvature, twist, thermal", id="rest-angle-too-large")
    stiff, angles = [axis for axis in range(3) if axis not in bends], v.copy()
    in_space = (v != 0).sum(axis=1) > 1
    from_z = rule.alternate_axes & (np.arange(len(v)) % 2 == 1)  # stations whose hinges have the order Z, Y, X
    for reverse in (False, True):
        order = stiff + bends[:: -1 if reverse else 1]
        these = np.flatnonzero(in_space & (from_z == reverse))
        if len(these):
            angles[np.ix_(these, np.array(order))] = Rotation.from_rotvec(v[these]).as_euler(_names(order))
    fixed = Rotation.from_euler(_names(stiff), angles[:, stiff]).as_matrix() if angles[:, stiff].any() else None
    angles[:, stiff] = 0.0
    return angles, fixed


def _names(axes: list[int]) -> str:
    return "".join("XYZ"[axis] for axis in axes)


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
