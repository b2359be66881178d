"""A link: its attachment to the parent, joint, shape, loads, and number of segments."""

from __future__ import annotations

import functools
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.wording import both_given, missing, truncated
from flexlink.data import documents
from flexlink.describe.directions import Line, line_of, unit
from flexlink.describe.joint import DenavitHartenberg, Joint, Mount
from flexlink.describe.material import Damping, Friction
from flexlink.describe.rest_shape import Curvature, RestShape, RestTwist, ThermalGradient, ends, rest_shape, wrong_end
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, measured_in


class RootStiffness(Spec, frozen=True):
    """Springs at the beam's root, about axes of the link's frame; the root is rigid about axes without a number.

    Springs connect the beam's root to the hub: the moment is k times the angle. Each axis with a spring adds a hinge to
    the chain, such as `boom.root.z`. For a beam of rigidity EI and length L with k L / EI = 100, the first frequency is
    2 % lower than with a rigid clamp.

    Examples
    --------
    >>> clamp = fl.details.RootStiffness(z=2e4)  # N m/rad
    >>> soft = fl.lump(scene.varied({"link.upper.root_stiffness": clamp}))
    >>> print(soft.joint_names[:3], soft.stiffness[1])
    ('upper', 'upper.root.z', 'upper.1.z') 20000.0
    """

    x: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about x of the link's frame [N m/rad]. Default: rigid."""
    y: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about y of the link's frame [N m/rad]. Default: rigid."""
    z: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness about z of the link's frame [N m/rad]. Default: rigid."""


class RootDamping(Spec, frozen=True):
    """Viscous damping of the springs at a link's root, by axis; each axis needs a spring.

    Examples
    --------
    >>> screwed = fl.details.RootDamping(z=1.5)  # N m s/rad
    >>> clamp = {"root_stiffness": fl.details.RootStiffness(z=2e4), "root_damping": screwed}
    >>> print(fl.lump(scene.varied({f"link.upper.{key}": value for key, value in clamp.items()})).damping[1])
    1.5
    """

    x: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about x of the link's frame [N m s/rad]."""
    y: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about y of the link's frame [N m s/rad]."""
    z: Annotated[NonNegative, measured_in("N m s/rad")] = 0.0
    """Damping about z of the link's frame [N m s/rad]."""


ROOT_AXES = "xyz"  # axes of root springs, in the order of their hinges
AXES = {"rigid": (), "z": (3,), "yz": (2, 3), "xyz": (1, 2, 3)}
"""Passive axes of a hinge by flex type: 1 twists about X, 2 bends about Y, 3 bends about Z (paper: T1, T2, T3)."""
RIGID: dict[str, Any] = {
    "flex": "rigid", "segments": 1, "modes": None, "shear": False, "stretch": False, "damping": None, "friction": None,
}  # fmt: skip
"""Keys that only bending needs, and their defaults, which a rigid link has."""


