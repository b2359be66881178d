"""Actions on an arm: prescribed motions, and the tip wrench."""

from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import both_given, missing, truncated
from flexlink.describe.joint_units import IN_METRES_OF_MOTION, OF_JOINT, OF_MOTION, TWINS, KindOfJoint, Row, in_si
from flexlink.describe.numbers import check_table, require_increasing
from flexlink.describe.spec import Positive, Spec, Vector3, measured_in

Frame = Literal["world", "tip"]
"""Frame in which a tip wrench is given: frame 0 (world), or the tip frame, which turns with the tip."""


class PrescribedMotion(Spec, frozen=True):
    """Prescribed motion of a link's active joint; the torque it requires is an output.

    Give angle [deg], rate [deg/s] and acceleration [deg/s²] at `times` [s], which start at 0; for a prismatic joint,
    position [m], rate [m/s] and acceleration [m/s²]. Quintic polynomials interpolate between the times; after the last
    one the rate stays constant. The rows may be in a CSV `file`; the joint then starts at the first row.

    Examples
    --------
    >>> turn = fl.PrescribedMotion(
    ...     link="upper", times=(0.0, 1.0), angle_deg=(30.0, 90.0), rate_deg=(0, 0),
    ...     acceleration_deg=(0, 0),
    ... )
    >>> moved = scene.varied({"motion": (turn,), "drive": fl.Drive(), "run.duration": 0.2})
    >>> print(fl.simulate(moved).tau[-1, 0] != 0.0)  # N m, required by the motion
    True
    """

    link: str | int
    """Name, or number from 1, of the link whose joint moves."""
    times: Annotated[tuple[float, ...], measured_in("s")] = ()
    """Times of the rows [s], starting at 0."""
    angle_deg: Annotated[Row | None, measured_in("deg")] = None
    """Angle at each time [deg]."""
    rate_deg: Annotated[Row | None, measured_in("deg/s")] = None
    """Rate at each time [deg/s]."""
    acceleration_deg: Annotated[Row | None, measured_in("deg/s²")] = None
    """Acceleration at each time [deg/s²]."""
    position_m: Annotated[Row | None, measured_in("m")] = None
    """For a prismatic joint, instead of the angle: position at each time [m]."""
    rate_m: Annotated[Row | None, measured_in("m/s")] = None
    """For a prismatic joint: rate at each time [m/s]."""
    acceleration_m: Annotated[Row | None, measured_in("m/s²")] = None
    """For a prismatic joint: acceleration at each time [m/s²]."""
    file: str | None = None
    """A CSV file instead of the rows, with headers "t [s]" and "q NAME [deg]", in any unit of angle (or of length, for
    a prismatic joint). The path is relative to the scene's folder; the file is read once, with the scene."""
    cutoff: Positive | Literal["auto"] | None = None
    """For a file: cutoff frequency (50 % amplitude) of a zero-phase low-pass filter of its angles [Hz]; rates and
    accelerations come from the filtered angles. "auto": the cutoff with the least generalized cross-validation.
    Default: the file is not filtered, and rates and accelerations are its columns "qd NAME [deg/s]" and "qdd NAME
    [deg/s²]"."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.file is not None:
            for name in ("times", *OF_MOTION, *IN_METRES_OF_MOTION):
                if getattr(self, name) not in (None, ()):
                    raise both_given("file", self.file, name)
            return
        if self.cutoff is not None:
            raise self._refused("cutoff", "has no effect without a file; leave cutoff out", "no-effect")
        if not self.times:
            raise missing("times", "give them with angles, rates and accelerations, or give a file")
        require_increasing("times", self.times, from_zero=True)
        for name in self.keys:
            column = getattr(self, name)
            if column is None:
                raise missing(name, f"a motion has times, {', '.join(self.keys)}; or a file with a cutoff")
            if len(column) != len(self.times):
                text = f"{name} has {len(column)} values: expected one per time, {len(self.times)}"
                raise SceneError(text, id="one-per-time")
            other = TWINS[name]
            if getattr(self, other) is not None:
                raise both_given(other, getattr(self, other), name)

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return self.angle_deg is None and any(getattr(self, name) is not None for name in IN_METRES_OF_MOTION)

    def in_si(self) -> Array:
        """Rows `columns` in rad or m, shape (3, times)."""
        return in_si([self.slides], np.array(self.columns)[..., None])[..., 0]

    @property
    def terms(self) -> KindOfJoint:
        """Names of the joint's coordinate, drive and units."""
        return OF_JOINT[self.slides]

    @property
    def keys(self) -> tuple[str, str, str]:
        """Keys of position, rate and acceleration."""
        return self.terms.motion

    @property
    def columns(self) -> tuple[Row, Row, Row]:
        """Positions, rates and accelerations at the times [deg, deg/s, deg/s²], or [m, m/s, m/s²]."""
        position, rate, acceleration = (getattr(self, name) or () for name in self.keys)
        return position, rate, acceleration


