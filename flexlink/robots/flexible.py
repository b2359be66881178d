"""Specification of a robot's flexible link, and the beam computed from it.

Split a rigid link into a beam with a rigid body at each end; total mass, centre and inertia are preserved exactly.

    link = beam + root + end

The remainder, link − beam, has mass m, centre c and covariance Σ. The lever rule divides it: the end body gets the
fraction s = (c − a)·x̂ / L of the mass, for a beam of length L from a along x̂. The second moment along the line is
preserved by centres at c − v √(s / (1 − s) m) and c + v √((1 − s) / s m), v = Σ x̂ / √(x̂ᵀ Σ x̂). The second moment
across the line, the Schur complement Σ − v vᵀ ⪰ 0, is divided in the same ratio. Both bodies are physically possible
if the remainder is.

Largest mass of a beam: the second moments of the remainder, J − m J₁, must be positive semidefinite, so

    J − m J₁ ⪰ 0,   J₁: moments of the beam per kilogram   ⇔   m ≤ 1 / λ_max(J₁ x = λ J x)
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.rigid import NOTHING, Pose, SpatialInertia, body_with
from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.directions import Line, line_of
from flexlink.describe.link import Link
from flexlink.describe.material import Damping, Material, Section
from flexlink.describe.rigid_body import ROUNDING, RigidBody
from flexlink.describe.spec import Positive, Spec, Vector3
from flexlink.robots.paths import Part


class FlexibleLink(Spec, frozen=True):
    """Line, material and segments of a link's beam.

    The beam has `section` and `material`. If `mass` [kg] is given, it determines the density. If `frequency_hz` [Hz] is
    given, it determines Young's modulus; it is the first frequency of the link clamped at its joint, with everything
    beyond it rigid, in the initial configuration, without gravity. If only the frequency is given, the section is a
    thin tube with a diameter of a tenth of its length, and the mass is half the largest mass that the link allows.

    `line`, from one point of the link's frame to another [m], is the straight line from joint to joint by default;
    `up`, `flex`, `segments`, `lumping` and `damping` are as in `Link`.

    Examples
    --------
    >>> measured = fl.FlexibleLink(frequency_hz=12.0)  # a thin tube with this frequency, clamped at its joint
    >>> tube = fl.FlexibleLink(section=fl.Section(shape="tube", outer=0.08, inner=0.074), segments=7)
    >>> print(measured, tube.flex)
    FlexibleLink(frequency_hz=12.0) yz
    """

    section: Section | None = None
    """Section of the beam. Default, with `frequency_hz`: a thin tube with a diameter of a tenth of the length."""
    material: Material = Material(young=70e9, density=2700.0, poisson=0.33)
    """Material of the beam."""
    mass: Positive | None = None
    """Mass of the beam [kg], which is subtracted from the link's mass and determines the density."""
    frequency_hz: Positive | None = None
    """First frequency of the link clamped at its joint, with all parts beyond it rigid [Hz]; it determines E."""
    line: tuple[Vector3, Vector3] | None = None
    """Start and end of the beam in the link's frame [m]. Default: from joint to joint."""
    up: Vector3 | None = None
    """Direction of the section's z in the link's frame. Default: the joint's axis."""
    flex: Literal["z", "yz", "xyz"] = "yz"
    """Bending axes: z, y and z, or y and z with twist about x, in axes of the section."""
    segments: Annotated[int, msgspec.Meta(ge=2, le=1001)] = 5
    """Number of rigid segments of the link."""
    lumping: str = "gauss"
    """Lumping rule, which places the hinges: its name, or the path of a rule file."""
    damping: Damping | None = None
    """Damping of the link's bending."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.section is None and self.frequency_hz is None:
            raise SceneError("section: missing; give section or frequency_hz", id="missing-key")


class ImportedLink(NamedTuple):
    """A link of a scene; if it is flexible, also its material, section, note and warning."""

    link: Link
    material: Material | None = None
    section: Section | None = None
    remark: Diagnostic | None = None
    warning: Diagnostic | None = None


def slender_mass(part: Part, next_origin: Array) -> float:
    """Return the largest mass [kg] of a thin beam from joint to joint; 0 if the joints coincide."""
    if not next_origin.any():
        return 0.0
    line = line_of(_joint_to_joint(next_origin), None, part.joint.axis)
    thin = SpatialInertia(1.0, np.array([line.length / 2, 0, 0]), np.diag([0.0, 1.0, 1.0]) * line.length**2 / 12)
    return largest_mass(part.body, thin.moved(_pose(line)))


def _joint_to_joint(next_origin: Array) -> tuple[Vector3, Vector3]:
    x, y, z = next_origin.tolist()
    return (0.0, 0.0, 0.0), (x, y, z)


def bent(part: Part, rigid: Link, flexible: FlexibleLink, next_origin: Array) -> ImportedLink:
    """Make a rigid link flexible; without `line`, its beam ends at the origin of the next joint in its frame [m]."""
    if not part.body.mass:
        why = f"flexible: link {truncated(part.link)}: has no mass; give it an <inertial>, or bend another link"
        raise ArgumentError(why, id="no-mass")
    ends = flexible.line or _joint_to_joint(next_origin)
    line = line_of(ends, flexible.up, part.joint.axis)
    outer = line.length / 10
    section = flexible.section or Section(shape="tube", outer=outer, inner=outer * (1 - 2 / 20))
    largest = largest_mass(part.body, _prism(section, 1.0, line))
    volume = section.properties.area * line.length
    of_material = flexible.section is not None and flexible.mass is None
    mass = flexible.material.density * volume if of_material else flexible.mass or 0.5 * largest
    if not 0 < mass < largest * (1 - 1e-6):  # at the largest mass, the remainder is a point or a needle
        why = f"a beam of {mass:.4g} kg does not fit into the link's mass, {part.body.mass:.4g} kg, and inertia"
        smaller = "a smaller" if flexible.mass else "a"
        remedy = f"give {smaller} mass, a section that is lighter and thinner, or another line"
        text = f"flexible: link {truncated(part.link)}: {why}; at most {rounded_down(largest)} kg fits; {remedy}"
        raise ArgumentError(text, id="beam-heavier-than-link")
    root, end = cut(part.body, _prism(section, mass, line), _pose(line), line.length)
    link = msgspec.structs.replace(
        rigid, line=ends, up=flexible.up, flex=flexible.flex, segments=flexible.segments, lumping=flexible.lumping,
        damping=flexible.damping, material=rigid.name, section=rigid.name, hub=payload(root),
        end=payload(end.moved(Pose(np.eye(3), -np.array(ends[1])))),
    )  # fmt: skip
    material = msgspec.structs.replace(flexible.material, density=mass / volume)
    text = f"{part.link}: beam of {mass:.4g} kg and {line.length:.4g} m, from the link's {part.body.mass:.4g} kg"
    remark = Diagnostic(text, "flexible-link")
    return ImportedLink(link, material, section, remark, _warning(part, flexible, largest, line.length))


def _warning(part: Part, flexible: FlexibleLink, largest: float, length: float) -> Diagnostic | None:
    share = largest / part.body.mass
    if share >= 0.1:
        return None
    beam, remedy = ("along `line`", "check `line`") if flexible.line else ("from joint to joint", "set `line`")
    if length > 100.0:
        remedy = f"likely given in mm: in SI {length / 1e3:.4g} m; write the file's lengths in m"
    carries = f"can carry only {100 * share:.2g} % of the link's mass"
    return Diagnostic(f"{part.link}: a beam {beam}, {length:.4g} m, {carries}; {remedy}", "beam-light")


def payload(body: SpatialInertia) -> RigidBody:
    """Return a body as a `RigidBody`; an inertia that no body has due to rounding of a sum alone is corrected.

    That is an error of at most `ROUNDING` relative to the second moment about the origin; a larger one is kept.
    """
    given = _rigid_body(body)
    λ, V = np.linalg.eigh(body.covariance)
    if not given.excess or λ[0] < -ROUNDING * (λ[-1] + body.mass * body.center @ body.center):
        return given
    return _rigid_body(body_with(body.mass, body.center, (V * np.maximum(λ, 0.0)) @ V.T))


def _rigid_body(body: SpatialInertia) -> RigidBody:
    """Return a body as a `RigidBody`, with three moments only if all products of inertia are zero."""
    inertia = (body.inertia + body.inertia.T) / 2
    xx, yy, zz, *products = (float(inertia[j, k]) for j, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    x, y, z = body.center.tolist()
    moments = (xx, yy, zz, *(products if any(products) else ()))
    return RigidBody(mass=float(body.mass), center=(x, y, z), inertia=moments)


def rounded_down(value: float) -> str:
    """Format a positive number with four digits, rounded down."""
    if value <= 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return f"{math.floor(value / unit) * unit:.4g}"


def _prism(section: Section, mass: float, line: Line) -> SpatialInertia:
    """Return a uniform beam, I = m diag((I_y + I_z)/A, I_y/A + L²/12, I_z/A + L²/12), in the link's frame."""
    area, i_y, i_z, _ = section.properties
    L = line.length
    inertia = mass * np.diag([(i_y + i_z) / area, i_y / area + L**2 / 12, i_z / area + L**2 / 12])
    return SpatialInertia(mass, np.array([L / 2, 0, 0]), inertia).moved(_pose(line))


