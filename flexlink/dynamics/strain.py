"""Curvature and surface strain of a link, as strain gauges measure them, from its hinge angles.

A hinge of weight w represents a length w L of the beam and has the stiffness k = EI/(w L). Its angle θ is the integral
of the curvature over this length, so κ = θ/(w L) and EI κ = k θ. At rest, k θ is the bending moment at the hinge and κ
the beam's curvature there, for every lumping rule. If the springs of a cell are coupled, its angles determine the
curvature at the cell's Gauss points instead:

    κ(x_q) = 1/h Σ_j C_qj θ_j        strain ε = ε₀ + z κ_y − y κ_z

For a link that is curved at rest, θ is measured from the rest angles, and κ from its curvature at rest.
The axis is strained, ε₀ = u/(w L) from the slide u of a station, if the link stretches; otherwise ε₀ = 0.

If EI is given by a table, κ = M/EI at these points, where M is the moment in the springs; κ = K⁻¹ M if sections couple
axes, which yields ε₀ too if K is 6 × 6.

If springs act on rotation vectors φ, these replace θ, and cells with two of them add −φ₁ × φ₂ / (6 h) to κ.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from flexlink.chain.arguments import beyond_float64, require_type, vector
from flexlink.chain.beams import table_of
from flexlink.chain.compliance import curvatures, section_forces
from flexlink.chain.coordinates import Kind
from flexlink.chain.lumping import lump, open_chain
from flexlink.common.errors import ArgumentError
from flexlink.common.products import cross
from flexlink.common.types import Array
from flexlink.describe.hinges import hinges_of
from flexlink.describe.link import AXES
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.dynamics.batches import is_batch, rows
from flexlink.dynamics.forces import held_angles
from flexlink.dynamics.result import Result
from flexlink.kernels.layout import SPRINGS
from flexlink.kernels.tools.finite import is_finite


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class BeamStrain(Result):
    """Curvature and strain of a link at its hinges, or, in coupled cells, at equally many Gauss points."""

    x: Array  # (hinges,), distance from the root of the beam [m]
    curvature: Array  # (…, hinges, 3), twist per length φ', then κ about the section's y and z [rad/m]
    strain: Array  # (…, hinges), along the beam, positive in tension [1]

    def __repr__(self) -> str:
        *states, hinges = self.strain.shape
        return f"<BeamStrain: {hinges} hinges{f' in {states[0]} states' if states else ''}>"


def beam_strain(scene: Scene, q: ArrayLike, *, link: str | int, fibre: ArrayLike) -> BeamStrain:
    """Return the curvature of a link and the strain of a fibre at its hinges, or at the Gauss points of cells.

    κ = θ/(w L), less the curvature at rest; in cells of coupled springs (lumping "lobatto2", "lobatto4") it follows
    from all angles of the cell. The error is of order θ² if a hinge bends and twists at once, unless its springs act on
    rotation vectors. The root of the beam has no hinge; there κ = M/EI. The strain contains that of the axis, N/(EA),
    if the link has `stretch`. Otherwise add it, since a gauge measures it, with N from `internal_loads(…).N`.

    Parameters
    ----------
    scene
        The scene; a chain does not contain the lengths that its hinges represent.
    q
        Angles [rad], shape (n,), or (b, n) for b states; for a simulation `run.q`.
    link
        Name or number (from 1) of a flexible link.
    fibre
        Position (y, z) of the fibre in the section, relative to its centroid, shape (2,) [m].

    Returns
    -------
    BeamStrain
        `x` (hinges,), `curvature` (hinges, 3), `strain` (hinges,); the last two with a leading axis b.

    Raises
    ------
    ArgumentError
        `q` or `fibre` has the wrong shape, is not real or not finite; there is no such link, or it is rigid; a strain
        is beyond float64.
    SceneError, DataFileError
        As in `lump`.

    Examples
    --------
    >>> gauge = fl.strength.beam_strain(scene, q, link="upper", fibre=(0.025, 0.0))
    >>> print(gauge.x.round(3), (1e6 * gauge.strain).round(1))  # m from the root; µm/m
    [0.211 0.789] [194.2 114.8]
    """
    return strains_in(scene, q, link, fibre)[0]


def strains_in(scene: Scene, q: ArrayLike, link: str | int, fibre: ArrayLike) -> tuple[BeamStrain, Array]:
    """As `beam_strain`, and all strains of sections given by a coupled table, (…, hinges, 3 or 6), as in its `Rows`."""
    chain, arm = lump(open_chain(require_type("scene", scene, Scene))), scene.arm
    number = arm.number(link)
    bent, (y, z) = arm.links[number - 1], vector("fibre", fibre, 2)
    if not AXES[bent.flex]:
        why = f"link = {link!r}: is rigid; expected a link that bends, with flex z, yz or xyz"
        raise ArgumentError(why, id="link-is-rigid")
    angles = rows(chain.n, {"q": q})[0] if is_batch(q) else vector("q", q, chain.n, many=True)
    nodes, weights = hinges_of(arm)[number - 1]
    rule, length = lumping_rule(bent.lumping), bent.beam.length
    cells = rule.cells
    curvature, held = np.zeros((2, *angles.shape[:-1], len(nodes), 3))
    beam = table_of(arm, bent)
    coupled, strains = beam is not None and beam.table.coupled, np.empty(0)
    h = length * (cells.hinges if cells is not None else 1) / len(nodes)
    with np.errstate(over="ignore", invalid="ignore"):
        moved = held_angles(chain, angles) - chain.rest
        for axis in AXES[bent.flex]:
            hinges = [chain.index(number, segment, axis) for segment in range(1, len(nodes) + 1)]
            θ = held[..., axis - 1] = moved[..., hinges]
            if beam is not None and not coupled:
                curvature[..., axis - 1] = curvatures(beam, rule, (nodes, weights), θ)[axis - 1]
            elif cells is None:
                curvature[..., axis - 1] = θ / (weights * length)
            else:
                curvature[..., axis - 1] = cells.cell.curvatures(θ, h)
        stations = (chain.where(Kind.STRAIN, link=number, axis=Kind.STRAIN.first + axis) for axis in bent.strain_axes)
        stretched = [moved[..., rows] for rows in stations]
        if beam is not None and coupled:
            each = np.concatenate([held, *(part[..., None] for part in stretched)], axis=-1)
            forces = section_forces(beam, rule, (nodes, weights), each)
            strains = (beam.compliance(known_at(scene, number)) @ forces[..., None])[..., 0]
            curvature = strains[..., :3]
        if chain.bodies["springs"][chain.body(hinges[0])] == SPRINGS.cell:
            curvature -= np.repeat(cross(held[..., ::2, :], held[..., 1::2, :]) / (6 * h), 2, axis=-2)
        strain = z * curvature[..., 1] - y * curvature[..., 2]
        if strains.shape[-1] > 3:
            strain += strains[..., 3]
        elif bent.stretch:
            strain += stretched[0] / (weights * length)
    if not (is_finite(curvature.reshape(-1)) and is_finite(strain.reshape(-1))):
        raise beyond_float64("a strain", q=angles, fibre=[y, z])
    return BeamStrain(known_at(scene, number) * length, curvature, strain), strains


def known_at(scene: Scene, number: int) -> Array:
    """Positions along a link's beam at which the curvature is known, as fractions of its length, (hinges,)."""
    nodes, _ = hinges_of(scene.arm)[number - 1]
    cells = lumping_rule(scene.arm.links[number - 1].lumping).cells
    return nodes if cells is None else cells.gauss_points(len(nodes))