class Link(Spec, frozen=True):
    """One link: an active joint, its hub, a beam that is rigid or divided into segments, and a rigid body at its end.

    The beam runs along local X over `length` [m], or along `line`, between two points of the link's frame [m]. The z
    axis of its section points along `up`, by default along the joint's axis (see `line_of`). The link ends where the
    beam ends, with the axes of the link's frame: `end` and the mount of the next link are attached there; if the
    link is curved at rest, these axes have turned with its section. With a standard Denavit-Hartenberg row this end
    frame is the table's frame i, as in published tables of masses.
    A flexible link has segments − 1 hinges, placed by the rule `lumping`.

    Examples
    --------
    >>> stiff = fl.Link(name="base", hub=fl.RigidBody(mass=3.0))
    >>> link = fl.Link(name="boom", length=3.0, flex="yz", segments=5, material="steel", section="pipe")
    >>> print(stiff.flex, link.flex, link.lumping)
    rigid yz gauss
    """

    name: str
    """Name of the link and, unless `joint.name` is given, of its joint; used in paths and messages."""
    on: str = ""
    """Parent link: a name earlier in the list, or "base". Default: the previous link."""
    mount: Mount = Mount()
    """Placement of the joint's frame in the end frame of the parent link, or in the base's frame."""
    dh: DenavitHartenberg | None = None
    """A row of a Denavit-Hartenberg table instead of a mount; all links of an arm use one convention."""
    joint: Joint = Joint()
    """The active joint at the link's root."""
    hub: RigidBody = RigidBody()
    """Rigid body that moves with the joint, such as a motor housing or bearing, in the link's frame."""
    root_stiffness: Annotated[RootStiffness | None, measured_in("N m/rad")] = None
    """Springs at the beam's root, about axes of the link's frame [N m/rad]. Default: rigid."""
    root_damping: Annotated[RootDamping | None, measured_in("N m s/rad")] = None
    """Damping of the springs in `root_stiffness` [N m s/rad]."""
    length: Annotated[NonNegative, measured_in("m")] = 0.0
    """Length of the beam, along the link's x [m]. Default: that of its `curvature` or `twist` table, or 0, no beam."""
    line: Annotated[tuple[Vector3, Vector3] | None, measured_in("m")] = None
    """Start and end of the beam in the link's frame, [[x, y, z], [x, y, z]] [m], instead of `length`."""
    up: Vector3 | None = None
    """Direction of the section's z in the link's frame; default: the joint's axis."""
    flex: Literal["rigid", "z", "yz", "xyz"] = "rigid"
    """Flexibility: none, bending about the section's z, about y and z, or about y and z with twist about x."""
    segments: Annotated[int, msgspec.Meta(le=100_001)] = 1  # lumping the largest number takes seconds
    """Number of rigid segments of a flexible link, which has segments − 1 hinges."""
    lumping: str = "gauss"
    """Rule that places the hinges: a name, or the path of a rule file."""
    shear: Annotated[bool | Positive, measured_in("1")] = False
    """Whether the beam shears (Timoshenko), or the shear correction factor κ of its section [1], which is required for
    a general section. Default: sections remain normal to the axis."""
    stretch: bool = False
    """Whether the beam stretches along its axis. Default: the axis keeps its length."""
    curvature: Annotated[Curvature, measured_in("1/m")] = 0.0
    """Curvature of the unloaded beam about its section's z, or about y and z [1/m], or a table along it; positive about
    z bends towards y. The link then begins along its `line` or x, and `length` is measured along the curve."""
    twist: Annotated[RestTwist | float, measured_in("rad/m")] = 0.0
    """Twist of the unloaded beam about its axis [rad/m], or a table along it; the section turns with it."""
    thermal: ThermalGradient | None = None
    """A temperature gradient across the section, which curves the unloaded beam further. Default: none."""
    modes: StrainModes | Annotated[int, msgspec.Meta(ge=1, le=1000)] | None = None
    """Strain modes: the link's hinges move only by this number of shapes in each direction. Default: one by one."""
    material: str | None = None
    """Name of the beam's material; a link without material and section has a massless beam."""
    section: str | None = None
    """Name of the beam's section at the joint."""
    section_tip: str | None = None
    """Name of the section at the link's end, of the same shape; all dimensions vary linearly along the tapered beam."""
    rigidity: str | None = None
    """Name of a table of rigidities and mass along the beam, instead of material and section."""
    damping: Damping | None = None
    """Damping of the link's bending, instead of the material's `loss_time`."""
    friction: Friction | None = None
    """Dry friction in the link's hinges."""
    drag: Drag | None = None
    """Air drag on the beam. Default: none."""
    end: RigidBody = RigidBody()
    """Rigid body in the link's end frame, such as the next motor; with a standard `dh` row, in the table's frame i."""

    def __post_init__(self) -> None:
        super().__post_init__()
        msgspec.structs.force_setattr(self, "lumping", documents.absolute(self.lumping))
        if not self.name:
            raise SceneError("name = '': must not be empty", id="empty-name")
        if (self.material is None) != (self.section is None):
            absent, given = ("section", "material") if self.section is None else ("material", "section")
            both = "give both, or neither for a massless link" if self.flex == "rigid" else "a flexible link needs both"
            raise missing(absent, f"{given} = {getattr(self, given)!r} is given: {both}")
        if self.rigidity is not None and self.material is not None:
            raise both_given("rigidity", self.rigidity, f"material = {self.material!r}")
        if self.section_tip is not None and self.section is None:
            raise self._refused("section_tip", "also needs a section at the joint", "needs-another-key")
        if self.line is not None and self.length:
            raise both_given("length", self.length, f"line = {truncated(self.line)}")
        if self.dh is not None and (self.joint.direction != (0.0, 0.0, 1.0)).any():
            raise SceneError(f"joint.axis = {truncated(self.joint.axis)}: must be Z with dh; omit axis", id="dh-axis")
        for axis in ROOT_AXES:
            if getattr(self.root_damping, axis, 0.0) and axis not in self.root_springs:
                raise self._refused(f"root_damping.{axis}", f"needs a root_stiffness.{axis}", "needs-another-key")
        if not self.length and self.line is None and self.dh is None:
            msgspec.structs.force_setattr(self, "length", next(ends(self.curvature, self.twist), 0.0))
        length = self.beam.length
        if self.rest_shape is not None:
            self._check_curved(length)
        if self.flex != "rigid":
            self._check_flexible(length)
        else:
            self._check_rigid(length)

    def _check_rigid(self, length: float) -> None:
        if self.segments != 1 or self.modes is not None:
            segments = f"segments = {self.segments}: a rigid link has 1"
            given = segments if self.segments != 1 else "modes: a rigid link has none"
            raise SceneError(f"{given}; to make it bend, set flex = 'z', 'yz' or 'xyz'", id="rigid-segments")
        if self.strains:
            remedy = "set flex = 'z', 'yz' or 'xyz'"
            text = f"{self.strain_keys}: a rigid link does neither shear nor stretch; {remedy}"
            raise SceneError(text, id="rigid-strains")
        if self.rigidity is not None and length == 0:
            why = "a link with a rigidity needs a length > 0 or a line (default: 0)"
            raise self._refused("length", why, "needs-a-length")
        if self.material is not None and length == 0:
            needs = f"a link of material {self.material!r} needs a length > 0 or a line"
            bare = "a link without length has neither material nor section, but may have a hub"
            raise self._refused("length", f"{needs}; {bare}", "needs-a-length")

    def _check_flexible(self, length: float) -> None:
        if self.segments < 2:
            why = "a flexible link needs at least 2, most rules 3, such as 5 (default: 1)"
            raise self._refused("segments", why, "too-few-segments")
        if length == 0:
            raise self._refused("length", "a flexible link needs a length > 0 or a line (default: 0)", "needs-a-length")
        if self.material is None and self.rigidity is None:
            raise missing("material, section", "a flexible link needs a material and a section, or a rigidity")
        if self.modes is not None and self.strains:
            why = f"modes = {self.modes!r}: strain modes have no shear or stretch; leave out modes"
            raise SceneError(f"{self.strain_keys}: {why}", id="modes-without-strains")
        if self.rigidity is not None and type(self.shear) is float:
            raise self._refused("shear", "a table contains the stiffness for it; set it to true", "shear-of-a-table")

    def _check_curved(self, length: float) -> None:
        given = ", ".join(key for key in ("curvature", "twist", "thermal") if getattr(self, key))
        if length == 0 or (self.material is None and self.rigidity is None):
            why = "a link that is curved or twisted at rest needs a length, and a material and a section, or a rigidity"
            raise SceneError(f"{given}: {why}", id="needs-another-key")
        for end in ends(self.curvature, self.twist):
            if why := wrong_end(end, length):
                raise SceneError(f"{given}: {why}", id="rigidity-table")

    @property
    def rest_shape(self) -> RestShape | None:
        """Twist and curvature of the unloaded beam; None if it is straight and not twisted."""
        return rest_shape(self.curvature, self.twist, self.thermal)

    @property
    def joint_name(self) -> str:
        """Name of the joint in results and files: its own, or else the link's."""
        return self.joint.name or self.name

    @property
    def strains(self) -> bool:
        """Whether the beam shears or stretches, besides bending and twist."""
        return bool(self.shear) or self.stretch

    @property
    def strain_axes(self) -> tuple[int, ...]:
        """Axes along which the link stretches (0: x) or shears (y and z, in the planes in which it bends)."""
        sheared = [{3: 1, 2: 2}[axis] for axis in AXES[self.flex] if axis > 1] if self.shear else []
        return (*([0] if self.stretch else []), *sorted(sheared))

    @property
    def strain_keys(self) -> str:
        """The keys of the strains that the link has besides bending and twist, for messages."""
        given = ("shear", self.shear), ("stretch", self.stretch)
        return ", ".join(f"{key} = {str(value).lower()}" for key, value in given if value)

    @property
    def elastic(self) -> bool:
        """Whether the link bends, or has an elastic gear or root springs."""
        return self.flex != "rigid" or self.turns_rigidly

    @property
    def strain_modes(self) -> StrainModes | None:
        """Strain modes by direction; None if the hinges move one by one."""
        return of_number(self.modes)

    @property
    def turns_rigidly(self) -> bool:
        """Whether an elastic gear or root springs let the link turn as a rigid body."""
        return self.joint.gear_stiffness is not None or bool(self.root_springs)

    @property
    def root_springs(self) -> dict[str, tuple[float, float]]:
        """Stiffness [N m/rad] and damping [N m s/rad] of the springs at the root, by axis: x, y, z."""
        springs = {axis: getattr(self.root_stiffness, axis, None) for axis in ROOT_AXES}
        return {axis: (k, float(getattr(self.root_damping, axis, 0.0))) for axis, k in springs.items() if k is not None}

    @property
    def beam(self) -> Line:
        """Start, length and axes of the beam; for a link without length, a point at its joint."""
        return _beam(self.line, self.stop, self.up, self.joint.axis, getattr(self.twist, "root", 0.0))

    @property
    def stop(self) -> Vector3:
        """End of the beam in the link's frame [m]."""
        if self.line is not None:
            return self.line[1]
        return self.dh.end if self.dh is not None and not self.length else (self.length, 0.0, 0.0)


