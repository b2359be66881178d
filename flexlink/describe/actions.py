"""What acts on an arm: drives, prescribed motions, a wrench at a tip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.numbers import require_increasing
from flexlink.describe.own_units import TWINS, Row
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
"""Axes that a tip wrench is given in: of frame 0, or of the tip frame, with which it turns."""


class Drive(Spec, frozen=True):
    """Drive torque T_EX at the active joints, one column per link; at prismatic joints forces [N].

    constant: T_EX = torque [N m].  table: `torques`, one row per time, held outside, in between linear or, if `smooth`,
    a cubic spline, which keeps the order of the integrator; or, if `hold`, each row held until the next time. They may
    stand in a CSV `file`.
    pd: T_EX = kp (r − q) + kd (ṙ − q̇) + g, r the `target_deg`, or in time the `reference` [N m/rad, N m s/rad]; g by
    `gravity`: "none", the torque that holds the rigid arm at r against gravity ("rigid"), or that holds the arm as
    gravity bends it, its joints at r ("static").
    computed_torque: T_EX = M (r̈ + kd (ṙ − q̇) + kp (r − q)) + T_GC of the rigid arm, q and q̇ the driven joints'
    [1/s², 1/s].
    `effort`: the largest torque of each drive [N m], beyond which it stays there; also of laws in Python.
    With `rate` [Hz] the law is asked at instants t = k / rate, and what it gives is held in between.

    Examples
    --------
    >>> pd = fl.Drive(kind="pd", kp=(2e4, 1e4), kd=(600.0, 250.0), gravity="static", target_deg=(40.0, -60.0))
    >>> constant = fl.Drive(kind="constant", torque=(30.0, 10.0))  # N m, one number a link
    >>> held = scene.varied({"drive": pd})
    """

    kind: Literal["none", "constant", "table", "pd", "computed_torque"] = "none"
    """What drives the joints: nothing, a constant torque, a table in time, or a law, pd or computed_torque."""
    torque: PerLink | None = None
    """Of constant: torque of each joint, one per link [N m]; of a prismatic joint its force [N]."""
    times: Annotated[tuple[float, ...] | None, measured_in("s")] = None
    """Of a table: times of its rows [s]."""
    torques: tuple[PerLink, ...] | None = None
    """Of a table: one row per time, of one torque per link [N m], of prismatic joints one force [N]."""
    file: str | None = None
    """Of a table: a CSV file in place of `times` and `torques`, with heads "t [s]" and, of every driven joint,
    "tau NAME [N m]"; a path from the scene's folder. It is read once, when the scene is."""
    kp: Annotated[tuple[NonNegative, ...], ONE_PER_LINK] | None = None
    """Of a law: position gains, one per link [N m/rad; N/m]; of computed_torque [1/s²]."""
    kd: Annotated[tuple[NonNegative, ...], ONE_PER_LINK] | None = None
    """Of a law: rate gains, one per link [N m s/rad; N s/m]; of computed_torque [1/s]."""
    target_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """Of a law: where it leads the joints, one per link [deg]."""
    target_m: Annotated[PerLink | None, measured_in("m")] = None
    """Of a law: where it leads prismatic joints, one per link [m]."""
    reference: Reference | None = None
    """Of a law: where it leads the joints in time, in place of `target_deg`."""
    gravity: Literal["none", "rigid", "static"] = "none"
    """Of pd: feed-forward torque that holds the rigid arm (rigid) or the arm bent by gravity (static) there."""
    smooth: bool = False
    """Of a table: a cubic spline between its rows, which keeps the integrator's order; else linear."""
    hold: bool = False
    """Of a table: each row is held until the next time."""
    effort: PositivePerLink | None = None
    """Largest torque of each drive, one per link [N m; N]; beyond, it stays there. Default: no limit."""
    rate: Annotated[Positive | None, measured_in("Hz")] = None
    """How often the law is asked [Hz]; its torques are held in between. Default: at every stage of a step."""

    def __post_init__(self) -> None:
        super().__post_init__()
        in_deg = self.target_deg is not None or self.target_m is None
        towards = ("target_deg" if in_deg else "target_m") if self.reference is None else "reference"
        wanted = {
            "none": (), "constant": ("torque",), "table": ("times", "torques") if self.file is None else ("file",),
            "pd": ("kp", "kd", towards), "computed_torque": ("kp", "kd", towards),
        }[self.kind]  # fmt: skip
        may = ("target_m",) if towards == "target_deg" in wanted else ()
        for name in ("torque", "times", "torques", "file", "kp", "kd", "target_deg", "target_m", "reference"):
            if (getattr(self, name) is not None) != (name in wanted) and name not in may:
                takes, value = ", ".join(wanted) or "nothing else", getattr(self, name)
                takes = takes.replace("target_deg", "target_deg or reference (target_m of joints that slide)")
                state = ": missing;" if value is None else f" = {truncated(value)}:"
                raise SceneError(f"{name}{state} drive kind {self.kind!r} takes {takes}", id="key-of-another-kind")
        if self.file is None:
            check_table(self.times, {"torques": self.torques}, smooth=self.smooth, hold=self.hold)
        if self.gravity != "none" and self.kind != "pd":
            raise SceneError(f"gravity = {self.gravity!r}: needs drive kind 'pd'", id="needs-pd")
        if self.rate is not None and self.kind == "none":
            raise SceneError(
                f"rate = {self.rate!r}: has no effect with drive kind 'none'; leave rate out", id="no-effect"
            )


