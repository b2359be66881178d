"""What the user describes: material, section, links, joints, payload. Frozen, checked, SI units."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Annotated, Literal

import msgspec
import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.wording import did_you_mean, short_list, truncated
from flexlink.data import documents
from flexlink.describe.directions import Line, line_of, unit
from flexlink.describe.drag import Drag
from flexlink.describe.joint import DenavitHartenberg, Joint, Mount
from flexlink.describe.links import link_number
from flexlink.describe.mistakes import raise_together
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.rigidity import Rigidity
from flexlink.describe.root import ROOT_AXES, RootDamping, RootStiffness
from flexlink.describe.sections import BREADTHS, SHAPES, SectionProperties
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, link_key, measured_in

AXES = {"rigid": (), "z": (3,), "yz": (2, 3), "xyz": (1, 2, 3)}
"""Passive axes of a hinge by flex type: 1 twists about X, 2 bends about Y, 3 bends about Z (paper: T1, T2, T3)."""


class Material(Spec, frozen=True):
    """Isotropic, linear elastic, with Kelvin-Voigt loss: stress = E (strain + loss_time · strain rate).

    Examples
    --------
    >>> steel = fl.Material(young=210e9, density=7850.0, poisson=0.3)  # Pa, kg/m³
    >>> print(f"{scene.varied({'material.aluminium': steel}).arm.materials['aluminium'].young:.2g} Pa")
    2.1e+11 Pa
    """

    young: Annotated[Positive, measured_in("Pa")]
    """Young's modulus E [Pa]: steel 210e9, aluminium 70e9."""
    density: Annotated[Positive, measured_in("kg/m³")]
    """Density ρ [kg/m³]: steel 7850, aluminium 2700."""
    poisson: Annotated[float, msgspec.Meta(gt=-1, le=0.5)] = 0.3
    """Poisson's ratio ν [1]; the shear modulus is G = E / (2 (1 + ν))."""
    loss_time: Annotated[NonNegative, measured_in("s")] = 0.0
    """Kelvin-Voigt's loss time η [s]: a mode of frequency ω has the damping ratio η ω / 2."""

    @property
    def shear(self) -> float:
        """Shear modulus G = E / (2 (1 + ν)) [Pa]."""
        return self.young / (2 * (1 + self.poisson))


