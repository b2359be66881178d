"""How a link hangs on the one before it: placement of the joint, and the joint itself."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.directions import unit
from flexlink.describe.own_units import OF_JOINT, in_own
from flexlink.describe.reference_trajectory import ReferenceTrajectory
from flexlink.describe.shaping import MOST_IMPULSES
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, measured_in


class Joint(Spec, frozen=True):
    """Active joint at the root of a link, about or along `axis` in the link's frame; `locked` makes it rigid.

    The link's frame turns about the axis of a revolute joint, slides along that of a prismatic one, and is the mount's
    at zero. Where units are those of a revolute joint, as N m/rad, a prismatic one has N/m, and so on.
    With `gear_stiffness` k the gear is elastic: motor, with armature, friction and drive, and link turn about
    the same axis, and between them act k (θ_link − θ_motor) and `gear_damping` times the difference of
    their rates. The joint's angle is then the motor's; `locked` holds the motor.
    Friction torque T_FR = viscous · q̇ + coulomb · tanh(q̇ / coulomb_width). The tanh makes Coulomb's law
    smooth, which Runge-Kutta needs: at |q̇| = 3 · coulomb_width it has reached 99.5 % of the dry torque.

    Examples
    --------
    >>> motor = fl.Joint(axis=(0.0, 1.0, 0.0), armature=0.5, viscous=2.0)  # kg m², N m s/rad
    >>> geared = fl.Joint(armature=0.5, gear_stiffness=8e3)  # N m/rad
    >>> welded = fl.Joint(locked=True)
    >>> trolley = fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), viscous=50.0, limits_m=(0.0, 8.0))  # N s/m, m
    """

    kind: Literal["revolute", "prismatic"] = "revolute"
    """Whether the joint turns about its axis (revolute) or slides along it (prismatic)."""
    axis: Vector3 = (0.0, 0.0, 1.0)
    """Axis in the link's frame; its length does not matter."""
    locked: bool = False
    """Whether the joint stays where it starts."""
    viscous: Annotated[NonNegative, measured_in("N m s/rad", "N s/m")] = 0.0
    """Viscous friction torque per rate [N m s/rad]; of a prismatic joint [N s/m]."""
    viscous_lag: Annotated[NonNegative, measured_in("s")] = 0.0
    """Time τ by which viscous friction lags behind the rate [s], as of a damper in series with a spring: d ζ with
    τ ζ̇ = q̇ − ζ, in place of d q̇."""
    quadratic: Annotated[NonNegative, measured_in("N m s²/rad²", "N s²/m²")] = 0.0
    """Torque c |q̇| q̇ per squared rate, as of a hydraulic damper [N m s²/rad²]; of a prismatic joint [N s²/m²]."""
    coulomb: Annotated[NonNegative, measured_in("N m", "N")] = 0.0
    """Dry friction torque c [N m], as c tanh(q̇ / coulomb_width); of a prismatic joint a force [N]."""
    coulomb_width: Annotated[Positive, measured_in("rad/s", "m/s")] = 0.01
    """Rate at which tanh has reached 76 % of it [rad/s], or [m/s]; smaller is closer to Coulomb's law, and stiffer."""
    armature: Annotated[NonNegative, measured_in("kg m²", "kg")] = 0.0
    """Rotor inertia seen at the joint [kg m²]: that of the motor times the square of the gear ratio; of a prismatic
    joint [kg]."""
    gear_stiffness: Annotated[Positive | None, measured_in("N m/rad", "N/m")] = None
    """Stiffness of an elastic gear between motor and link [N m/rad], of a belt or rope of a prismatic joint [N/m]; it
    needs `armature`. Default: rigid."""
    gear_damping: Annotated[NonNegative, measured_in("N m s/rad", "N s/m")] = 0.0
    """Damping of the elastic gear [N m s/rad], of a prismatic joint [N s/m]."""
    limits_deg: Annotated[tuple[float, float] | None, measured_in("deg")] = None
    """Lower and upper limit of the angle [deg]: kept, exported, and told when a run passes them; no stops."""
    limits_m: Annotated[tuple[float, float] | None, measured_in("m")] = None
    """Of a prismatic joint: lower and upper limit of its position [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.direction  # noqa: B018  refuses an axis without one
        other = "limits_deg" if self.slides else "limits_m"
        if getattr(self, other) is not None:
            raise SceneError(
                f"{other} = {getattr(self, other)}: a {self.kind} joint takes {self.limits_key}",
                id="key-of-another-kind",
            )
        if self.own_limits is not None and self.own_limits[0] >= self.own_limits[1]:
            raise SceneError(
                f"{self.limits_key} = {self.own_limits}: the lower one must be below the upper one", id="limits-order"
            )
        if self.viscous_lag and not self.viscous:
            raise SceneError(
                f"viscous_lag = {self.viscous_lag!r}: needs a viscous friction > 0", id="needs-another-key"
            )
        if self.gear_stiffness is None and self.gear_damping:
            raise SceneError(f"gear_damping = {self.gear_damping!r}: needs a gear_stiffness", id="needs-another-key")
        if self.gear_stiffness is not None and not self.armature and not self.locked:
            raise SceneError(
                f"armature = {self.armature!r}, the default: gear_stiffness = {self.gear_stiffness!r} needs the "
                "motor's inertia; nothing else moves between motor and gear",
                id="needs-another-key",
            )

    @property
    def slides(self) -> bool:
        """Whether it is prismatic."""
        return self.kind == "prismatic"

    @property
    def lags(self) -> bool:
        """Whether it turns, or slides, with friction that lags behind."""
        return self.viscous_lag > 0 and not self.locked

    @property
    def limits_key(self) -> str:
        """The key of its limits."""
        return "limits_m" if self.slides else "limits_deg"

    @property
    def own_limits(self) -> tuple[float, float] | None:
        """Its limits [m], of a revolute joint [deg]."""
        return self.limits_m if self.slides else self.limits_deg

    def position(self, deg: float, m: float) -> float:
        """Its coordinate [rad], or [m] if it slides, by the two numbers of its link in lists in deg and in m."""
        return m if self.slides else math.radians(deg)

    @property
    def direction(self) -> Array:
        """Unit vector along the axis, in the link's frame, shape (3,)."""
        return unit("axis", self.axis)


