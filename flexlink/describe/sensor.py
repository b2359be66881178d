"""What is measured on an arm: sensors, where they sit, and what each makes of what it sees."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal, NamedTuple

import msgspec

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.wording import truncated
from flexlink.data.csv_table import conversion
from flexlink.describe.arm import BASE, Arm
from flexlink.describe.directions import unit
from flexlink.describe.link import Link
from flexlink.describe.own_units import OF_JOINT
from flexlink.describe.rigidity import Rigidity
from flexlink.describe.spec import LARGE, SMALL, Deviation, NonNegative, Positive, Spec, Vector3, link_key, measured_in

Kind = Literal["strain", "accelerometer", "gyroscope", "joint", "torque", "current", "position"]
"""What a sensor measures."""


class KindOfSensor(NamedTuple):
    """What a kind needs, what it may have besides, and the unit of what it sees; "": by the joint."""

    needs: tuple[str, ...]
    may: tuple[str, ...]
    unit: str


KINDS: dict[str, KindOfSensor] = {
    "strain": KindOfSensor(("x", "fibre"), (), "1"),
    "accelerometer": KindOfSensor((), ("x", "point", "axis"), "m/s²"),
    "gyroscope": KindOfSensor((), ("x", "point", "axis"), "rad/s"),
    "position": KindOfSensor((), ("x", "point", "axis"), "m"),
    "joint": KindOfSensor((), (), ""),
    "torque": KindOfSensor((), (), ""),
    "current": KindOfSensor(("torque_constant",), (), "A"),
}
ON_A_BASE = ("accelerometer", "gyroscope", "position")
"""Kinds that a free base can carry."""
OF_THE_DRIVE = ("joint", "torque", "current")
"""Kinds that sit at a link's joint."""