class PrescribedMotion(Spec, frozen=True):
    """Prescribed motion of a link's active joint: its torque becomes an output.

    Angle [deg], rate [deg/s] and acceleration [deg/s²] at `times` [s], which start at 0; quintic polynomials in
    between, then on at the last rate. Of a prismatic joint position [m], rate [m/s] and acceleration [m/s²]. They may
    stand in a CSV `file`, at whose first row the joint then starts.

    Examples
    --------
    >>> turn = fl.PrescribedMotion(
    ...     link="upper", times=(0.0, 1.0), angle_deg=(30.0, 90.0), rate_deg=(0, 0),
    ...     acceleration_deg=(0, 0),
    ... )
    >>> moved = scene.varied({"motion": (turn,), "drive": fl.Drive(), "run.duration": 0.2})
    >>> print(fl.simulate(moved).tau[-1, 0] != 0.0)  # N m that the motion takes
    True
    """

    link: str | int
    """Name or number, from 1, of the link whose joint moves so."""
    times: Annotated[tuple[float, ...], measured_in("s")] = ()
    """Times of the rows [s], from 0 on."""
    angle_deg: Annotated[Row | None, measured_in("deg")] = None
    """Angle at each time [deg]."""
    rate_deg: Annotated[Row | None, measured_in("deg/s")] = None
    """Rate at each time [deg/s]."""
    acceleration_deg: Annotated[Row | None, measured_in("deg/s²")] = None
    """Acceleration at each time [deg/s²]."""
    position_m: Annotated[Row | None, measured_in("m")] = None
    """Of a prismatic joint, in place of the angle: position at each time [m]."""
    rate_m: Annotated[Row | None, measured_in("m/s")] = None
    """Of a prismatic joint: rate at each time [m/s]."""
    acceleration_m: Annotated[Row | None, measured_in("m/s²")] = None
    """Of a prismatic joint: acceleration at each time [m/s²]."""
    file: str | None = None
    """A CSV file in place of all these, with heads "t [s]" and "q NAME [deg]", or any unit of angles, of a prismatic
    joint of lengths; a path from the scene's folder. It is read once, when the scene is."""
    cutoff: Positive | None = None
    """Of a file: frequency at which a zero-phase low-pass of its angles lets half of the amplitude through [Hz]; rates
    and accelerations are those of what is left. Default: the columns "qd NAME [deg/s]" and "qdd NAME [deg/s²]"."""

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
                "times: missing; give them with the angles, rates and accelerations there, or a file", id="missing-key"
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
                    f"{other} = {truncated(getattr(self, other))}: {name} is given, too; give only one", id="both-given"
                )

    def _check_file(self) -> None:
        for name in ("times", *OF_MOTION, *IN_METRES_OF_MOTION):
            if getattr(self, name) not in (None, ()):
                raise SceneError(f"file = {self.file!r}: {name} is given, too; give only one", id="both-given")

    @property
    def slides(self) -> bool:
        """Whether it is the motion of a prismatic joint."""
        return self.angle_deg is None and any(getattr(self, name) is not None for name in IN_METRES_OF_MOTION)

    @property
    def keys(self) -> tuple[str, str, str]:
        """Keys of position, rate and acceleration."""
        return IN_METRES_OF_MOTION if self.slides else OF_MOTION

    @property
    def columns(self) -> tuple[Row, Row, Row]:
        """Positions, rates and accelerations at the times, [deg] and so on, or [m]."""
        position, rate, acceleration = (getattr(self, name) or () for name in self.keys)
        return position, rate, acceleration


