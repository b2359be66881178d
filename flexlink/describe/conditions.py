"""What is done to an arm: initial state, drive, prescribed motion, wrench at the tip, and how to integrate."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np

from flexlink.common.errors import ArgumentError, DataFileError, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.describe import data_files
from flexlink.describe.own_units import TWINS, Row, Slides, together
from flexlink.describe.reference import Reference
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import (
    ONE_PER_LINK,
    NonNegative,
    PerLink,
    Positive,
    PositivePerLink,
    Spec,
    Vector3,
    require_increasing,
    truncated,
)

AUTO = "auto"  # in place of a method's name
DEFAULT_TOLERANCE = 1e-3
"""Part of the arm's reach that any body may be off by at the end of a run that says nothing of its steps."""
DEFAULT_STEP = 1e-4
"""Length of the fixed steps of a run that names a method alone [s]."""
DEFAULT_DURATION = 5.0  # s
OF_MOTION = "angle_deg", "rate_deg", "acceleration_deg"
IN_METRES_OF_MOTION = "position_m", "rate_m", "acceleration_m"
SAMPLE = 0.005
"""Time between stored samples where it fits the run [s]."""
Frame = Literal["world", "tip"]
"""Axes that a tip wrench is given in: of frame 0, or of the tip frame, with which it turns."""
ForwardSolver = Literal["articulated", "lu", "cholesky"]
"""Solvers of forward dynamics."""
Unstable = Literal["refuse", "allow"]
"""What becomes of a run that is not stable."""
Accuracy = Literal["tip", "deflection"]
"""What a relative tolerance is a part of."""


