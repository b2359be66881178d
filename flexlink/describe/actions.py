"""Actions on an arm: drives, prescribed motions, and the tip wrench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import plural, truncated
from flexlink.describe.joint_units import TWINS, Row
from flexlink.describe.numbers import require_increasing
from flexlink.describe.reference import OF_MOTION, Reference
from flexlink.describe.spec import (
    ONE_PER_LINK,
    NonNegative,
    PerLink,
    Positive,
    PositivePerLink,
    Spec,
    Vector3,
    measured_in,
)

IN_METRES_OF_MOTION = "position_m", "rate_m", "acceleration_m"
Frame = Literal["world", "tip"]
"""Frame in which a tip wrench is given: frame 0 (world), or the tip frame, which turns with the tip."""


class Drive(Spec, frozen=True):
    """Drive torques T_EX at the active joints, one per link; at prismatic joints, forces [N].

    constant: T_EX = torque [N m].  table: `torques`, one row per time, constant before the first and after the last
    row. Between rows the torque is linear by default, a cubic spline with `smooth` (which preserves the integrator's
    order), or constant until the next time with `hold`. The rows may be in a CSV `file`.
    pd: T_EX = kp (r − q) + kd (ṙ − q̇) + g [N m/rad, N m s/rad], where r is `target_deg` or the time-varying
    `reference`. g depends on `gravity`: zero ("none"), or the torque that keeps the joints at r against gravity, for
    the rigid arm ("rigid") or the arm bent by gravity ("static"); or g is a table of `torques` at `times`.
    computed_torque: T_EX = M (r̈ + kd (ṙ − q̇) + kp (r − q)) + T_GC, with kp [1/s²] and kd [1/s]. The mass matrix
    M and the gravity and Coriolis torques T_GC are computed for the rigid arm, at q and q̇ of the driven joints.
    `effort` limits the torque of each drive [N m], including torques computed by a controller written in Python.
    With `rate` [Hz] the controller is sampled at times t = k / rate, and its output stays constant between them. With
    `delay` [s] each output acts that much later; until the first one does, the torque is that of the first instant, as
    if the arm had been in its first state before.

    Examples
    --------
    >>> pd = fl.Drive(kind="pd", kp=(2e4, 1e4), kd=(600.0, 250.0), gravity="static", target_deg=(40.0, -60.0))
    >>> constant = fl.Drive(kind="constant", torque=(30.0, 10.0))  # N m, one number per link
    >>> held = scene.varied({"drive": pd})
    """

    kind: Literal["none", "constant", "table", "pd", "computed_torque"] = "none"
    """Drive of the joints: none, a constant torque, a table over time, or a controller (pd or computed_torque)."""
    torque: PerLink | None = None
    """For constant: torque on each joint, one per link [N m]; for a prismatic joint, the force [N]."""
    times: Annotated[tuple[float, ...] | None, measured_in("s")] = None
    """For a table, or a feedforward table of pd: times of its rows [s]."""
    torques: tuple[PerLink, ...] | None = None
    """For a table, or a feedforward table of pd: one row per time, with one torque per link [N m], or force [N]."""
    file: str | None = None
    """For a table, or a feedforward table of pd: a CSV file instead of `times` and `torques`, with headers "t [s]" and
    "tau NAME [N m]" for every driven joint. The path is relative to the scene's folder; the file is read once, with the
    scene."""
    kp: Annotated[tuple[NonNegative, ...], ONE_PER_LINK] | None = None
    """For a controller: position gains, one per link [N m/rad; N/m]; for computed_torque [1/s²]."""
    kd: Annotated[tuple[NonNegative, ...], ONE_PER_LINK] | None = None
    """For a controller: rate gains, one per link [N m s/rad; N s/m]; for computed_torque [1/s]."""
    target_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """For a controller: target angles of the joints, one per link [deg]."""
    target_m: Annotated[PerLink | None, measured_in("m")] = None
    """For a controller: target positions of prismatic joints, one per link [m]."""
    reference: Reference | None = None
    """For a controller: time-varying target of the joints, instead of `target_deg`."""
    gravity: Literal["none", "rigid", "static"] = "none"
    """For pd: feedforward torque that holds the rigid arm (rigid) or the arm bent by gravity (static) at the target."""
    smooth: bool = False
    """For a table: interpolate by a cubic spline, which preserves the integrator's order. Default: linear."""
    hold: bool = False
    """For a table: keep the values of each row until the next time."""
    effort: PositivePerLink | None = None
    """Torque limit of each drive, one per link [N m; N]. Default: no limit."""
    rate: Annotated[Positive | None, measured_in("Hz")] = None
    """Sampling rate of the controller [Hz]; its torques stay constant between samples. Default: the controller is
    evaluated at every stage of a step."""
    delay: Annotated[NonNegative, measured_in("s")] = 0.0
    """For a sampled controller: time from a sampling instant until its torques act (computation and transmission) [s];
    any time, also parts of a sampling period or several periods."""

    def __post_init__(self) -> None:
        super().__post_init__()
        in_deg = self.target_deg is not None or self.target_m is None
        towards = ("target_deg" if in_deg else "target_m") if self.reference is None else "reference"
        wanted = {
            "none": (), "constant": ("torque",), "table": ("times", "torques") if self.file is None else ("file",),
            "pd": ("kp", "kd", towards), "computed_torque": ("kp", "kd", towards),
        }[self.kind]  # fmt: skip
        may: tuple[str, ...] = ("target_m",) if towards == "target_deg" in wanted else ()
        may += ("times", "torques", "file") if self.kind == "pd" else ()
        for name in ("torque", "times", "torques", "file", "kp", "kd", "target_deg", "target_m", "reference"):
            if (getattr(self, name) is not None) != (name in wanted) and name not in may:
                takes, value = ", ".join(wanted) or "nothing else", getattr(self, name)
                takes = takes.replace("target_deg", "target_deg or reference (target_m for prismatic joints)")
                takes = f"drive kind {self.kind!r} takes {takes}"
                if value is None:
                    raise SceneError(f"{name}: missing; {takes}", id="missing-key")
                raise SceneError(f"{name} = {truncated(value)}: {takes}", id="key-of-another-kind")
        if self.file is None:
            check_table(self.times, {"torques": self.torques}, smooth=self.smooth, hold=self.hold)
        if self.gravity != "none" and self.kind != "pd":
            raise SceneError(f"gravity = {self.gravity!r}: needs drive kind 'pd'", id="needs-pd")
        if self.kind == "pd":
            self._check_feedforward()
        if self.rate is not None and self.kind == "none":
            raise SceneError(
                f"rate = {self.rate!r}: has no effect with drive kind 'none'; leave rate out", id="no-effect"
            )
        if self.delay and self.rate is None:
            raise SceneError(
                f"delay = {self.delay!r}: needs rate, the sampling rate of the controller [Hz], such as rate = 1000",
                id="needs-another-key",
            )

    def _check_feedforward(self) -> None:
        """Check the feedforward table of a pd drive."""
        given = [name for name in ("times", "torques", "file") if getattr(self, name) is not None]
        if self.file is None and len(given) == 1:
            missing = "torques" if self.times is not None else "times"
            raise SceneError(f"{missing}: missing; a feedforward table has times and torques", id="missing-key")
        if self.file is not None and len(given) > 1:
            raise SceneError(f"file = {self.file!r}: {given[0]} is also given; specify only one", id="both-given")
        if given and self.gravity != "none":
            raise SceneError(f"gravity = {self.gravity!r}: {given[0]} is also given; specify only one", id="both-given")
        if self.hold:
            raise SceneError("hold = True: needs drive kind 'table'", id="key-of-another-kind")


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
            self._check_file()
            return
        if self.cutoff is not None:
            raise SceneError(
                f"cutoff = {self.cutoff!r}: has no effect without a file; leave cutoff out", id="no-effect"
            )
        if not self.times:
            raise SceneError(
                "times: missing; give them with angles, rates and accelerations, or give a file", id="missing-key"
            )
        if self.times[0] != 0:
            raise SceneError(f"times[0] = {self.times[0]!r}: must be 0", id="first-time")
        require_increasing("times", self.times)
        for name in self.keys:
            column = getattr(self, name)
            if column is None:
                raise SceneError(f"{name}: missing; this key is required", id="missing-key")
            if len(column) != len(self.times):
                raise SceneError(
                    f"{name} has {len(column)} values: expected one per time, {len(self.times)}", id="one-per-time"
                )
            other = TWINS[name]
            if getattr(self, other) is not None:
                raise SceneError(
                    f"{other} = {truncated(getattr(self, other))}: {name} is also given; specify only one",
                    id="both-given",
                )

    def _check_file(self) -> None:
        for name in ("times", *OF_MOTION, *IN_METRES_OF_MOTION):
            if getattr(self, name) not in (None, ()):
                raise SceneError(f"file = {self.file!r}: {name} is also given; specify only one", id="both-given")

    @property
    def slides(self) -> bool:
        """Whether the joint is prismatic."""
        return self.angle_deg is None and any(getattr(self, name) is not None for name in IN_METRES_OF_MOTION)

    @property
    def keys(self) -> tuple[str, str, str]:
        """Keys of position, rate and acceleration."""
        return IN_METRES_OF_MOTION if self.slides else OF_MOTION

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
                    raise SceneError(f"file = {self.file!r}: {name} is also given; specify only one", id="both-given")
            return
        check_table(self.times, tables, smooth=self.smooth, hold=self.hold)
        if self.times is None:
            for name, rows in tables.items():
                if rows is not None:
                    raise SceneError(f"{name} = {truncated(rows)}: needs times, one per row", id="needs-another-key")
            return
        if self.forces is None and self.moments is None:
            raise SceneError(
                f"times = {truncated(self.times)}: needs forces, moments or both, one row per time", id="missing-key"
            )
        for name in ("force", "moment"):
            if any(getattr(self, name)):
                raise SceneError(
                    f"{name} = {truncated(getattr(self, name))}: times are also given; give {name}s, one row per time",
                    id="one-per-time",
                )

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
            raise SceneError(
                f"wrench.{cause}: is not constant in frame 0; Trajectory.tip_wrench contains the wrench at the samples",
                id="load-not-constant",
            )
        return np.array([*self.force, *self.moment])

    @property
    def acts(self) -> bool:
        """Whether the wrench is nonzero at any time."""
        return any(self.force) or any(self.moment) or any(map(any, (*(self.forces or ()), *(self.moments or ()))))


def check_table(
    times: tuple[float, ...] | None, tables: Mapping[str, Sequence[object] | None], *, smooth: bool, hold: bool
) -> None:
    """Check that times increase, that every table has one row per time, and that the interpolation is possible.

    Raises
    ------
    SceneError
        A check fails; the message names the key or the row.
    """
    if times is not None:
        require_increasing("times", times)
    if smooth and len(times or ()) < 2:
        raise SceneError(f"smooth = {smooth}: needs a table with at least 2 times", id="needs-another-key")
    if hold and (smooth or times is None):
        raise SceneError(f"hold = {hold}: needs a table with smooth = False", id="needs-another-key")
    for name, rows in tables.items():
        if times is not None and rows is not None and len(rows) != len(times):
            raise SceneError(f"{name}: {plural(len(rows), 'row')}, but {len(times)} times", id="one-per-time")