class Wrench(Spec, frozen=True):
    """Force [N] and moment [N m] on the tip, acting at the tip frame's origin.

    Their components are in axes of frame = "world", frame 0, or "tip", with which they turn. They are constant, `force`
    and `moment`, or a table: `forces`, `moments` or both, one row per time [s], held outside, in between as a drive's;
    they may stand in a CSV `file`.

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
    """Axes of the components: of frame 0 (world), or of the tip, with which they turn."""
    on: str = ""
    """Name of the link at whose end it acts, one that no other hangs on. Default: the last."""
    times: Annotated[tuple[float, ...] | None, measured_in("s")] = None
    """Of a table: times of its rows [s]."""
    forces: Annotated[tuple[Vector3, ...] | None, measured_in("N")] = None
    """Of a table: a force per time [N]."""
    moments: Annotated[tuple[Vector3, ...] | None, measured_in("N m")] = None
    """Of a table: a moment per time [N m]."""
    file: str | None = None
    """A CSV file in place of `times`, `forces` and `moments`, with heads "t [s]", "force x [N]" to "moment z [N m]";
    what has no column is 0. A path from the scene's folder; it is read once, when the scene is."""
    smooth: bool = False
    """Of a table: a cubic spline between its rows; else linear."""
    hold: bool = False
    """Of a table: each row is held until the next time."""

    def __post_init__(self) -> None:
        super().__post_init__()
        tables = {"forces": self.forces, "moments": self.moments}
        if self.file is not None:
            for name in ("times", *tables, "force", "moment"):
                value = getattr(self, name)
                if value is not None and any(value):
                    raise SceneError(f"file = {self.file!r}: {name} is given, too; give only one", id="both-given")
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
                    f"{name} = {truncated(getattr(self, name))}: times are given, so give {name}s, one row per time",
                    id="one-per-time",
                )

    @property
    def varies(self) -> bool:
        """Whether it may change in frame 0."""
        return self.times is not None or (self.frame == "tip" and self.acts)

    @property
    def constant(self) -> Array:
        """Force and moment, shape (6,), in frame 0.

        Raises
        ------
        SceneError
            They are not constant there; the message names the key path of a scene.
        """
        if self.varies:
            cause = "frame = 'tip'" if self.frame == "tip" else f"times = {truncated(self.times)}"
            raise SceneError(
                f"wrench.{cause}: is not constant in frame 0; Trajectory.tip_wrench holds it at the samples",
                id="load-not-constant",
            )
        return np.array([*self.force, *self.moment])

    @property
    def acts(self) -> bool:
        """Whether anything pulls or turns at any time."""
        return any(self.force) or any(self.moment) or any(map(any, (*(self.forces or ()), *(self.moments or ()))))


def check_table(
    times: tuple[float, ...] | None, tables: Mapping[str, Sequence[object] | None], *, smooth: bool, hold: bool
) -> None:
    """Check that times increase, each with a row of every table by name, and how the rows are joined.

    Raises
    ------
    SceneError
        The message names the row.
    """
    if times is not None:
        require_increasing("times", times)
    if smooth and len(times or ()) < 2:
        raise SceneError(f"smooth = {smooth}: needs a table with at least 2 times", id="needs-another-key")
    if hold and (smooth or times is None):
        raise SceneError(f"hold = {hold}: needs a table with smooth = False", id="needs-another-key")
    for name, rows in tables.items():
        if times is not None and rows is not None and len(rows) != len(times):
            raise SceneError(f"{name} has {len(rows)} rows: expected one per time, {len(times)}", id="one-per-time")