class BaseState(Spec, frozen=True):
    """Where a free base starts: its frame in frame 0, and how it moves.

    Examples
    --------
    >>> tumbling = fl.BaseState(rpy_deg=(0.0, 0.0, 30.0), velocity=(0.1, 0.0, 0.0), spin_deg=(0.0, 0.0, 5.0))
    >>> print(tumbling.rates.round(4))  # rad/s, in axes of the base
    [0.     0.     0.0873]
    """

    xyz: Vector3 = (0.0, 0.0, 0.0)
    """Place of its frame [m]."""
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about fixed axes [deg]: R = Rz(yaw) Ry(pitch) Rx(roll); multiples of 90° are exact."""
    quaternion: tuple[float, float, float, float] | None = None
    """Its attitude as w, x, y, z in place of `rpy_deg` [1]; its length does not matter."""
    velocity: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of its frame's origin, in frame 0 [m/s]."""
    spin_deg: Vector3 = (0.0, 0.0, 0.0)
    """Angular velocity, in axes of the base [deg/s]."""
    spin: Vector3 | None = None
    """The same [rad/s], in place of `spin_deg`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, other in (("quaternion", "rpy_deg"), ("spin", "spin_deg")):
            if getattr(self, name) is not None and any(getattr(self, other)):
                raise SceneError(f"{name} = {truncated(getattr(self, name))}: {other} is given, too; give only one")
        if self.quaternion is not None and not any(self.quaternion):
            raise SceneError("quaternion = (0.0, 0.0, 0.0, 0.0): has no direction; [1, 0, 0, 0] is no turn")

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

    joint_deg: PerLink = ()
    """Angle of each joint, one per link [deg]; a locked joint stays there. Default: zero."""
    rate_deg: PerLink | None = None
    """Rate of each joint, one per link [deg/s]. Default: at rest."""
    joint_m: PerLink | None = None
    """Position of each prismatic joint, one number per link, 0 for the others [m]. Default: zero."""
    rate_m: PerLink | None = None
    """Rate of each prismatic joint, one number per link [m/s]. Default: at rest."""
    base: BaseState = BaseState()
    """Where a free base starts, and how it moves."""
    passive: Literal["zero", "static"] = "zero"
    """Hinges and elastic gears: springs slack (zero), or bent by gravity and tip wrench, joints held (static)."""
    q: tuple[float, ...] | None = None
    """Whole state instead: one angle per joint of the chain, in order [rad], of those that slide [m]."""
    qd: tuple[float, ...] | None = None
    """Whole state instead: one rate per joint of the chain, in order [rad/s], or [m/s]. Default: at rest."""
    time: NonNegative = 0.0
    """When the run starts [s]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.q is not None and self.passive == "static":
            raise SceneError("passive = 'static': computes the hinges' angles, but q is given, too; give only one")
        for name in ("rate_deg", "rate_m"):
            if self.qd is not None and getattr(self, name) is not None:
                raise SceneError(f"qd = {truncated(self.qd)}: {name} is given, too; give only one")

    def own(self, name: str, slides: Slides) -> Row:
        """A list of one number per link, "joint" or "rate", in the joints' own units; zero where nothing is said."""
        return together(slides, getattr(self, f"{name}_deg") or None, getattr(self, f"{name}_m"))

    @property
    def positions_m(self) -> tuple[float, ...]:
        """Position of every prismatic joint, one number per link [m]; zero unless given."""
        return self.joint_m or (0.0,) * len(self.joint_deg)


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
    times: tuple[float, ...] | None = None
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
    target_deg: PerLink | None = None
    """Of a law: where it leads the joints, one per link [deg]."""
    target_m: PerLink | None = None
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
    rate: Positive | None = None
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
                raise SceneError(f"{name}{state} drive kind {self.kind!r} takes {takes}")
        if self.file is None:
            check_table(self.times, {"torques": self.torques}, smooth=self.smooth, hold=self.hold)
        if self.gravity != "none" and self.kind != "pd":
            raise SceneError(f"gravity = {self.gravity!r}: needs drive kind 'pd'")
        if self.rate is not None and self.kind == "none":
            raise SceneError(f"rate = {self.rate!r}: has no effect with drive kind 'none'; leave rate out")


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
    times: tuple[float, ...] = ()
    """Times of the rows [s], from 0 on."""
    angle_deg: Row | None = None
    """Angle at each time [deg]."""
    rate_deg: Row | None = None
    """Rate at each time [deg/s]."""
    acceleration_deg: Row | None = None
    """Acceleration at each time [deg/s²]."""
    position_m: Row | None = None
    """Of a prismatic joint, in place of the angle: position at each time [m]."""
    rate_m: Row | None = None
    """Of a prismatic joint: rate at each time [m/s]."""
    acceleration_m: Row | None = None
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
            raise SceneError(f"cutoff = {self.cutoff!r}: has no effect without a file; leave cutoff out")
        if not self.times:
            raise SceneError("times: missing; give them with the angles, rates and accelerations there, or a file")
        if self.times[0] != 0:
            raise SceneError(f"times[0] = {self.times[0]!r}: must be 0")
        require_increasing("times", self.times)
        for name in self.keys:
            column = getattr(self, name)
            if column is None:
                raise SceneError(f"{name}: missing; this key is required")
            if len(column) != len(self.times):
                raise SceneError(f"{name} has {len(column)} values: expected one per time, {len(self.times)}")
            other = TWINS[name]
            if getattr(self, other) is not None:
                raise SceneError(f"{other} = {truncated(getattr(self, other))}: {name} is given, too; give only one")

    def _check_file(self) -> None:
        for name in ("times", *OF_MOTION, *IN_METRES_OF_MOTION):
            if getattr(self, name) not in (None, ()):
                raise SceneError(f"file = {self.file!r}: {name} is given, too; give only one")

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

    force: Vector3 = (0.0, 0.0, 0.0)
    """Constant force on the tip [N]."""
    moment: Vector3 = (0.0, 0.0, 0.0)
    """Constant moment on the tip [N m]."""
    frame: Frame = "world"
    """Axes of the components: of frame 0 (world), or of the tip, with which they turn."""
    on: str = ""
    """Name of the link at whose end it acts, one that no other hangs on. Default: the last."""
    times: tuple[float, ...] | None = None
    """Of a table: times of its rows [s]."""
    forces: tuple[Vector3, ...] | None = None
    """Of a table: a force per time [N]."""
    moments: tuple[Vector3, ...] | None = None
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
                    raise SceneError(f"file = {self.file!r}: {name} is given, too; give only one")
            return
        check_table(self.times, tables, smooth=self.smooth, hold=self.hold)
        if self.times is None:
            for name, rows in tables.items():
                if rows is not None:
                    raise SceneError(f"{name} = {truncated(rows)}: needs times, one per row")
            return
        if self.forces is None and self.moments is None:
            raise SceneError(f"times = {truncated(self.times)}: needs forces, moments or both, one row per time")
        for name in ("force", "moment"):
            if any(getattr(self, name)):
                raise SceneError(
                    f"{name} = {truncated(getattr(self, name))}: times are given, so give {name}s, one row per time"
                )

    @property
    def varies(self) -> bool:
        """Whether it may change in frame 0."""
        return self.times is not None or (self.frame == "tip" and self.acts)

    @property
    def acts(self) -> bool:
        """Whether anything pulls or turns at any time."""
        return any(self.force) or any(self.moment) or any(map(any, (*(self.forces or ()), *(self.moments or ()))))