class Section(Spec, frozen=True):
    """Cross-section of a link: a shape and exactly the dimensions that the shape takes [m, m², m⁴].

    rectangle: height (along local y), width (along z); circle: diameter; tube: outer, inner (diameters);
    box: height, width, wall; general: area, i_y = ∫ z² dA, i_z = ∫ y² dA, torsion (St Venant's constant J).

    Examples
    --------
    >>> tube = fl.Section(shape="tube", outer=0.06, inner=0.05)  # m
    >>> plate = fl.Section(shape="rectangle", height=0.005, width=0.03)
    >>> measured = fl.Section(shape="general", area=3e-4, i_y=4e-8, i_z=4e-8, torsion=8e-8)  # m², m⁴
    """

    shape: Literal["rectangle", "circle", "tube", "box", "general"]
    """Which shape; it takes exactly the dimensions that belong to it."""
    height: Annotated[Positive | None, measured_in("m")] = None
    """Of a rectangle or box: outer size along the section's y [m]."""
    width: Annotated[Positive | None, measured_in("m")] = None
    """Of a rectangle or box: outer size along the section's z [m]."""
    diameter: Annotated[Positive | None, measured_in("m")] = None
    """Of a circle [m]."""
    outer: Annotated[Positive | None, measured_in("m")] = None
    """Of a tube: outer diameter [m]."""
    inner: Annotated[NonNegative | None, measured_in("m")] = None
    """Of a tube: inner diameter [m]."""
    wall: Annotated[Positive | None, measured_in("m")] = None
    """Of a box: thickness of its wall [m]."""
    area: Annotated[Positive | None, measured_in("m²")] = None
    """Of a general section: area A [m²]."""
    i_y: Annotated[Positive | None, measured_in("m⁴")] = None
    """Of a general section: ∫ z² dA, which resists bending about y [m⁴]."""
    i_z: Annotated[Positive | None, measured_in("m⁴")] = None
    """Of a general section: ∫ y² dA, which resists bending about z [m⁴]."""
    torsion: Annotated[Positive | None, measured_in("m⁴")] = None
    """Of a general section: St Venant's torsion constant J [m⁴]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        wanted = SHAPES[self.shape][1]
        dimensions = [n for n in self.__struct_fields__ if n != "shape" and getattr(self, n) is not None]
        for name in dimensions:
            if name not in wanted:
                allowed = ", ".join(wanted)
                raise SceneError(f"{name} = {getattr(self, name)!r}: a {self.shape} takes {allowed}")
        for name in wanted:
            if name not in dimensions:
                raise SceneError(f"{name}: missing; a {self.shape} needs {', '.join(wanted)}")
        if self.outer is not None and self.inner is not None and self.inner >= self.outer:
            raise SceneError(f"inner = {self.inner!r}: must be smaller than outer = {self.outer!r}")
        if self.wall and self.height and self.width and 2 * self.wall >= min(self.height, self.width):
            raise SceneError(f"wall = {self.wall!r}: must be less than half of height and width")
        self._check_properties(wanted)

    def _check_properties(self, dimensions: tuple[str, ...]) -> None:
        try:
            properties = self.properties._asdict()
        except OverflowError:  # of Python's own power
            properties = {"area or second moment": math.inf}
        for name, value in properties.items():
            if not 0 < value < math.inf:
                values = ", ".join(f"{key} = {getattr(self, key)!r}" for key in dimensions)
                raise SceneError(f"{values}: {name} {'underflows' if value == 0 else 'overflows'} float64")

    @property
    def properties(self) -> SectionProperties:
        """Area, second moments and St Venant constant of this section."""
        return self.towards(self, 0.0)

    def breadths(self, tip: Section, x: float) -> tuple[float, float] | None:
        """How broad it is at the part `x` of the way to another section, seen along y and along z [m]; None: unknown.

        Of a general section nothing is known but areas.
        """
        across = BREADTHS.get(self.shape)
        if across is None:
            return None
        y, z = self._dimensions(across, tip, x)
        return y, z

    def towards(self, tip: Section, x: float) -> SectionProperties:
        """Properties at the part `x` of the way to a section of the same shape, all dimensions linear in x."""
        formula, names = SHAPES[self.shape]
        return formula(*self._dimensions(names, tip, x))

    def _dimensions(self, names: tuple[str, ...], tip: Section, x: float) -> Iterator[float]:
        return ((1 - x) * getattr(self, name) + x * getattr(tip, name) for name in names)


class Damping(Spec, frozen=True):
    """Structural damping by its effect: the damping ratio of a bending or twisting mode at a frequency.

    proportional: Kelvin-Voigt's law, d = η k with η = ratio / (π at_hz), the same in every hinge, under which the ratio
    of a mode grows with its frequency, ζ = η ω/2 = ratio · f / at_hz, however the link is cut. It shrinks the stable
    step of explicit methods: `flexlink info` says by how much.
    constant: dampers between all hinges of the links that have it, root and gear, too, such that every mode of the arm
    has the same ratio, if all links that bend have it, with its joints held where `initial.joint_deg` and `joint_m` put
    them; elsewhere modes are near it. A whole state, `initial.q`, as of a run that is continued, changes no dampers.
    For links without branches or slides between them.

    Examples
    --------
    >>> welded = fl.Damping(ratio=0.01, at_hz=4.2)  # 1 % of critical at 4.2 Hz
    >>> damped = fl.lump(scene.varied({"link.*.damping": welded}))
    >>> found = fl.modes(damped, q, locked=damped.active)
    >>> print(found.hertz[:2].round(2), found.damping_ratios[:2].round(4))  # in proportion to the frequency
    [ 5.7  26.87] [0.0135 0.064 ]
    >>> alike = fl.Damping(ratio=0.01, law="constant")
    >>> damped = fl.lump(scene.varied({"link.*.damping": alike}))
    >>> print(fl.modes(damped, q, locked=damped.active).damping_ratios.round(4))
    [0.01 0.01 0.01 0.01]
    """

    ratio: NonNegative
    """Damping ratio ζ of the mode at `at_hz`, or of all modes [1]: 0.01 is 1 % of critical."""
    at_hz: Annotated[Positive | None, measured_in("Hz")] = None
    """Of the proportional law: frequency of the mode that has this ratio [Hz]; at others the ratio grows in
    proportion."""
    law: Literal["proportional", "constant"] = "proportional"
    """Whether the ratio of a mode grows in proportion to its frequency, or all modes of the link have the same."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.law == "proportional" and self.at_hz is None:
            raise SceneError("at_hz: missing; this key is required, unless law = 'constant'")
        if self.law == "constant" and self.at_hz is not None:
            raise SceneError(f"at_hz = {self.at_hz!r}: has no effect with law = 'constant'; leave it out")

    @property
    def is_constant(self) -> bool:
        """Whether all modes have the same ratio."""
        return self.law == "constant"

    @property
    def loss_time(self) -> float:
        """Kelvin-Voigt's η [s]; 0 where the ratio is constant."""
        return 0.0 if self.at_hz is None else self.ratio / (math.pi * self.at_hz)


