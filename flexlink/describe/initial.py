"""Initial state of a scene: joints, hinges, and a free base."""

from typing import Annotated, Literal

import numpy as np

from flexlink.common.types import Array
from flexlink.common.wording import both_given
from flexlink.describe.spec import NonNegative, PerLink, Spec, Vector3, measured_in


class BaseState(Spec, frozen=True):
    """Initial pose and velocity of a free base, in frame 0.

    Examples
    --------
    >>> tumbling = fl.details.BaseState(rpy_deg=(0.0, 0.0, 30.0), velocity=(0.1, 0.0, 0.0), spin_deg=(0.0, 0.0, 5.0))
    >>> print(tumbling.rates.round(4))  # rad/s, in axes of the base
    [0.     0.     0.0873]
    """

    xyz: Annotated[Vector3, measured_in("m")] = (0.0, 0.0, 0.0)
    """Position of the base's frame in frame 0 [m]."""
    rpy_deg: Annotated[Vector3, measured_in("deg")] = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about fixed axes [deg]: R = Rz(yaw) Ry(pitch) Rx(roll); multiples of 90° are exact."""
    quaternion: tuple[float, float, float, float] | None = None
    """Attitude as a quaternion w, x, y, z [1], instead of `rpy_deg`; need not be normalized."""
    velocity: Annotated[Vector3, measured_in("m/s")] = (0.0, 0.0, 0.0)
    """Velocity of the origin of the base's frame, in frame 0 [m/s]."""
    spin_deg: Annotated[Vector3, measured_in("deg/s")] = (0.0, 0.0, 0.0)
    """Angular velocity, in axes of the base [deg/s]."""
    spin: Annotated[Vector3 | None, measured_in("rad/s")] = None
    """Angular velocity, in axes of the base [rad/s], instead of `spin_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, other in (("quaternion", "rpy_deg"), ("spin", "spin_deg")):
            if getattr(self, name) is not None and any(getattr(self, other)):
                raise both_given(name, getattr(self, name), other)
        if self.quaternion is not None and not any(self.quaternion):
            raise self._refused("quaternion", "must not be zero; no rotation is [1, 0, 0, 0]", "zero-direction")

    @property
    def rates(self) -> Array:
        """Angular velocity, in axes of the base [rad/s], shape (3,)."""
        return np.radians(self.spin_deg) if self.spin is None else np.array(self.spin)


class InitialState(Spec, frozen=True):
    """Initial state: one joint angle [deg] and rate [deg/s] per link; a locked joint stays at its angle.

    Prismatic joints use `joint_m` [m] and `rate_m` [m/s], also one number per link. Each list has 0 for joints of the
    other kind, and may be left out.

    With passive = "zero", all springs are unloaded; with "static", hinges are in static equilibrium under gravity and
    the tip wrench, with the joints held.
    Instead, `q` [rad] and `qd` [rad/s] give the complete state, one number per joint of the chain in order, and `time`
    [s] the start time: this is how a run is continued. With `q`, `joint_deg` only gives the angles of locked joints;
    its default is zero.

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
    """Initial pose and velocity of a free base."""
    passive: Literal["zero", "static"] = "zero"
    """Hinges and elastic gears start with unloaded springs (zero), or in static equilibrium, joints held (static)."""
    q: tuple[float, ...] | None = None
    """Complete state, instead of `joint_deg`: position of every joint of the chain, in order [rad], prismatic [m]."""
    qd: tuple[float, ...] | None = None
    """Complete state: rate of every joint of the chain, in order [rad/s], prismatic [m/s]. Default: at rest."""
    time: Annotated[NonNegative, measured_in("s")] = 0.0
    """Start time of the run [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.q is not None and self.passive == "static":
            why = "computes the hinge angles, but q is also given; specify only one"
            raise self._refused("passive", why, "both-given")
        for name in ("rate_deg", "rate_m"):
            if self.qd is not None and getattr(self, name) is not None:
                raise both_given("qd", self.qd, name)

    @property
    def positions_m(self) -> tuple[float, ...]:
        """Position of every prismatic joint, one number per link [m]; default zero."""
        return self.joint_m or (0.0,) * len(self.joint_deg)
