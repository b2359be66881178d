"""Curvature and surface strain of a link, as strain gauges read them, from the angles of its hinges.

A hinge of weight w stands for a length w L of the beam, k = EI/(w L): its angle is the curvature of this length,
κ = θ/(w L), so that EI κ = k θ. At rest k θ is the bending moment at the hinge itself, whatever the lumping: there the
curvature is that of the beam. Between hinges it is for the reader to interpolate. Where the springs of a cell are
coupled, its angles make the curvature at the cell's Gauss points, which take the place of the hinges:

    κ(x_q) = 1/h Σ_j C_qj θ_j        ε = z κ_y − y κ_z

Where EI is a table, κ = M/EI there, M the moment that the springs hold.

Where springs hold rotation vectors φ, these stand for θ, and in cells of two −φ₁ × φ₂ / (6 h) adds to κ.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.compliance import curvatures
from flexlink.chain.lumping import lump
from flexlink.chain.table_beam import TableBeam
from flexlink.common.errors import ArgumentError
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.describe.hinges import hinges_of
from flexlink.describe.link import AXES
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.dynamics.batches import is_batch, rows
from flexlink.dynamics.result import Result
from flexlink.dynamics.springs import held_angles
from flexlink.kernels.layout import SPRINGS
from flexlink.kernels.tools.finite import is_finite


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class BeamStrain(Result):
    """How a link bends, at its hinges, or at the Gauss points of cells of coupled springs, as many."""

    x: Array  # (hinges,), distance from the root of the beam [m]
    curvature: Array  # (…, hinges, 3), rate of twist φ', then κ about the section's y and z [rad/m]
    strain: Array  # (…, hinges), along the beam, positive in tension [1]

    def __repr__(self) -> str:
        *states, hinges = self.strain.shape
        return f"<BeamStrain: {hinges} hinges{f' in {states[0]} states' if states else ''}>"


def beam_strain(scene: Scene, q: ArrayLike, *, link: str | int, fibre: ArrayLike) -> BeamStrain:
    """Curvature of a link and bending strain of a fibre at its hinges, or at the Gauss points of cells.

    κ = θ/(w L), or what all angles of a cell make of it where its springs are coupled (lumping "lobatto2", "lobatto4");
    off by θ² where a hinge bends and twists at once, unless its springs hold rotation vectors. A chain does not
    stretch: to the strain of bending a gauge adds that of the axial force N, N/(EA), N being
    `internal_loads(…).force[…, 0]`. At the root of the beam, where no hinge is, κ = M/EI with the moment there.

    Parameters
    ----------
    scene
        The scene: a chain does not know the lengths that its hinges stand for.
    q
        Angles [rad], shape (n,), or (b, n) for b states; along a run `run.q`.
    link
        A link that bends, by name, or number from 1.
    fibre
        Place (y, z) of the fibre in the section, from the line through its centroid, shape (2,) [m].

    Returns
    -------
    BeamStrain
        `x` (hinges,), `curvature` (hinges, 3), `strain` (hinges,), the last two with a leading b.

    Raises
    ------
    ArgumentError
        `q` or `fibre` has the wrong shape, is not real or not finite; there is no such link, or it is rigid; a strain
        is beyond float64.
    SceneError, DataFileError
        As of `lump`.

    Examples
    --------
    >>> gauge = fl.strength.beam_strain(scene, q, link="upper", fibre=(0.025, 0.0))
    >>> print(gauge.x.round(3), (1e6 * gauge.strain).round(1))  # m from the root; µm/m
    [0.211 0.789] [194.2 114.8]
    """
    chain, arm = lump(require_type("scene", scene, Scene)), scene.arm
    number = arm.number(link)
    bent, (y, z) = arm.links[number - 1], vector("fibre", fibre, 2)
    if not AXES[bent.flex]:
        raise ArgumentError(
            f"link = {link!r}: is rigid; expected one that bends, with flex of z, yz or xyz", id="link-is-rigid"
        )
    angles = rows(chain.n, {"q": q})[0] if is_batch(q) else vector("q", q, chain.n, many=True)
    nodes, weights = hinges_of(arm)[number - 1]
    rule, length = lumping_rule(bent.lumping), bent.beam.length
    cells = rule.cells
    curvature, held = np.zeros((2, *angles.shape[:-1], len(nodes), 3))
    h = length * (cells.hinges if cells is not None else 1) / len(nodes)
    with np.errstate(over="ignore", invalid="ignore"):
        for axis in AXES[bent.flex]:
            hinges = [chain.index(number, segment, axis) for segment in range(1, len(nodes) + 1)]
            θ = held[..., axis - 1] = held_angles(chain, angles)[..., hinges]
            if bent.rigidity is not None:
                beam = TableBeam(length, arm.rigidities[bent.rigidity])
                curvature[..., axis - 1] = curvatures(beam, rule, (nodes, weights), θ)[axis - 1]
            elif cells is None:
                curvature[..., axis - 1] = θ / (weights * length)
            else:
                curvature[..., axis - 1] = cells.cell.curvatures(θ, h)
        if chain.bodies["springs"][chain.body(hinges[0])] == SPRINGS.cell:
            curvature -= np.repeat(cross(held[..., ::2, :], held[..., 1::2, :]) / (6 * h), 2, axis=-2)
        strain = z * curvature[..., 1] - y * curvature[..., 2]
    if not (is_finite(curvature.reshape(-1)) and is_finite(strain.reshape(-1))):
        raise beyond_float64("a strain", q=angles, fibre=[y, z])
    return BeamStrain(known_at(scene, number) * length, curvature, strain)


def known_at(scene: Scene, number: int) -> Array:
    """Where along the beam of a link the curvature is known, as parts of its length, (hinges,)."""
    nodes, _ = hinges_of(scene.arm)[number - 1]
    cells = lumping_rule(scene.arm.links[number - 1].lumping).cells
    return nodes if cells is None else cells.gauss_points(len(nodes))
