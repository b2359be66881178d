"""Slides of a beam that shears or stretches: springs at the stations of its hinges, along the axes of the section.

A slide represents the same length w L of the beam as the hinges of its station. Its coordinate is the integral of the
strain over this length [m], and its stiffness is EA/(w L) for stretch ε, κGA/(w L) for shear γ. In a plane, with the
angle θ of the sections, a prime for d/dx, normal force N and shear force Q (Reissner 1972; Timoshenko 1921):

    X' = (1 + ε) cos θ − γ sin θ      Y' = (1 + ε) sin θ + γ cos θ      ε = N/EA      γ = Q/κGA

A table with a stiffness 6 × 6 couples the slides and hinges of a station (`compliance`).

A slide is inboard of the hinges at the first, third, … station and outboard at the others: strains have the direction
of the mean section at the station up to errors of order 2 instead of 1.

The inertial force at x due to strain at y, ∫ ρA dξ from max(x, y) to the tip, has a kink at x = y, as has the inertial
moment ∫ ρI dξ. Kinks limit frequencies to order 2. `matched_inertias` in slides and, if the beam shears, in its bending
hinges raise it to 4 if the rule is exact for quadratics. They are negative; where they would make M indefinite, in
slender beams of few segments, they are left out: there, shear changes less than the error of bending. They are also
left out if the mass of a section is off the axis, whose kinks join twist, bending and strains: order 2.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexlink.chain.beams import SectionBeam, TableBeam
from flexlink.chain.rigid import SpatialInertia
from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.link import AXES, Link
from flexlink.describe.schemes.lumping_rules import exact_for_quadratics, lumping_rule, matched_inertias


class Stations(NamedTuple):
    """Slides and matched inertias of a beam, by station, from the root outward."""

    axes: tuple[int, ...]  # of the slides: 0 stretch along X, 1 and 2 shear along Y and Z
    sections: Array  # (3, N) A/(w L) of stretch, κA/(w L) of shear along y and z [m]; nan for a table
    masses: Array  # (3, N) matched inertia of the slides along x, y, z [kg]
    inertias: Array  # (3, N) matched inertia of the hinges about x (none), y, z [kg m²]


def stations_of(
    link: Link, beam: SectionBeam | TableBeam, nodes: Array, weights: Array, segments: Sequence[SpatialInertia | None]
) -> Stations:
    """Slides of a link that shears or stretches; refuses rules with cells, and shear of a section without a shape."""
    rule, axes = lumping_rule(link.lumping), link.strain_axes
    if rule.cells is not None:
        text = "a rule with cells has neither shear nor stretch; use 'gauss', which then also has order 4"
        raise SceneError(f"link {link.name!r}: lumping = {link.lumping!r}: {text}", id="cells-without-strains")
    if isinstance(beam, TableBeam):
        if rule.springs == "rotation" and len(AXES[link.flex]) > 1:
            text = "its springs, which act on rotations, are not coupled with shear and stretch; use 'gauss'"
            raise SceneError(f"link {link.name!r}: lumping = {link.lumping!r}: {text}", id="rotation-with-strains")
        sections = np.full((3, len(nodes)), np.nan)
    else:
        sections = _sections(link, beam, nodes, weights)
    stations = Stations(axes, sections, *np.zeros((2, 3, len(nodes))))
    if exact_for_quadratics(nodes, weights) and not beam.off_axis:
        mass, I_y, I_z = matched_inertias(weights, *beam.moments(nodes))
        for slide, turn, rotors in ((0, 0, np.zeros(len(nodes))), (1, 2, I_z), (2, 1, I_y)):
            if slide in axes and _positive(np.array([mass, rotors]), turn, nodes * beam.length, segments):
                stations.masses[slide], stations.inertias[turn] = mass, rotors
    return stations


def _sections(link: Link, beam: SectionBeam, nodes: Array, weights: Array) -> Array:
    """`Stations.sections` of a beam of one material."""
    factors = np.full((2, len(nodes)), link.shear) if type(link.shear) is float else beam.shear_factors(nodes)
    if link.shear and not np.isfinite(factors).all():
        text = "a general section has no known shape; give its shear correction factor, such as shear = 0.85"
        raise SceneError(f"link {link.name!r}: shear = true: {text}", id="shear-factor-unknown")
    return np.asarray(beam.sections(nodes)[0] / (weights * beam.length) * np.vstack([np.ones(len(nodes)), factors]))


def _positive(rotors: Array, turn: int, x: Array, segments: Sequence[SpatialInertia | None]) -> bool:
    """Whether M of the straight beam, moved by slides and hinges about axis `turn`, remains positive definite.

    From the tip inward, A is the articulated inertia beyond a station, in the coordinates of its slide and hinge.
    Without lever, along X, they are independent. Bodies on the beam, which are left out, could only increase A. The
    margin is for bent postures.
    """
    margin, lever, A = 1.25, float(turn > 0), np.zeros((2, 2))
    for k in reversed(range(len(x))):
        body, step = segments[k + 1], x[k + 1] - x[k] if k + 1 < len(x) else 0.0
        arm = np.array([[1.0, lever * step], [0.0, 1.0]])
        A = arm.T @ A @ arm
        if body is not None:
            m, c, J = body.mass, lever * float(body.center[0]), float(body.inertia[turn, turn])
            A += [[m, m * c], [m * c, J + m * c**2]]
        D = A + margin * np.diag(rotors[:, k])
        if not (np.diag(D) > 0).all() or np.linalg.det(D) <= 0:
            return False
        A = A - A @ np.linalg.solve(D, A)
    return True
