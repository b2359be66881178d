"""How a link of a robot is to bend, and the beam that comes of it."""

from __future__ import annotations

import math
from typing import Annotated, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.rigid import Pose, SpatialInertia, body_with
from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.directions import Line, line_of
from flexlink.describe.link import Link
from flexlink.describe.material import Damping, Material, Section
from flexlink.describe.rigid_body import ROUNDING, RigidBody
from flexlink.describe.spec import Positive, Spec, Vector3
from flexlink.robots.cut import cut, largest_mass
from flexlink.robots.paths import Part


class FlexibleLink(Spec, frozen=True):
    """Of one link: where its beam runs, what it is made of, and how it is cut into segments.

    The beam has `section` and `material`; with `mass` [kg] the density follows from that, and with `frequency_hz` [Hz]
    Young's modulus: it is then the first frequency of the link clamped at its joint, everything beyond it rigid, at the
    posture in which the arm starts, without gravity. Of a beam of which only the frequency is known, the section is a
    thin tube of a tenth of its length, and the mass half of the largest that the link can give.

    `line`, from one point of the link's frame to another [m], is by default the straight line from joint to joint;
    `up`, `flex`, `segments`, `lumping` and `damping` are those of `Link`.

    Examples
    --------
    >>> measured = fl.FlexibleLink(frequency_hz=12.0)  # a thin tube that swings so, clamped at its joint
    >>> tube = fl.FlexibleLink(section=fl.Section(shape="tube", outer=0.08, inner=0.074), segments=7)
    >>> print(measured, tube.flex)
    FlexibleLink(frequency_hz=12.0) yz
    """

    section: Section | None = None
    """The beam's section; with `frequency_hz` it may be left out: a thin tube of a tenth of the length."""
    material: Material = Material(young=70e9, density=2700.0, poisson=0.33)
    """What the beam is made of."""
    mass: Positive | None = None
    """The beam's part of the link's mass [kg]; the density follows from it."""
    frequency_hz: Positive | None = None
    """First frequency of the link clamped at its joint, all beyond it rigid [Hz]; E follows from it."""
    line: tuple[Vector3, Vector3] | None = None
    """Where the beam runs in the link's frame [m]. Default: from joint to joint."""
    up: Vector3 | None = None
    """Direction of the section's z in the link's frame. Default: the joint's axis."""
    flex: Literal["z", "yz", "xyz"] = "yz"
    """How the link bends: about the section's z, about y and z, or with twist, too."""
    segments: Annotated[int, msgspec.Meta(ge=2, le=1001)] = 5
    """Rigid segments of the link."""
    lumping: str = "gauss"
    """Where the hinges sit: a rule's name, or the path of a rule's file."""
    damping: Damping | None = None
    """Damping of the link's bending."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.section is None and self.frequency_hz is None:
            raise SceneError("section: missing; give section or frequency_hz", id="missing-key")


class ImportedLink(NamedTuple):
    """A link of a scene; of one that bends, its own material and section, what is to be said, and what is in doubt."""

    link: Link
    material: Material | None = None
    section: Section | None = None
    remark: str = ""
    warning: str = ""


def joint_to_joint(next_origin: Array) -> tuple[Vector3, Vector3]:
    """The line from a link's joint to the next one, in the link's frame [m]."""
    x, y, z = next_origin.tolist()
    return (0.0, 0.0, 0.0), (x, y, z)


def slender_mass(part: Part, next_origin: Array) -> float:
    """The largest mass [kg] of a thin beam from joint to joint; 0 where they have no distance."""
    ends = joint_to_joint(next_origin)
    if ends[0] == ends[1]:
        return 0.0
    line = line_of(ends, None, part.joint.axis)
    thin = SpatialInertia(1.0, np.array([line.length / 2, 0, 0]), np.diag([0.0, 1.0, 1.0]) * line.length**2 / 12)
    return largest_mass(part.body, thin.moved(_pose(line)))


def bent(part: Part, rigid: Link, flexible: FlexibleLink, next_origin: Array) -> ImportedLink:
    """Make a rigid link flexible.

    Parameters
    ----------
    part
        The link's body.
    rigid
        The link, rigid.
    flexible
        What is asked for.
    next_origin
        Of the next joint, in the link's frame [m]: where the beam ends unless a line is given.

    Raises
    ------
    SceneError
        The line has no length.
    ArgumentError
        The beam does not fit into the link; the message says which mass does.
    """
    ends = flexible.line or joint_to_joint(next_origin)
    line = line_of(ends, flexible.up, part.joint.axis)
    section = flexible.section or _tube(line.length)
    largest = largest_mass(part.body, _prism(section, 1.0, line))
    volume = section.properties.area * line.length
    mass = _mass(flexible, volume, largest)
    if not 0 < mass < largest * (1 - 1e-6):  # at the very largest, the rest is a point or a needle
        raise ArgumentError(
            f"flexible: link {truncated(part.link)}: a beam of {mass:.4g} kg does not fit into its mass, "
            f"{part.body.mass:.4g} kg, and inertia; at most {rounded_down(largest)} kg fit; give mass, a lighter "
            "section or another line",
            id="beam-heavier-than-link",
        )
    root, end = cut(part.body, _prism(section, mass, line), _pose(line), line.length)
    link = msgspec.structs.replace(
        rigid,
        line=ends,
        up=flexible.up,
        flex=flexible.flex,
        segments=flexible.segments,
        lumping=flexible.lumping,
        damping=flexible.damping,
        material=rigid.name,
        section=rigid.name,
        hub=payload(root),
        end=payload(end.moved(Pose(np.eye(3), -np.array(ends[1])))),
    )
    material = msgspec.structs.replace(flexible.material, density=mass / volume)
    description = f"beam of {mass:.4g} kg and {line.length:.4g} m, from the link's {part.body.mass:.4g} kg"
    return ImportedLink(link, material, section, f"{part.link}: {description}", _warning(part, largest))


def _mass(flexible: FlexibleLink, volume: float, largest: float) -> float:
    if flexible.mass is None and flexible.section is not None:
        return flexible.material.density * volume
    return flexible.mass or 0.5 * largest


def _warning(part: Part, largest: float) -> str:
    share = largest / part.body.mass
    if share >= 0.1:
        return ""
    return f"{part.link}: only {share:.1%} of its mass fit into a beam along this line; check line"


def payload(body: SpatialInertia) -> RigidBody:
    """A body in the words of a scene; where only rounding makes it one that cannot be, the nearest that can.

    Raises
    ------
    SceneError
        No body can have this inertia; what is below the rounding of its second moment about the origin is forgiven.
    """
    try:
        return _said(body)
    except SceneError:
        λ, V = np.linalg.eigh(body.covariance)
        if λ[0] < -ROUNDING * (λ[-1] + body.mass * body.center @ body.center):
            raise
        return _said(body_with(body.mass, body.center, (V * np.maximum(λ, 0.0)) @ V.T))


def _said(body: SpatialInertia) -> RigidBody:
    """Three moments where there are no products."""
    inertia = (body.inertia + body.inertia.T) / 2
    xx, yy, zz, xy, xz, yz = (float(inertia[j, k]) for j, k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
    products = (xy, xz, yz) if xy or xz or yz else ()
    x, y, z = body.center.tolist()
    return RigidBody(mass=float(body.mass), center=(x, y, z), inertia=(xx, yy, zz, *products))


def rounded_down(value: float) -> str:
    """Four digits of a positive number, none of them rounded up."""
    if value <= 0:
        return "0"
    unit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return f"{math.floor(value / unit) * unit:.4g}"


def _tube(length: float) -> Section:
    """A tube of a tenth of its length, its wall a twentieth of that."""
    outer = length / 10
    return Section(shape="tube", outer=outer, inner=outer * (1 - 2 / 20))


def _prism(section: Section, mass: float, line: Line) -> SpatialInertia:
    """A uniform beam, I = m diag((I_y + I_z)/A, I_y/A + L²/12, I_z/A + L²/12), in the link's frame."""
    area, i_y, i_z, _ = section.properties
    L = line.length
    inertia = mass * np.diag([(i_y + i_z) / area, i_y / area + L**2 / 12, i_z / area + L**2 / 12])
    return SpatialInertia(mass, np.array([L / 2, 0, 0]), inertia).moved(_pose(line))


def _pose(line: Line) -> Pose:
    return Pose(line.frame, line.start)
