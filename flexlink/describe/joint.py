"""Attachment of a link to its parent: the joint's placement, and the joint itself."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import both_given, truncated
from flexlink.describe.directions import unit
from flexlink.describe.joint_units import OF_JOINT, KindOfJoint, in_joint_units
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.shaping import MOST_IMPULSES
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, measured_in


class Joint(Spec, frozen=True):
    """Active joint at the root of a link, about or along `axis` in the link's frame; `locked` makes it rigid.

    The link's frame turns about the axis of a revolute joint, or slides along the axis of a prismatic one; at zero it
    coincides with the mount's frame. Units here are for a revolute joint; for a prismatic joint, N m/rad becomes N/m,
    and so on.
    With `gear_stiffness` k the gear is elastic: the motor (with armature, friction and drive) and the link turn about
    the same axis, connected by the torque k (θ_link − θ_motor) plus `gear_damping` times the difference of their rates.
    The joint's angle is then the motor's angle; `locked` holds the motor.
    The friction torque is T_FR = viscous · q̇ + coulomb · tanh(q̇ / coulomb_width). The tanh smooths Coulomb's law, as
    Runge-Kutta methods require: at |q̇| = 3 · coulomb_width it reaches 99.5 % of the dry torque.

    Examples
    --------
    >>> motor = fl.Joint(axis=(0.0, 1.0, 0.0), armature=0.5, viscous=2.0)  # kg m², N m s/rad
    >>> geared = fl.Joint(armature=0.5, gear_stiffness=8e3)  # N m/rad
    >>> welded = fl.Joint(locked=True)
    >>> trolley = fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), viscous=50.0, limits_m=(0.0, 8.0))  # N s/m, m
    """

    name: str | None = None
    """Name in results, exports and comparisons, for example a URDF file's. Default: the link's name."""
    kind: Literal["revolute", "prismatic"] = "revolute"
    """Whether the joint turns about its axis (revolute) or slides along it (prismatic)."""
    axis: Vector3 = (0.0, 0.0, 1.0)
    """Axis in the link's frame; need not be normalized."""
    locked: bool = False
    """Whether the joint is fixed at its initial position."""
    viscous: Annotated[NonNegative, measured_in("N m s/rad", "N s/m")] = 0.0
    """Viscous friction coefficient d [N m s/rad]; for a prismatic joint [N s/m]."""
    viscous_lag: Annotated[NonNegative, measured_in("s")] = 0.0
    """Time constant τ by which viscous friction lags behind the rate [s], as in a damper in series with a spring: the
    torque is d ζ with τ ζ̇ = q̇ − ζ, instead of d q̇."""
    quadratic: Annotated[NonNegative, measured_in("N m s²/rad²", "N s²/m²")] = 0.0
    """Coefficient c of a torque c |q̇| q̇, as in a hydraulic damper [N m s²/rad²]; for a prismatic joint [N s²/m²]."""
    hardening: Annotated[NonNegative, measured_in("N m/rad³", "N/m³")] = 0.0
    """Coefficient c of a spring that draws the joint to zero by c q³ [N m/rad³]; for a prismatic joint [N/m³]."""
    coulomb: Annotated[NonNegative, measured_in("N m", "N")] = 0.0
    """Dry friction torque c [N m], applied as c tanh(q̇ / coulomb_width); for a prismatic joint, a force [N]."""
    coulomb_width: Annotated[Positive, measured_in("rad/s", "m/s")] = 0.01
    """Rate at which tanh reaches 76 % [rad/s], or [m/s]; a smaller value is closer to Coulomb's law, but makes the
    equations stiffer."""
    armature: Annotated[NonNegative, measured_in("kg m²", "kg")] = 0.0
    """Rotor inertia reflected to the joint [kg m²]: the motor's inertia times the square of the gear ratio; for a
    prismatic joint, the reflected mass [kg]."""
    gear_stiffness: Annotated[Positive | None, measured_in("N m/rad", "N/m")] = None
    """Stiffness of an elastic gear between motor and link [N m/rad], or of a prismatic joint's belt or rope [N/m];
    requires `armature`. Default: the gear is rigid."""
    gear_damping: Annotated[NonNegative, measured_in("N m s/rad", "N s/m")] = 0.0
    """Damping of the elastic gear [N m s/rad]; for a prismatic joint [N s/m]."""
    limits_deg: Annotated[tuple[float, float] | None, measured_in("deg")] = None
    """Lower and upper limit of the angle [deg]; a run that exceeds them warns but continues, unless `limits` or a
    tie makes them stops."""
    limits_m: Annotated[tuple[float, float] | None, measured_in("m")] = None
    """For a prismatic joint: lower and upper limit of its position [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name == "":
            raise SceneError("name = '': must not be empty", id="empty-name")
        self.direction  # noqa: B018  refuses a zero axis
        other = "limits_deg" if self.slides else "limits_m"
        if getattr(self, other) is not None:
            raise self._refused(other, f"a {self.kind} joint takes {self.limits_key}", "key-of-another-kind")
        if self.limits is not None and self.limits[0] >= self.limits[1]:
            raise self._refused(self.limits_key, "the lower limit must be less than the upper", "limits-order")
        if self.viscous_lag and not self.viscous:
            raise self._refused("viscous_lag", "needs a viscous friction > 0", "needs-another-key")
        if self.gear_stiffness is None and self.gear_damping:
            raise self._refused("gear_damping", "needs a gear_stiffness", "needs-another-key")
        if self.gear_stiffness is not None and not self.armature and not self.locked:
            needs = f"gear_stiffness = {self.gear_stiffness!r} needs the motor's inertia, because there is no other"
            raise self._refused("armature", f"{needs} inertia between motor and gear (default: 0)", "needs-another-key")

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return self.kind == "prismatic"

    @property
    def terms(self) -> KindOfJoint:
        """Names of the joint's coordinate, drive and units."""
        return OF_JOINT[self.slides]

    @property
    def lags(self) -> bool:
        """Whether the joint is free, and its viscous friction lags behind the rate by `viscous_lag`."""
        return self.viscous_lag > 0 and not self.locked

    @property
    def limits_key(self) -> str:
        """Key of the joint's limits."""
        return "limits_m" if self.slides else "limits_deg"

    @property
    def limits(self) -> tuple[float, float] | None:
        """The joint's limits [deg]; for a prismatic joint [m]."""
        return self.limits_m if self.slides else self.limits_deg

    def backs(self, hub: RigidBody) -> bool:
        """Whether a hinge at the beam's root has a fixed support or inertia on its other side, or the joint slides."""
        if self.slides and not self.locked:
            return True
        supported = self.gear_stiffness is None and bool(self.locked or self.armature)
        return supported or hub.about(self.direction) > 0

    def position(self, deg: float, m: float) -> float:
        """The joint's coordinate [rad], or [m] if it slides, from its link's entries in the lists in deg and m."""
        return m if self.slides else math.radians(deg)

    @property
    def direction(self) -> Array:
        """Unit vector along the axis, in the link's frame, shape (3,)."""
        return unit("axis", self.axis)