class Friction(Spec, frozen=True):
    """Dry friction in each passive hinge of a link: coulomb · tanh(q̇ / coulomb_width), the law of the joints.

    A link that bends by an angle loses coulomb times this
    angle, however many hinges share it.

    Examples
    --------
    >>> rubbing = scene.varied({"link.upper.friction": fl.Friction(coulomb=0.5)})  # N m in each hinge
    >>> rates = np.ones(chain.n)  # rad/s
    >>> print((fl.friction_torque(fl.lump(rubbing), rates) - fl.friction_torque(chain, rates)).round(2))
    [0.  0.5 0.5 0.  0.  0. ]
    """

    coulomb: Annotated[NonNegative, measured_in("N m")]
    """Dry friction torque of each hinge [N m]."""
    coulomb_width: Annotated[Positive, measured_in("rad/s")] = 0.01
    """Rate at which tanh has reached 76 % of it [rad/s]; smaller is closer to Coulomb's law, and stiffer."""


class Link(Spec, frozen=True):
    """One link: an active joint, its hub, then a beam, rigid or cut into segments, then the rigid body at its end.

    The beam runs along local X over `length` [m], or along `line`, from one point of the link's frame to another [m].
    Its section's z points to `up`, by default to the joint's axis (`line_of` says more). The link ends where the beam
    does, with the axes of its own frame: there hang `end` and the next link's mount.
    A link that bends has segments − 1 hinges, where `lumping` puts them.

    Examples
    --------
    >>> stiff = fl.Link(name="base", hub=fl.RigidBody(mass=3.0))
    >>> link = fl.Link(name="boom", length=3.0, flex="yz", segments=5, material="steel", section="pipe")
    >>> print(stiff.flex, link.flex, link.lumping)
    rigid yz gauss
    """

    name: str
    """Name of the link, and of its joint; paths and messages use it."""
    on: str = ""
    """Name of the link, further up in the list, that it hangs on, or "base". Default: the link before."""
    mount: Mount = Mount()
    """Where the joint's frame sits in the end frame of the link that it hangs on; on the base in the base's frame."""
    dh: DenavitHartenberg | None = None
    """A row of a table of Denavit and Hartenberg in place of a mount; all links of an arm use one convention."""
    joint: Joint = Joint()
    """The active joint at the link's root."""
    hub: RigidBody = RigidBody()
    """Rigid body that turns with the joint, in the link's frame: motor housing, bearing."""
    root_stiffness: Annotated[RootStiffness | None, measured_in("N m/rad")] = None
    """Springs where the beam begins, about axes of the link's frame [N m/rad]. Default: rigid."""
    root_damping: Annotated[RootDamping | None, measured_in("N m s/rad")] = None
    """Damping of these springs [N m s/rad]."""
    length: Annotated[NonNegative, measured_in("m")] = 0.0
    """Length of the beam, along the link's x [m]; 0: no beam."""
    line: Annotated[tuple[Vector3, Vector3] | None, measured_in("m")] = None
    """Where the beam runs in the link's frame, [[x, y, z], [x, y, z]] [m], in place of `length`."""
    up: Vector3 | None = None
    """Direction of the section's z in the link's frame; default: the joint's axis."""
    flex: Literal["rigid", "z", "yz", "xyz"] = "rigid"
    """How the link bends: not, about the section's z, about y and z, or about y and z with twist about x."""
    segments: Annotated[int, msgspec.Meta(ge=1, le=100_001)] = 1  # lumped in seconds
    """Rigid segments of a link that bends; it has one hinge less than segments."""
    lumping: str = "gauss"
    """Where the hinges sit: a rule's name, or the path of a rule's file."""
    material: str | None = None
    """Name of the beam's material; without material and section the link has no mass of its own."""
    section: str | None = None
    """Name of the beam's section at the joint."""
    section_tip: str | None = None
    """Name of the section at the link's end, of the same shape: every dimension runs linearly, the beam tapers."""
    rigidity: str | None = None
    """Name of a table of rigidities and mass along the beam, in place of material and section."""
    damping: Damping | None = None
    """Damping of the link's bending, in place of the material's `loss_time`."""
    friction: Friction | None = None
    """Dry friction in the link's hinges."""
    drag: Drag | None = None
    """Drag of the air that the beam moves through. Default: none."""
    end: RigidBody = RigidBody()
    """Rigid body at the end of the beam, with the axes of the link's frame: the next motor."""

    def __post_init__(self) -> None:
        super().__post_init__()
        msgspec.structs.force_setattr(self, "lumping", documents.absolute(self.lumping))
        if not self.name:
            raise SceneError("name = '': must not be empty")
        if (self.material is None) != (self.section is None):
            missing, given = ("section", "material") if self.section is None else ("material", "section")
            said = f"{given} = {getattr(self, given)!r}"
            raise SceneError(f"{missing}: missing; {said} is given: give both, or neither for a massless link")
        if self.rigidity is not None and self.material is not None:
            raise SceneError(f"rigidity = {self.rigidity!r}: material = {self.material!r} is given, too; give only one")
        if self.section_tip is not None and self.section is None:
            raise SceneError(f"section_tip = {self.section_tip!r}: needs a section at the joint, too")
        if self.line is not None and self.length:
            raise SceneError(f"length = {self.length!r}: line = {truncated(self.line)} is given, too; give only one")
        if self.dh is not None and (self.joint.direction != (0.0, 0.0, 1.0)).any():
            raise SceneError(f"joint.axis = {truncated(self.joint.axis)}: with dh a joint turns about Z")
        for axis in ROOT_AXES:
            damping = getattr(self.root_damping, axis, 0.0)
            if damping and axis not in self.root_springs:
                raise SceneError(f"root_damping.{axis} = {damping!r}: needs a root_stiffness.{axis}")
        length = self.beam.length
        if self.flex != "rigid":
            self._check_flexible(length)
        elif self.segments != 1:
            raise SceneError(f"segments = {self.segments}: a rigid link has 1; flex = 'z', 'yz' or 'xyz' makes it bend")
        elif self.rigidity is not None and length == 0:
            raise SceneError(
                f"length = {self.length!r}, the default: a link with a rigidity needs a length > 0 or a line"
            )
        elif self.material is not None and length == 0:
            raise SceneError(
                f"length = {self.length!r}, the default: a link of material {self.material!r} needs a length > 0 or a "
                "line; one without length has neither material nor section, but may have a hub"
            )

    def _check_flexible(self, length: float) -> None:
        if self.segments < 2:
            raise SceneError(f"segments = {self.segments}, the default: a flexible link needs at least 2, such as 5")
        if length == 0:
            raise SceneError(f"length = {self.length!r}, the default: a flexible link needs a length > 0 or a line")
        if self.material is None and self.rigidity is None:
            raise SceneError(
                "material, section: missing; a flexible link needs a material and a section, or a rigidity"
            )

    @property
    def elastic(self) -> bool:
        """Whether the link bends, or turns in its gear or at its root."""
        return self.flex != "rigid" or self.turns_rigidly

    @property
    def turns_rigidly(self) -> bool:
        """Whether the link turns in its gear or at its root, as a whole."""
        return self.joint.gear_stiffness is not None or bool(self.root_springs)

    @property
    def root_springs(self) -> dict[str, tuple[float, float]]:
        """Stiffness [N m/rad] and damping [N m s/rad] of the springs at the root, by axis: x, y, z."""
        springs = {axis: getattr(self.root_stiffness, axis, None) for axis in ROOT_AXES}
        return {axis: (k, float(getattr(self.root_damping, axis, 0.0))) for axis, k in springs.items() if k is not None}

    @property
    def beam(self) -> Line:
        """Where the beam runs: start, length and axes; of a link without length a point in its joint."""
        return _beam(self.line, self.stop, self.up, self.joint.axis)

    @property
    def stop(self) -> Vector3:
        """End of the beam in the link's frame [m]."""
        if self.line is not None:
            return self.line[1]
        return self.dh.end if self.dh is not None and not self.length else (self.length, 0.0, 0.0)


