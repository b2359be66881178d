"""The state in which a scene starts: joints, hinges, a free base."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.own_units import Row, Slides, together
from flexlink.describe.spec import NonNegative, PerLink, Spec, Vector3, measured_in


class BaseState(Spec, frozen=True):
    """Where a free base starts: its frame in frame 0, and how it moves.

    Examples
    --------
    >>> tumbling = fl.details.BaseState(rpy_deg=(0.0, 0.0, 30.0), velocity=(0.1, 0.0, 0.0), spin_deg=(0.0, 0.0, 5.0))
    >>> print(tumbling.rates.round(4))  # rad/s, in axes of the base
    [0.     0.     0.0873]
    """

    xyz: Annotated[Vector3, measured_in("m")] = (0.0, 0.0, 0.0)
    """Place of its frame [m]."""
    rpy_deg: Annotated[Vector3, measured_in("deg")] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about fixed axes [deg]: R = Rz(yaw) Ry(pitch) Rx(roll); multiples of 90° are exact."""
    quaternion: tuple[float, float, float, float] | None = None
    """Its attitude as w, x, y, z in place of `rpy_deg` [1]; its length does not matter."""
    velocity: Annotated[Vector3, measured_in("m/s")] = (0.0, 0.0, 0.0)
    """Velocity of its frame's origin, in frame 0 [m/s]."""
    spin_deg: Annotated[Vector3, measured_in("deg/s")] = (0.0, 0.0, 0.0)
    """Angular velocity, in axes of the base [deg/s]."""
    spin: Annotated[Vector3 | None, measured_in("rad/s")] = None
    """The same [rad/s], in place of `spin_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, other in (("quaternion", "rpy_deg"), ("spin", "spin_deg")):
            if getattr(self, name) is not None and any(getattr(self, other)):
                raise SceneError(
                    f"{name} = {truncated(getattr(self, name))}: {other} is given, too; give only one", id="both-given"
                )
        if self.quaternion is not None and not any(self.quaternion):
            raise SceneError(
                "quaternion = (0.0, 0.0, 0.0, 0.0): has no direction; [1, 0, 0, 0] is no turn", id="zero-direction"
            )

    @property
    def rates(self) -> Array:
        """Angular velocity, in axes of the base [rad/s], shape (3,)."""
        return np.radians(self.spin_deg) if self.spin is None else np.array(self.spin)


class InitialState(Spec, frozen=True):
    """State at the start: one joint angle [deg] and rate [deg/s] per link; a locked joint stays at its angle.

    Prismatic joints stand where `joint_m` [m] and `rate_m` [m/s] say, one number per link, too; either list has 0 where
    a link's joint is of the other kind, and may be left out.

    passive = "zero": springs slack.  "static": hinges bent as gravity and tip wrench bend them with the joints held.
    `q` [rad] and `qd` [rad/s], one number per joint of the chain in sequential order, take the place of all that, as
    `time` [s] does of t = 0: the state from which another run is continued. Beside `q`, `joint_deg` is where the locked
    joints stay, and may be left out: zero in a scene.

    Examples
    --------
    >>> slack = fl.InitialState(joint_deg=(30.0, -60.0))
    >>> sagged = fl.InitialState(joint_deg=(30.0, -60.0), passive="static")  # bent by gravity
    >>> print(slack.passive)
    zero
    """

    joint_deg: Annotated[PerLink, measured_in("deg")] = ()
    """Angle of each joint, one per link [deg]; a locked joint stays there. Default: zero."""
    rate_deg: Annotated[PerLink | None, measured_in("deg/s")] = None
    """Rate of each joint, one per link [deg/s]. Default: at rest."""
    joint_m: Annotated[PerLink | None, measured_in("m")] = None
    """Position of each prismatic joint, one number per link, 0 for the others [m]. Default: zero."""
    rate_m: Annotated[PerLink | None, measured_in("m/s")] = None
    """Rate of each prismatic joint, one number per link [m/s]. Default: at rest."""
    base: BaseState = BaseState()
    """Where a free base starts, and how it moves."""
    passive: Literal["zero", "static"] = "zero"
    """Hinges and elastic gears: springs slack (zero), or bent by gravity and tip wrench, joints held (static)."""
    q: tuple[float, ...] | None = None
    """Whole state instead: one angle per joint of the chain, in order [rad], of those that slide [m]."""
    qd: tuple[float, ...] | None = None
    """Whole state instead: one rate per joint of the chain, in order [rad/s], or [m/s]. Default: at rest."""
    time: Annotated[NonNegative, measured_in("s")] = 0.0
    """When the run starts [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.q is not None and self.passive == "static":
            raise SceneError(
                "passive = 'static': computes the hinges' angles, but q is given, too; give only one", id="both-given"
            )
        for name in ("rate_deg", "rate_m"):
            if self.qd is not None and getattr(self, name) is not None:
                raise SceneError(f"qd = {truncated(self.qd)}: {name} is given, too; give only one", id="both-given")

    def own(self, name: str, slides: Slides) -> Row:
        """A list of one number per link, "joint" or "rate", in the joints' own units; zero where nothing is said."""
        return together(slides, getattr(self, f"{name}_deg") or None, getattr(self, f"{name}_m"))

    @property
    def positions_m(self) -> tuple[float, ...]:
        """Position of every prismatic joint, one number per link [m]; zero unless given."""
        return self.joint_m or (0.0,) * len(self.joint_deg)