class Limits(Spec, frozen=True):
    """Stops at all limits of joints, `joint.limits_deg` and `limits_m`, as ties of kind "stop" named "stop of LINK".

    Joints get none if they are locked, a `[[motion]]` moves them, or a tie stops them already.

    Examples
    --------
    >>> limited = scene.varied({"link.*.joint.limits_deg": (-90.0, 70.0), "limits.stiffness": 1e4})
    >>> print([tie.name for tie in limited.ties])
    ['stop of upper', 'stop of fore']
    """

    stiffness: Annotated[Positive | None, measured_in("N m/rad")] = None
    """Stiffness of the stops of revolute joints [N m/rad]. Default: none stops, and a run past limits warns."""
    dissipation: Annotated[NonNegative, measured_in("s/rad")] = 0.0
    """Their factor of the speed, as `tie.NAME.dissipation` [s/rad]."""
    stiffness_m: Annotated[Positive | None, measured_in("N/m")] = None
    """Stiffness of the stops of prismatic joints [N/m]."""
    dissipation_m: Annotated[NonNegative, measured_in("s/m")] = 0.0
    """Their factor of the speed [s/m]."""


class Mount(Spec, frozen=True):
    """Placement of a joint frame in the end frame of the parent link (for the first link: in frame 0).

    The offset `xyz` [m] is followed by the rotation `rpy_deg` [deg] or `rpy` [rad], roll, pitch, yaw about fixed axes:
    R = Rz(yaw) Ry(pitch) Rx(roll), the convention of URDF; v_parent = R v_joint. Multiples of 90° are exact.

    Examples
    --------
    >>> upright = fl.Mount(rpy_deg=(90.0, 0.0, 0.0))  # horizontal joint axis if Z is up
    >>> beside = fl.Mount(xyz=(0.1, 0.0, 0.05))  # m, in the end frame of the parent link
    >>> link = fl.Link(name="boom", mount=upright)
    """

    xyz: Annotated[Vector3, measured_in("m")] = (0.0, 0.0, 0.0)
    """Offset of the joint frame, in the end frame of the parent link [m]."""
    rpy_deg: Annotated[Vector3, measured_in("deg")] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about fixed axes [deg]; multiples of 90° are exact."""
    rpy: Annotated[Vector3 | None, measured_in("rad")] = None
    """Roll, pitch, yaw [rad], instead of `rpy_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rpy is not None and any(self.rpy_deg):
            raise both_given("rpy", self.rpy, f"rpy_deg = {truncated(self.rpy_deg)}")


class DenavitHartenberg(Spec, frozen=True):
    """A row of a Denavit-Hartenberg table; the joint turns about Z, and its angle adds to `theta_deg`.

    standard (Siciliano et al. 2009, section 2.8.2): T = Rz(θ) Tz(d) Tx(a) Rx(α) from the axes before the joint turns
    to the link's end frame, frame i of the table, in which `end` is given; the beam of a link with neither `length` nor
    `line` runs from the joint to (a, 0, d).
    modified (Craig 2005, section 3.4): T = Rx(α) Tx(a) Rz(θ) Tz(d) from the parent's frame (not its end frame) to this
    link's frame; a and α are Craig's a_{i−1}, α_{i−1} of the parent, as in the rows of his tables.
    In both conventions the table alone places the joint axes: a beam may follow another line, but the next axes, which
    move with its end, are as in the table. A standard table also defines the tip. A modified table ends in the last
    joint's frame; the tip is then the end of the last link's beam, or the origin of this frame if there is no beam. A
    `mount`, such as the base's, is applied before the row. `a` and `d` are in [m].

    Examples
    --------
    >>> row = fl.details.DenavitHartenberg(convention="modified", a=0.4, alpha_deg=-90.0)
    >>> link = fl.Link(name="upper", dh=row)
    """

    convention: Literal["standard", "modified"]
    """Siciliano's (standard) or Craig's (modified)."""
    a: Annotated[float, measured_in("m")] = 0.0
    """Link length a, along x [m]."""
    alpha_deg: Annotated[float, measured_in("deg")] = 0.0
    """Twist α about x [deg]."""
    d: Annotated[float, measured_in("m")] = 0.0
    """Offset d along z [m]."""
    theta_deg: Annotated[float, measured_in("deg")] = 0.0
    """Angle θ about z at joint angle 0 [deg]."""

    @property
    def end(self) -> Vector3:
        """End of the link according to this row, in the link's frame [m]; a modified row ends at the frame's origin."""
        return (self.a, 0.0, self.d) if self.convention == "standard" else (0.0, 0.0, 0.0)


def outside_limits(name: str, joint: Joint, position: float) -> str:
    """The position [deg or m] and why it is outside the joint's limits, else empty.

    A thousandth of the range may be noise of a measurement at a stop, of which runs warn.
    """
    low, high = joint.limits or (-math.inf, math.inf)
    if not max(position - high, low - position) > 1e-3 * (high - low):
        return ""
    where = f"outside {joint.limits_key} = {[low, high]} of joint {name!r}"
    if not joint.slides and max(-low, high) <= math.tau < abs(position):
        where += f" (in degrees {[round(math.degrees(low), 2), round(math.degrees(high), 2)]} if given in rad)"
    return f"{position!r}: {where}; if this is possible, widen it to {[min(low, position), max(high, position)]}"


def refuse_beyond(course: ReferenceTrajectory, joints: Sequence[tuple[str, Joint]]) -> None:
    """Refuse a reference trajectory whose smallest or largest positions exceed the limits of these joints."""
    rounding = MOST_IMPULSES * np.finfo(float).eps  # an angle may be the sum of MOST_IMPULSES terms
    reached = in_joint_units([joint.slides for _, joint in joints], course.extremes())
    for (name, joint), *extremes in zip(joints, *reached, strict=True):
        low, high = joint.limits or (-math.inf, math.inf)
        for position in extremes:
            if max(low - position, position - high) > rounding * np.abs(extremes).max():
                at = f"reaches {position:.9g} {joint.terms.unit}"
                outside = f"outside {joint.limits_key} = {[low, high]} of the joint of {name!r}"
                raise SceneError(f"{at}: {outside}", id="wrench-out-of-reach")