@functools.lru_cache(maxsize=256)
def _beam(line: tuple[Vector3, Vector3] | None, stop: Vector3, up: Vector3 | None, axis: Vector3) -> Line:
    """Read-only: links of one geometry share it."""
    if line is None and not any(stop):
        beam = Line(np.zeros(3), 0.0, np.eye(3))
    else:
        beam = line_of(line or ((0.0, 0.0, 0.0), stop), up, unit("axis", axis))
    beam.start.flags.writeable = beam.frame.flags.writeable = False
    return beam


BETWEEN = (
    "a branch begins or a joint slides between the links that have it; give it to one link, or take law = "
    "'proportional'"
)
"""Where kernels know no dampers between hinges."""
BASE = "base"
"""What a link hangs on that hangs on none, unless one before it is called so."""


class Base(RigidBody, frozen=True):
    """What the first link hangs on: fixed in frame 0, or free, a rigid body that floats, such as a satellite.

    Of a free base `mass` [kg], `center` [m] and `inertia` [kg m²] are in its frame; `initial.base` is its start.

    Examples
    --------
    >>> satellite = fl.Base(kind="free", mass=400.0, inertia=(120.0, 120.0, 90.0))  # kg, kg m²
    """

    kind: Literal["fixed", "free"] = "fixed"
    """Whether the base is fixed in frame 0 or floats."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.kind == "fixed" and (self.mass or any(self.inertia)):
            raise SceneError(f"mass = {self.mass!r}: a fixed base takes none; kind = 'free' makes it float")
        if self.kind == "free" and not (self.mass and self.principal_moments[0] > 0):
            raise SceneError(
                f"mass = {self.mass!r}, inertia = {truncated(self.inertia)}: a free base needs mass, and inertia "
                "about every axis"
            )

    @property
    def free(self) -> bool:
        """Whether it floats."""
        return self.kind == "free"


class Arm(Spec, frozen=True):
    """Links from the base outward, one on another or as a tree, with the materials and sections that they name.

    Examples
    --------
    >>> arm = fl.Arm(
    ...     links=(fl.Link(name="boom", length=3.0, flex="z", segments=5, material="steel", section="pipe"),),
    ...     materials={"steel": fl.Material(young=210e9, density=7850.0)},
    ...     sections={"pipe": fl.Section(shape="tube", outer=0.06, inner=0.05)},
    ...     tip=fl.RigidBody(mass=5.0),
    ... )
    >>> print(arm)
    <Arm: 'boom' (z)>
    """

    links: Annotated[tuple[Link, ...], msgspec.Meta(min_length=1)] = msgspec.field(name="link")
    """The links, from the base outward."""
    materials: dict[str, Material] = msgspec.field(name="material", default_factory=dict)
    """Materials by the names that links use."""
    sections: dict[str, Section] = msgspec.field(name="section", default_factory=dict)
    """Sections by the names that links use."""
    rigidities: dict[str, Rigidity] = msgspec.field(name="rigidity", default_factory=dict)
    """Tables of rigidities and mass along beams, by the names that links use."""
    tip: RigidBody = RigidBody()
    """Payload: rigid body in the tip frame, which is at the end of the last link."""
    base: Base = Base()
    """What the first link hangs on."""

    def __post_init__(self) -> None:
        super().__post_init__()
        raise_together(self._mistakes())

    def _mistakes(self) -> Iterator[str]:
        """What does not fit together."""
        seen: set[str] = set()
        for k, link in enumerate(self.links, 1):
            if link.name in seen:
                yield f"link.{k}.name = {link.name!r}: names of links must differ"
            if link.on and link.on != BASE and link.on not in seen:
                before = [BASE, *(each.name for each in self.links[: k - 1])]
                later = link.on in {each.name for each in self.links}
                meant = "; a link hangs on one that stands before it" if later else did_you_mean(link.on, before)
                known = ", ".join(before)
                yield f"{self.path(k)}.on = {link.on!r}: no link before it in the list; allowed are {known}{meant}"
            seen.add(link.name)
            tables = (
                ("material", self.materials), ("section", self.sections), ("section_tip", self.sections),
                ("rigidity", self.rigidities),
            )  # fmt: skip
            for key, table in tables:
                name = getattr(link, key)
                if name is not None and name not in table:
                    known = ", ".join(table) or "none"
                    meant = did_you_mean(name, table)
                    yield f"{self.path(k)}.{key} = {name!r}: not defined; defined are {known}{meant}"
            yield from self._wrong_table(k, link)
            yield from self._wrong_drag(k, link)
            if link.section_tip is None:
                continue
            shapes = [self.sections[n].shape for n in (link.section, link.section_tip) if n in self.sections]
            if len(set(shapes)) > 1:
                yield f"{self.path(k)}.section_tip = {link.section_tip!r}: is a {shapes[1]}, not a {shapes[0]}"
        if len({link.dh.convention for link in self.links if link.dh is not None}) > 1:
            yield "link.dh.convention: differs from link to link; a table has one"
        yield from self._wrong_law()
        if not self.base.free and all(link.joint.locked and not link.elastic for link in self.links):
            yield "link: every joint is locked and every link rigid; at least one must move"

    def _wrong_law(self) -> Iterator[str]:
        """Dampers of one ratio in all modes between hinges between which a branch begins or a joint slides."""
        given = [k for k, link in enumerate(self.links) if link.damping is not None and link.damping.is_constant]
        for k in range(given[0] + 1, given[-1] + 1) if given else ():
            link, before = self.links[k], self.links[k - 1]
            if link.on not in {"", before.name} or (link.joint.slides and not link.joint.locked):
                yield f"{self.path(given[0] + 1)}.damping.law = 'constant': {BETWEEN}"
                return

    def _wrong_table(self, k: int, link: Link) -> Iterator[str]:
        """What a table of rigidities lacks for its link."""
        table = self.rigidities.get(link.rigidity or "")
        if table is None:
            return
        path = f"{self.path(k)}.rigidity = {link.rigidity!r}"
        for column in table.lacks(link.flex):
            yield f"{path}: has no {column}; flex = {link.flex!r} needs it"
        # part of a beam's length by which its table may end beside it: the rounding of what was written
        if abs(table.x[-1] - link.beam.length) > 1e-6 * link.beam.length:
            yield f"{path}: ends at x = {table.x[-1]!r} m; the beam ends at {link.beam.length!r} m, and so must it"

    def _wrong_drag(self, k: int, link: Link) -> Iterator[str]:
        """What is not known of a link that has drag."""
        if link.drag is None:
            return
        if link.beam.length == 0:
            yield f"{self.path(k)}.drag: the link has no length; leave it out"
        elif link.drag.breadth is None:
            section = self.sections.get(link.section or "")
            if link.section is None:
                yield f"{self.path(k)}.drag.breadth: missing; the link has no section that says how broad it is"
            elif section is not None and section.shape not in BREADTHS:
                yield (
                    f"{self.path(k)}.drag.breadth: missing; a {section.shape} section, {link.section!r}, does not say "
                    "how broad it is"
                )

    @property
    def parents(self) -> tuple[int, ...]:
        """Of every link the number, from 1, of the one that it hangs on; 0: the base."""
        numbers, parents = {BASE: 0}, list[int]()
        for before, link in enumerate(self.links):
            parents.append(numbers[link.on] if link.on else before)
            numbers[link.name] = before + 1
        return tuple(parents)

    @property
    def has_drag(self) -> bool:
        """Whether any link has drag."""
        return any(link.drag is not None for link in self.links)

    @property
    def slides(self) -> tuple[bool, ...]:
        """Whether the joint of each link slides."""
        return tuple(link.joint.slides for link in self.links)

    @property
    def tips(self) -> tuple[int, ...]:
        """Numbers of the links that no other hangs on; the last link, whose end is the tip, is the last of them."""
        parents = set(self.parents)
        return tuple(k for k in range(1, len(self.links) + 1) if k not in parents)

    @property
    def is_serial(self) -> bool:
        """Whether every link hangs on the one before it."""
        return self.parents == tuple(range(len(self.links)))

    def __repr__(self) -> str:
        return f"<Arm: {short_list([f'{link.name!r} ({link.flex})' for link in self.links])}>"

    def loss_time(self, link: Link) -> float:
        """Kelvin-Voigt's η [s] of a link's hinges: of its `damping`, or else of its material or table."""
        if link.flex == "rigid":
            return 0.0
        if link.damping is None and link.rigidity is not None:
            return self.rigidities[link.rigidity].loss_time
        return (link.damping or self.materials[link.material or ""]).loss_time

    def path(self, number: int, key: str = "link") -> str:
        """Path of a link by its number from 1, as `--set` takes it: `link.upper` or `link.2`; or below another key."""
        return f"{key}.{link_key([link.name for link in self.links], number - 1)}"

    def number(self, link: str | int) -> int:
        """Number, from 1, of a link given by its name or number.

        Raises
        ------
        ArgumentError
            There is no such link.
        """
        return link_number("link", link, [each.name for each in self.links])