class Sensor(Spec, frozen=True):
    """A sensor on the arm, and its instrument; a column of a run under its name, "root strain [1]".

    strain: a gauge along the beam of a link that bends, `x` from the beam's root, at the `fibre` (y, z) of the section:
    ε = z κ_y − y κ_z, of bending, as `beam_strain` says, the curvature at `x` by the cubic through the four hinges
    nearest to it; on a beam whose EI is a table, M/EI there, M by that cubic.
    accelerometer, gyroscope: Rᵀ(a − g) and Rᵀω of a point of a link, in the link's axes as its segment there carries
    them.  position: of such a point in frame 0.  Either way along `axis`, or three columns, "NAME x [m]" and so on.
    joint: the angle of the link's joint, or how far it has slid; with an elastic gear the motor's.  torque: T_EX of its
    drive, or what its prescribed motion takes.  current: T_EX / `torque_constant`.

    The instrument makes of that signal u, in this order: gain · u(t − delay) + bias, by a Butterworth `low_pass`;
    asked at instants k / `rate` and held; to it noise is added; rounded to multiples of `resolution`.

    Examples
    --------
    >>> gauge = fl.Sensor(name="root", kind="strain", link="upper", x=0.05, fibre=(0.025, 0.0), gain=1e6, unit="µm/m")
    >>> encoder = fl.Sensor(name="encoder", kind="joint", link="upper", resolution=1e-4, rate=100.0)  # rad; Hz
    >>> imu = fl.Sensor(name="imu", kind="accelerometer", link="fore", axis=(0.0, 1.0, 0.0), noise=0.02, seed=1)  # m/s²
    >>> seen = fl.simulate(scene.varied({"sensor": (gauge, encoder, imu)}))
    >>> print(list(seen.columns)[-3:])
    ['root [µm/m]', 'encoder [rad]', 'imu [m/s²]']
    """

    name: str
    """Name of the sensor, and of its columns; its unit stands behind it in brackets."""
    kind: Kind
    """What it measures: strain, acceleration against gravity, angular velocity, a place, the angle of a joint, the
    torque of its drive, or the current of its motor."""
    link: str | int
    """Link that it sits on, by name or number from 1, or "base" if that floats; of joint, torque and current the link
    whose joint is meant."""
    x: Annotated[NonNegative | None, measured_in("m")] = None
    """Where it sits along the beam of the link, from the beam's root [m]. Default: the end of the link."""
    point: Annotated[Vector3 | None, measured_in("m")] = None
    """The same by a point of the straight link, in the link's frame [m]; the segment beside it carries the sensor."""
    fibre: Annotated[tuple[float, float] | None, measured_in("m")] = None
    """Of strain: place (y, z) of the gauge in the section, from the line through its centroid [m]."""
    axis: Vector3 | None = None
    """Direction that is measured, in axes of the link, of a position in those of frame 0; its length does not matter.
    Default: all three, a column each."""
    torque_constant: Positive | None = None
    """Of current: torque at the joint per current, gear ratio included [N m/A]; of a prismatic joint [N/A]."""
    gain: Annotated[float, msgspec.Meta(ge=-LARGE, le=LARGE)] = 1.0
    """What one unit of the signal, in SI units and radians, is in the column [its unit per SI unit]."""
    unit: str | None = None
    """Unit of the column, to which the gain leads. Default: the signal's own: 1, m/s², rad/s, rad or m, N m or N, A."""
    bias: Annotated[float, msgspec.Meta(ge=-LARGE, le=LARGE)] = 0.0
    """What it shows where there is nothing [unit of the column]."""
    delay: Annotated[NonNegative, measured_in("s")] = 0.0
    """How much later the signal is seen [s]; before the start it was as at the start."""
    low_pass: Annotated[Positive | None, measured_in("Hz")] = None
    """Frequency at which a Butterworth low-pass lets 71 % of the amplitude through [Hz]; it starts settled. Default:
    none."""
    order: Annotated[int, msgspec.Meta(ge=1, le=8)] | None = None
    """Order of the low-pass. Default: 1."""
    rate: Annotated[Positive | None, measured_in("Hz")] = None
    """How often it is asked [Hz], at t = k / rate; in between the reading is held. Default: at every sample."""
    resolution: Deviation | None = None
    """Step between two readings, which are its multiples [unit of the column]. Default: none."""
    noise: Annotated[float, msgspec.Meta(ge=0, le=LARGE)] = 0.0
    """Standard deviation of the readings' white, normal noise [unit of the column]; without a rate every `run.sample`
    has a number of its own."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] | None = None
    """Which noise: a sensor of this name has the same in every run of the same seed. Default: 0."""

    def __post_init__(self) -> None:
        of_kinds = ("x", "point", "fibre", "axis", "torque_constant")
        super().__post_init__()
        self._check_name()
        needs, may, _ = KINDS[self.kind]
        for key in of_kinds:
            value = getattr(self, key)
            if value is None and key in needs:
                raise SceneError(f"{key}: missing; kind {self.kind!r} needs it", id="missing-key")
            if value is not None and key not in (*needs, *may):
                takes = ", ".join((*needs, *may)) or "none of " + ", ".join(of_kinds)
                raise SceneError(
                    f"{key} = {truncated(value)}: kind {self.kind!r} takes {takes}", id="key-of-another-kind"
                )
        if self.x is not None and self.point is not None:
            raise SceneError(
                f"point = {truncated(self.point)}: x = {self.x!r} is given, too; give only one", id="both-given"
            )
        if self.axis is not None:
            unit("axis", self.axis)
        if self.gain == 0:
            raise SceneError("gain = 0.0: must not be 0; nothing would be measured", id="zero-gain")
        if 0 < self.noise < SMALL:
            raise SceneError(f"noise = {self.noise!r}: must be 0, or at least {SMALL:g}", id="noise-too-small")
        self._check_unit()
        for key, of in (("order", "low_pass"), ("seed", "noise")):
            if getattr(self, key) is not None and not getattr(self, of):
                raise SceneError(
                    f"{key} = {getattr(self, key)!r}: has no effect without {of}; leave {key} out",
                    id="needs-another-key",
                )

    def _check_name(self) -> None:
        """Columns are told apart, and from others, by it."""
        # names of other columns of a run; those that begin with "q ", "qd " and "tau " are taken, too
        taken = (
            "t", "tip", "kinetic", "gravity", "elastic", "work", "imbalance", "attitude", "spin", "momentum",
            "angular momentum", "deflection",
        )  # fmt: skip
        for key, text in (("name", self.name), ("unit", self.unit)):
            if text is not None and (not text or text != text.strip() or re.search(r"[\[\]\n\r\t]", text)):
                raise SceneError(
                    f"{key} = {text!r}: expected a text without brackets, and without spaces at its ends",
                    id="sensor-name",
                )
        if self.name in taken or re.match(r"(q|qd|tau) ", self.name):
            raise SceneError(
                f"name = {self.name!r}: columns of a run are called so; give another name", id="sensor-name"
            )

    def _check_unit(self) -> None:
        """A column in a unit of what is measured, such as deg, has a gain; of others, such as V, it may be 1."""
        # sizes of units of instruments in units of what they measure, besides those of angles, lengths, forces and
        # torques
        instruments = {
            ("µm/m", "1"): 1e-6, ("um/m", "1"): 1e-6, ("µε", "1"): 1e-6, ("ppm", "1"): 1e-6, ("%", "1"): 1e-2,
            ("g", "m/s²"): 9.80665, ("mA", "A"): 1e-3,
        }  # fmt: skip
        for unit_ in map(self._own_unit, OF_JOINT) if self.unit is not None and self.gain == 1 else ():
            size = instruments.get((self.unit or "", unit_)) or conversion(self.unit or "", unit_)
            if size is not None and size != 1:
                raise SceneError(
                    f"unit = {self.unit!r}: the column would be in {unit_}; give gain = {1 / size:.10g}, {self.unit} "
                    f"per {unit_}, or leave unit out",
                    id="unit-missing",
                )

    @property
    def sees_points(self) -> bool:
        """Whether it measures how a point of the arm moves."""
        return self.kind in ON_A_BASE

    @property
    def components(self) -> tuple[str, ...]:
        """What stands behind its name for each of its columns: " x", " y", " z", or nothing for the only one."""
        return ("",) if not self.sees_points or self.axis is not None else (" x", " y", " z")

    def columns(self, slides: bool = False) -> tuple[str, ...]:
        """Names of its columns, with unit; at a joint that `slides` or turns."""
        return tuple(f"{self.name}{part} [{self.unit or self._own_unit(slides)}]" for part in self.components)

    def _own_unit(self, slides: bool) -> str:
        """Of what it sees, in SI, at a joint that `slides` or turns."""
        of_joint = OF_JOINT[slides]
        return KINDS[self.kind].unit or (of_joint.si if self.kind == "joint" else of_joint.torque)


def column_names(sensors: Sequence[Sensor], arm: Arm) -> tuple[str, ...]:
    """Names with units of the columns of sensors on an arm, in their order."""
    own = [sensor.kind in OF_THE_DRIVE and arm.slides[arm.number(sensor.link) - 1] for sensor in sensors]
    return tuple(name for sensor, slides in zip(sensors, own, strict=True) for name in sensor.columns(slides))


def sensor_mistakes(sensors: Sequence[Sensor], arm: Arm) -> Iterator[str]:
    """What does not fit the arm, or two sensors of one name."""
    names = [sensor.name for sensor in sensors]
    for k, sensor in enumerate(sensors):
        path = f"sensor.{link_key(names, k)}"
        if names.index(sensor.name) < k:
            yield f"{path}.name = {sensor.name!r}: names of sensors must differ"
        yield from (f"{path}.{wrong}" for wrong in _misfits(sensor, arm))


def _misfits(sensor: Sensor, arm: Arm) -> Iterator[str]:
    kind, said = sensor.kind, f"link = {truncated(sensor.link)}"
    if is_on_base(sensor, arm):
        if not arm.base.free:
            yield f"{said}: the base is fixed, and nothing moves there; name a link"
        if kind not in ON_A_BASE:
            yield f"{said}: a {kind} sensor sits on a link; the base carries {', '.join(ON_A_BASE)}"
        if sensor.x is not None:
            yield f"x = {sensor.x!r}: the base has no beam; give a point, or nothing for the origin of its frame"
        return
    try:
        link = arm.links[arm.number(sensor.link) - 1]
    except ArgumentError as error:
        yield str(error)
        return
    if kind in OF_THE_DRIVE and link.joint.locked:
        yield f"{said}: its joint is locked; a {kind} sensor needs one that moves"
    if kind == "strain" and link.flex not in {"z", "yz", "xyz"}:
        yield f"{said}: is rigid; a strain gauge needs a link that bends, with flex of z, yz or xyz"
    if sensor.x is not None and sensor.x > link.beam.length:
        yield f"x = {sensor.x!r}: beyond the beam of link {link.name!r}, which is {link.beam.length:g} m long"
    elif kind == "strain" and link.rigidity in arm.rigidities and sensor.x is not None:
        yield from _on_a_jump(sensor.x, link, arm.rigidities[link.rigidity or ""])


def _on_a_jump(x: float, link: Link, table: Rigidity) -> Iterator[str]:
    """A gauge where EI jumps would show one strain or the other."""
    jump, aside = table.jump_at(x, link.flex), 1e-3 * link.beam.length
    if jump is not None:
        yield (
            f"x = {x!r}: EI of link {link.name!r} jumps there, and with it the strain; say on which side the gauge is, "
            f"such as x = {jump - aside:.6g} or {jump + aside:.6g}"
        )


def is_on_base(sensor: Sensor, arm: Arm) -> bool:
    """Whether a sensor sits on the base, not on a link that is called so."""
    return sensor.link == BASE and BASE not in {link.name for link in arm.links}