@functools.lru_cache(maxsize=256)
def _beam(line: tuple[Vector3, Vector3] | None, stop: Vector3, up: Vector3 | None, axis: Vector3, root: float) -> Line:
    """The beam's line, read-only because links of the same geometry share it; `root` turns its sections about it."""
    if line is None and not any(stop):
        beam = Line(np.zeros(3), 0.0, np.eye(3))
    else:
        beam = line_of(line or ((0.0, 0.0, 0.0), stop), up, unit("axis", axis))
    if root:
        c, s = np.cos(root), np.sin(root)
        beam = beam._replace(frame=beam.frame @ np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]]))
    beam.start.flags.writeable = beam.frame.flags.writeable = False
    return beam


class Drag(Spec, frozen=True):
    """Drag on a link that moves across its beam, proportional to speed squared; motion along the beam causes no drag.

    The force per unit length along the section's y and z, with v the velocity of the beam's axis across the link, is

        f_y = −½ ρ c_d b_y |v| v_y        f_z = −½ ρ c_d b_z |v| v_z        ρ = `air_density` of the scene

    by the cross-flow principle (Hoerner 1965, Fluid-Dynamic Drag, chapter 3) in a fluid at rest. The added mass of the
    fluid, π/4 ρ b² per length, is neglected: in air it adds 0.05 % to the mass of a round aluminium bar, and 2 % to the
    mass of an aluminium strip 60 times as wide as thick; in water it is not small.

    Examples
    --------
    >>> round_bar = fl.Drag(coefficient=1.2)  # breadth: the diameter of its section
    >>> panel = fl.Drag(coefficient=2.0, breadth=(0.4, 0.002))  # m, seen along the section's y and z
    >>> moving = fl.lump(scene.varied({"link.upper.drag": panel}))
    >>> print(fl.drag_torque(moving, q, np.ones(chain.n))[0].round(3))  # N m about the first joint, rates of 1 rad/s
    0.398
    """

    coefficient: Positive
    """Drag coefficient c_d [1]: about 1.2 for a round bar, 2 for a flat one."""
    breadth: Annotated[tuple[Positive, Positive] | None, measured_in("m")] = None
    """Breadth of the link, seen along the section's y and along its z [m]. Default: the breadth of its section,
    including taper; required for a general section and for a table of rigidities."""