class RunSettings(Spec, frozen=True):
    """How to integrate: method, steps, duration, time between stored samples [s], solver of forward dynamics.

    Steps are fixed, of length `step`, or follow from the error that is allowed at the end of the run: `tolerance` [m]
    of any body's place, or `relative_tolerance`, a part of the arm's reach (accuracy = "tip") or of how far all springs
    have moved any body so far, at most (accuracy = "deflection"); `step` then has no effect. method = "auto", the
    default then, takes the cheapest method. Vibrations too small to matter for the tip's path may be damped away by
    accuracy = "tip".

    Where nothing is said of method, step and tolerance, steps keep a tolerance of a thousandth of the reach. A method
    alone takes fixed steps of 1e-4 s.

    Such a run may take `max_evaluations` of forward or inverse dynamics: a hundred times what dry friction of the
    stiffest arms has taken, and half a minute of ten joints. One that would take more tells where it hangs, then stops.

    `unstable` = "allow" insists on a step beyond the largest stable one, and on a run whose energy does not balance.

    Examples
    --------
    >>> by_step = fl.RunSettings(method="RK4", step=1e-4, duration=2.0, sample=0.01)  # s
    >>> by_error = fl.RunSettings(method="auto", tolerance=1e-4, duration=2.0)  # m
    >>> print(fl.simulate(scene.varied({"run": by_error})).steps.method)
    Radau5
    """

    method: str = ""
    """Runge-Kutta method: a name, the path of a method's file, or auto, the cheapest for the tolerance. Default: auto;
    with a step RK4."""
    step: Positive | None = None
    """Length of fixed steps [s]. Default: steps follow from a tolerance; of a method that is named 1e-4."""
    duration: NonNegative = DEFAULT_DURATION
    """How long the run is [s]."""
    sample: Positive | None = None
    """Time between stored samples [s]. Default: 0.005, or what is nearest of the parts of the duration that are whole
    numbers of steps."""
    solver: ForwardSolver = "articulated"
    """Of forward dynamics: articulated bodies, or M by LU (the paper's way) or Cholesky."""
    unstable: Unstable = "refuse"
    """What becomes of a step beyond the largest stable one, and of a run whose energy does not balance."""
    tolerance: Positive | None = None
    """Largest error of any body's place at the end of the run [m]; steps follow from it."""
    relative_tolerance: Positive | None = None
    """The same as a part of the reach, or of the deflection (`accuracy`) [1]. Default: 1e-3, where neither method nor
    step are given."""
    accuracy: Accuracy = "tip"
    """What a relative tolerance is a part of: the arm's reach (tip), or how far springs have moved it."""
    max_evaluations: Positive = 1e7
    """Evaluations of dynamics after which a run with a tolerance stops as an error."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.method:
            fixed = self.step is not None and not self.has_tolerance
            msgspec.structs.force_setattr(self, "method", "RK4" if fixed else AUTO)
        msgspec.structs.force_setattr(self, "method", data_files.absolute(self.method))
        if self.controlled:
            self._check_tolerance()
        elif self.sample is None:
            whole(self._duration_said, self.duration, self.said("step"), self.fixed_step)
        else:
            whole("sample", self.sample, self.said("step"), self.fixed_step)
        whole(self._duration_said, self.duration, self.said("sample"), self.spacing)

    def _check_tolerance(self) -> None:
        if self.tolerance is not None and self.relative_tolerance is not None:
            raise SceneError(
                f"relative_tolerance = {self.relative_tolerance!r}: tolerance = {self.tolerance!r} is given, too; "
                "give only one"
            )
        if self.step is not None and self.has_tolerance:
            key = "tolerance" if self.tolerance is not None else "relative_tolerance"
            raise SceneError(f"step = {self.step!r}: {key} = {getattr(self, key)!r} is given, too; give only one")
        if self.accuracy == "deflection" and self.relative_tolerance is None:
            raise SceneError("accuracy = 'deflection': needs relative_tolerance, a fraction of the deflection")

    @property
    def has_tolerance(self) -> bool:
        """Whether a tolerance is given."""
        return self.tolerance is not None or self.relative_tolerance is not None

    @property
    def controlled(self) -> bool:
        """Whether steps follow from a tolerance."""
        return self.has_tolerance or self.method == AUTO

    @property
    def by_default(self) -> bool:
        """Whether steps follow from the tolerance that is taken where neither method, step nor tolerance are given."""
        return self.method == AUTO and not self.has_tolerance

    @property
    def in_words(self) -> str:
        """Method, step or tolerance, and duration, in one line."""
        steps = f"step {self.fixed_step:g} s"
        if self.tolerance is not None:
            steps = f"tolerance {self.tolerance:g} m"
        elif self.controlled:
            steps = f"tolerance {self.tolerance_within(1.0):g} of the {self.measure}"
        return f"{self.method}, {steps}, duration {self.duration:g} s"

    @property
    def measure(self) -> str:
        """What a relative tolerance is a part of."""
        return {"tip": "reach", "deflection": "deflection"}[self.accuracy]

    @property
    def _duration_said(self) -> str:
        """Its key, for messages."""
        return "duration" if self.duration != DEFAULT_DURATION else f"duration, by default {DEFAULT_DURATION},"

    def said(self, key: str, above: str = "") -> str:
        """A key of these settings, below another, for messages: of one that nobody wrote, that it is a default."""
        return f"{above}{key}" if getattr(self, key) is not None else f"the default {above}{key}"

    def tolerance_within(self, length: float) -> float:
        """The tolerance [m], a relative one of this length."""
        return self.tolerance or (self.relative_tolerance or DEFAULT_TOLERANCE) * length

    @property
    def fixed_step(self) -> float:
        """Length of fixed steps [s]."""
        return DEFAULT_STEP if self.step is None else self.step

    @property
    def spacing(self) -> float:
        """Time between two stored samples [s]."""
        if self.sample is not None:
            return self.sample
        return default_sample(self.duration, None if self.controlled else self.fixed_step)

    @property
    def steps_per_sample(self) -> int:
        """Number of fixed steps between two stored samples."""
        return round(self.spacing / self.fixed_step)

    @property
    def between(self) -> float:
        """Time between two stored samples [s]: of fixed steps what their number takes."""
        return self.spacing if self.controlled else self.steps_per_sample * self.fixed_step

    @property
    def samples(self) -> int:
        """Number of stored samples, the initial one included."""
        return round(self.duration / self.spacing) + 1

    @property
    def times(self) -> Array:
        """Times of the stored samples [s] of a run that starts at t = 0, shape (samples,)."""
        return self.times_from(0.0)

    def times_from(self, start: float) -> Array:
        """Times of the stored samples [s]: whole multiples of the time between them, if the start is one."""
        return multiples(start, self.between, self.samples)


@functools.lru_cache(maxsize=256)
def default_sample(duration: float, step: float | None) -> float:
    """Time between stored samples [s] where none is given: a part of the duration near 0.005 s, of whole steps."""
    if _fits(duration, SAMPLE) and (step is None or _fits(SAMPLE, step)):
        return SAMPLE
    if step is None:
        return duration / max(1, round(duration / SAMPLE))
    near, total, tries = max(1, round(min(SAMPLE / step, 2**53))), round(duration / step), 10_000
    fitting = (number for number in range(near, max(0, near - tries), -1) if total % number == 0)
    return next(fitting, total) * step


def _fits(long: float, unit: float) -> bool:
    return long == 0 or (0.5 < long / unit < 2**53 and is_whole(long / unit))


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
        raise SceneError(f"smooth = {smooth}: needs a table with at least 2 times")
    if hold and (smooth or times is None):
        raise SceneError(f"hold = {hold}: needs a table with smooth = False")
    for name, rows in tables.items():
        if times is not None and rows is not None and len(rows) != len(times):
            raise SceneError(f"{name} has {len(rows)} rows: expected one per time, {len(times)}")


def multiples(start: float, between: float, count: int) -> Array:
    """Times [s] from a start, so far apart: whole multiples of the time between them, if the start is one."""
    return (parts(start, between) + np.arange(count, dtype=np.float64)) * between


def parts(value: float, unit: float) -> float:
    """How many `unit`s a value is: a whole number, if it is one up to the rounding of decimal input."""
    ratio = value / unit
    return round(ratio) if is_whole(ratio) else ratio


def is_whole(ratio: float) -> bool:
    """Whether a ratio of two decimal numbers is a whole number, up to their rounding; 0 is."""
    return abs(ratio - round(ratio)) <= 1e-9 * max(1.0, ratio)


def whole(name: str, value: float, unit_name: str, unit: float, error: type[FlexlinkError] = SceneError) -> int:
    """How many `unit`s `value` is, which must be a whole number, up to the rounding of decimal input.

    Raises
    ------
    SceneError
        It is not, or the number is beyond the integers of float64; in its place `error`.
    """
    if not value / unit < 2**53:
        raise error(f"{name} = {value!r}: must be less than 2**53 times {unit_name} = {unit!r}")
    number = parts(value, unit)
    if number != round(number) or (value > 0 and number == 0):
        raise error(f"{name} = {value!r}: must be a multiple of {unit_name} = {unit!r}")
    return round(number)


def implied(run: RunSettings, changes: Mapping[str, object]) -> dict[str, None]:
    """Settings of a run that changes by path leave out: a tolerance takes the place of fixed steps, and reversely.

    Raises
    ------
    SceneError
        Both are given.
    """
    changed = {path for path, value in changes.items() if value is not None}
    tolerances, step = changed & {"run.tolerance", "run.relative_tolerance"}, "run.step" in changed
    if tolerances and step:
        raise SceneError(f"run.step = {truncated(changes['run.step'])}: {min(tolerances)} is given, too; give only one")
    gone: list[str] = []
    if tolerances or step:
        gone += ["run.tolerance", "run.relative_tolerance"]
    if tolerances:
        gone += ["run.step"]
    if step:
        gone += ["run.accuracy"]
    if (tolerances and not run.controlled) or (step and run.method == AUTO):
        gone += ["run.method"]
    return dict.fromkeys(gone)


def steps_explicitly(run: RunSettings) -> bool:
    """Whether a run takes fixed steps of an explicit method."""
    return not run.controlled and method(run.method).explicit


def check_method(run: RunSettings) -> None:
    """The method of a run is there, and it can do what the run asks of it.

    Raises
    ------
    SceneError
        The message names the key, the value and what is allowed.
    DataFileError
        The method's own file is not valid.
    """
    if run.method == AUTO:
        if run.by_default and run.step is not None:
            raise SceneError(
                f"run.method = {AUTO!r}: picks a method for a tolerance, but run.step = {run.step!r} is given; give "
                "run.tolerance, or a method, or leave run.step out"
            )
        return
    try:
        able = method(run.method).controlled or not run.controlled
    except (ArgumentError, DataFileError) as error:
        kind = DataFileError if isinstance(error, DataFileError) else SceneError
        raise kind(f"run.{error}") from None
    if not able:
        allowed = ", ".join([AUTO, *(name for name in data_files.names("methods") if method(name).controlled)])
        raise SceneError(
            f"run.method = {truncated(run.method)}: does not estimate its error; with a tolerance allowed are {allowed}"
        )