class Mount(Spec, frozen=True):
    """Placement of a joint frame in the end frame of the link before it (of the first link: in frame 0).

    First the offset `xyz` [m], then `rpy_deg` [deg] or `rpy` [rad], roll, pitch, yaw about fixed axes:
    R = Rz(yaw) Ry(pitch) Rx(roll), the convention of URDF; v_parent = R v_joint. Multiples of 90° are exact.

    Examples
    --------
    >>> upright = fl.Mount(rpy_deg=(90.0, 0.0, 0.0))  # the joint's axis horizontal, where Z is up
    >>> beside = fl.Mount(xyz=(0.1, 0.0, 0.05))  # m, in the frame of the link before
    >>> link = fl.Link(name="boom", mount=upright)
    """

    xyz: Annotated[Vector3, measured_in("m")] = (0.0, 0.0, 0.0)
    """Offset [m]."""
    rpy_deg: Annotated[Vector3, measured_in("deg")] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about fixed axes [deg]; multiples of 90° are exact."""
    rpy: Annotated[Vector3 | None, measured_in("rad")] = None
    """Roll, pitch, yaw [rad], in place of `rpy_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rpy is not None and any(self.rpy_deg):
            raise SceneError(
                f"rpy = {truncated(self.rpy)}: rpy_deg = {truncated(self.rpy_deg)} is given, too; give only one",
                id="both-given",
            )


class DenavitHartenberg(Spec, frozen=True):
    """A row of a table of Denavit and Hartenberg; the joint turns about Z, and its angle adds to `theta_deg`.

    standard (Siciliano et al. 2009, section 2.8.2): T = Rz(θ) Tz(d) Tx(a) Rx(α) from the axes before the joint's turn
    to the link's end frame; the beam of a link with neither `length` nor `line` runs from the joint to (a, 0, d).
    modified (Craig 2005, section 3.4): T = Rx(α) Tx(a) Rz(θ) Tz(d) from the frame of the link before, not from its end
    frame, to this link's; a and α are Craig's of the link before, a_{i−1}, α_{i−1}, as in the rows of his tables.
    Either way the table alone says where the axes are: a beam runs beside it, and carries it at its end. A standard
    table says where the tip is, too; a modified one ends in the last joint's frame, and the tip is the end of the last
    link's beam, without a beam that frame. The link's `mount`, that of the base, comes before the row. `a`, `d` [m].

    Examples
    --------
    >>> row = fl.details.DenavitHartenberg(convention="modified", a=0.4, alpha_deg=-90.0)
    >>> link = fl.Link(name="upper", dh=row)
    """

    convention: Literal["standard", "modified"]
    """Siciliano's (standard) or Craig's (modified)."""
    a: Annotated[float, measured_in("m")] = 0.0
    """Length a along x [m]."""
    alpha_deg: Annotated[float, measured_in("deg")] = 0.0
    """Twist α about x [deg]."""
    d: Annotated[float, measured_in("m")] = 0.0
    """Offset d along z [m]."""
    theta_deg: Annotated[float, measured_in("deg")] = 0.0
    """Angle θ about z at joint angle 0 [deg]."""

    @property
    def end(self) -> Vector3:
        """Where the row ends the link, in the link's frame [m]; a modified one ends in the frame itself."""
        return (self.a, 0.0, self.d) if self.convention == "standard" else (0.0, 0.0, 0.0)


def refuse_beyond(course: ReferenceTrajectory, joints: Sequence[tuple[str, Joint]]) -> None:
    """Refuse a course that leaves the limits of the joints of links of these names, at any extreme of any piece.

    Raises
    ------
    SceneError
        The message names the link, the angle reached and the limits.
    """
    rounding = MOST_IMPULSES * np.finfo(float).eps  # of an angle that is the sum of as many
    reached = in_own([joint.slides for _, joint in joints], course.extremes())
    for (name, joint), *extremes in zip(joints, *reached, strict=True):
        low, high = joint.own_limits or (-math.inf, math.inf)
        for place in extremes:
            if max(low - place, place - high) > rounding * np.abs(extremes).max():
                reason = f"outside {joint.limits_key} = {[low, high]} of the joint of {name!r}"
                raise SceneError(
                    f"reaches {place:.9g} {OF_JOINT[joint.slides].unit}: {reason}", id="wrench-out-of-reach"
                )