def _pose(line: Line) -> Pose:
    return Pose(line.frame, line.start)


def largest_mass(link: SpatialInertia, beam: SpatialInertia) -> float:
    """Return the largest mass [kg] that a beam of this shape, of any mass, can take from a link in the same frame."""
    J, J1 = link.moments, beam.moments / beam.mass
    flat = 1e-12  # relative squared extent below which a body counts as a plate or rod; files contain rounded numbers
    extent = max(J.diagonal()[1:].max(), 0.0) or 1.0
    size = np.sqrt(np.where(J.diagonal() > flat * extent, J.diagonal(), extent))
    squares, axes = np.linalg.eigh(J / np.outer(size, size))
    J1 = axes.T @ (J1 / np.outer(size, size)) @ axes
    there = squares > flat
    if (np.diag(J1)[~there] > flat * np.trace(J1)).any():  # the beam is thick in a direction in which the link is flat
        return 0.0
    scale = np.sqrt(squares[there])
    λ = np.linalg.eigvalsh(J1[np.ix_(there, there)] / np.outer(scale, scale))[-1]
    return float(1 / λ)


def cut(link: SpatialInertia, beam: SpatialInertia, line: Pose, length: float) -> tuple[SpatialInertia, SpatialInertia]:
    """Return the remaining bodies at the root and the end of a beam along x of `line`, in the link's frame."""
    about = Pose(line.R, link.center)  # along the line, at the link's centre, where subtraction loses no digits
    whole, part = link.moved(about.inverse), beam.moved(about.inverse)
    rest = whole.moments - part.moments
    mass, first = rest[0, 0], rest[0, 1:]
    c = first / mass
    Σ = rest[1:, 1:] - np.outer(first, first) / mass
    s = float((c + line.R.T @ (link.center - line.p))[0] / length)
    if not 0 < s < 1 or Σ[0, 0] <= 0:
        one = body_with(mass, c, Σ).moved(about)
        return (one, NOTHING) if s < 0.5 else (NOTHING, one)
    v = Σ[:, 0] / np.sqrt(Σ[0, 0])
    across = np.zeros((3, 3))
    across[1:, 1:] = Σ[1:, 1:] - np.outer(v[1:], v[1:])
    root = body_with((1 - s) * mass, c - v * np.sqrt(s / ((1 - s) * mass)), (1 - s) * across)
    end = body_with(s * mass, c + v * np.sqrt((1 - s) / (s * mass)), s * across)
    return root.moved(about), end.moved(about)