class Wrench(Spec, frozen=True):
    """Force [N] and moment [N m] on the tip, acting at the origin of the tip frame.

    Components are in the axes of frame 0 (frame = "world") or of the moving tip frame (frame = "tip"). They are
    either constant (`force` and `moment`) or a table (`forces`, `moments` or both, one row per time [s]), interpolated
    like the torque table of a drive. The table may be in a CSV `file`.

    Examples
    --------
    >>> hook = fl.Wrench(force=(0.0, -20.0, 0.0))  # N, frame 0
    >>> follower = fl.Wrench(force=(0.0, -20.0, 0.0), frame="tip")  # turns with the tip
    >>> print(scene.varied({"wrench": hook}).tip_wrench)
    [  0. -20.   0.   0.   0.   0.]
    """

    force: Annotated[Vector3, measured_in("N")] = (0.0, 0.0, 0.0)
    """Constant force on the tip [N]."""
    moment: Annotated[Vector3, measured_in("N m")] = (0.0, 0.0, 0.0)
    """Constant moment on the tip [N m]."""
    frame: Frame = "world"
    """Frame of the components: frame 0 (world), or the tip frame, which turns with the tip."""
    on: str = ""
    """Name of the link at whose end the wrench acts; no other link may be attached there. Default: the last link."""
    times: Annotated[tuple[float, ...] | None, measured_in("s")] = None
    """For a table: times of its rows [s]."""
    forces: Annotated[tuple[Vector3, ...] | None, measured_in("N")] = None
    """For a table: one force per time [N]."""
    moments: Annotated[tuple[Vector3, ...] | None, measured_in("N m")] = None
    """For a table: one moment per time [N m]."""
    file: str | None = None
    """A CSV file instead of `times`, `forces` and `moments`, with headers "t [s]", "force x [N]" to "moment z [N m]";
    missing components are 0. The path is relative to the scene's folder; the file is read once, with the scene."""
    smooth: bool = False
    """For a table: interpolate by a cubic spline. Default: linear."""
    hold: bool = False
    """For a table: keep the values of each row until the next time."""

    def __post_init__(self) -> None:
        super().__post_init__()
        tables = {"forces": self.forces, "moments": self.moments}
        if self.file is not None:
            for name in ("times", *tables, "force", "moment"):
                value = getattr(self, name)
                if value is not None and any(value):
                    raise both_given("file", self.file, name)
            return
        check_table(self.times, tables, smooth=self.smooth, hold=self.hold)
        if self.times is None:
            for name, rows in tables.items():
                if rows is not None:
                    raise self._refused(name, "needs times, one per row", "needs-another-key")
            return
        if self.forces is None and self.moments is None:
            raise self._refused("times", "needs forces, moments or both, one row per time", "missing-key")
        for name in ("force", "moment"):
            if any(getattr(self, name)):
                raise self._refused(name, f"times are also given; give {name}s, one row per time", "one-per-time")

    @property
    def varies(self) -> bool:
        """Whether the wrench may change over time in frame 0."""
        return self.times is not None or (self.frame == "tip" and self.acts)

    @property
    def constant(self) -> Array:
        """Force and moment, shape (6,), in frame 0.

        Raises
        ------
        SceneError
            The wrench is not constant in frame 0; the message gives the path of the scene's key that makes it vary.
        """
        if self.varies:
            cause = "frame = 'tip'" if self.frame == "tip" else f"times = {truncated(self.times)}"
            text = "Trajectory.tip_wrench contains the wrench at the samples"
            raise SceneError(f"wrench.{cause}: is not constant in frame 0; {text}", id="load-not-constant")
        return np.array([*self.force, *self.moment])

    @property
    def acts(self) -> bool:
        """Whether the wrench is nonzero at any time."""
        return any(self.force) or any(self.moment) or any(map(any, (*(self.forces or ()), *(self.moments or ()))))