Count = Annotated[int, msgspec.Meta(ge=1, le=1000)]


class StrainModes(Spec, frozen=True):
    """Numbers of strain modes of a flexible link, by direction; its hinges then move only by these shapes.

    The link's curvature is a sum of shapes, so large deflections are not linearised. The chain keeps all its hinges, as
    stations at which the shapes are evaluated. Fewer coordinates have lower frequencies, so explicit methods can take
    longer steps.

    Examples
    --------
    >>> few = scene.varied({"link.*.segments": 11, "link.*.modes": fl.details.StrainModes(z=2)})
    >>> chain = fl.lump(few)
    >>> print(chain.n, chain.freedoms)  # hinges, coordinates
    22 6
    """

    x: Count = 1
    """Number of modes of twist, with flex = "xyz"."""
    y: Count = 2
    """Number of modes of bending about y, with flex = "yz" or "xyz"."""
    z: Count = 2
    """Number of modes of bending about z."""
    shapes: Literal["eigenmodes", "polynomials"] = "eigenmodes"
    """Shapes: eigenmodes of the link with its distal mass, all other joints locked, or moments that are Legendre
    polynomials along the link."""

    def of_axis(self, axis: int) -> int:
        """Number of modes of a direction: axis 1 twists, 2 and 3 bend about y and z."""
        return (self.x, self.y, self.z)[axis - 1]


def of_number(modes: int | StrainModes | None) -> StrainModes | None:
    """The modes if one number is given for all directions."""
    return StrainModes(x=modes, y=modes, z=modes) if isinstance(modes, int) else modes
