"""Sensors on an arm: what they measure, where they are attached, and how they process the signal."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Annotated, Literal

import msgspec

from flexlink.common.errors import ArgumentError, Diagnostic, SceneError
from flexlink.common.wording import both_given, missing, truncated
from flexlink.data.csv_table import conversion
from flexlink.describe.arm import BASE, Arm
from flexlink.describe.directions import unit
from flexlink.describe.expected import kinds_of
from flexlink.describe.filters import MOST, Filter, Frequency
from flexlink.describe.joint_units import OF_JOINT
from flexlink.describe.link import Link
from flexlink.describe.spec import LARGE, SMALL, Deviation, NonNegative, Positive, Spec, Vector3, link_key, measured_in

Kind = Literal["strain", "accelerometer", "gyroscope", "joint", "torque", "current", "position", "force", "pressure"]
"""Measured quantity of a sensor."""
ON_A_BASE = ("accelerometer", "gyroscope", "position")  # kinds that may be attached to a base that floats
OF_THE_DRIVE = ("joint", "torque", "current")  # kinds that are attached to a link's joint


class Sensor(Spec, frozen=True):
    """A sensor on the arm with its signal processing; its readings are a column of a run, such as "root strain [1]".

    strain: a gauge on the beam of a flexible link, at `x` from the beam's root and at the `fibre` (y, z) of the
    section, measures the bending strain ε = z κ_y − y κ_z (see `beam_strain`). The curvature at `x` is interpolated by
    a cubic through the four nearest hinges; if EI is a table, it is M/EI, with M interpolated in this way.
    accelerometer, gyroscope: Rᵀ(a − g) and Rᵀω of a point of a link, in the link's axes, which move with the segment.
    position: position of such a point in frame 0. All three measure along `axis`, or else in three columns, "NAME x
    [m]" and so on.
    joint: angle or position of the link's joint; with an elastic gear, of the motor.  torque: T_EX of its drive, or the
    torque required by its motion, if that is given.  current: T_EX / `torque_constant`.
    force: force of a tie between points, > 0 where it pulls; its magnitude, if it acts in several directions.
    pressure: pressures of a cylinder on the bore side and the rod side, in two columns.

    The signal u is processed in this order: u(t − delay), `filter` or `low_pass`, times `gain`, plus `bias` and its
    random walk, sampling at times k / `rate` with hold, added noise, rounding to multiples of `resolution`.

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
    """Name of the sensor and of its columns, followed by the unit in brackets."""
    kind: Kind
    """Measured quantity: strain, acceleration minus gravity, angular velocity, position of a point, joint angle or
    position, drive torque, motor current, force or pressures of a tie."""
    link: str | int = ""
    """Link that carries the sensor, by name or number from 1, or "base" if the base floats; for joint, torque and
    current, the link whose joint is measured. None for force and pressure."""
    tie: str | None = None
    """For force and pressure: name of the tie."""
    x: Annotated[NonNegative | None, measured_in("m")] = None
    """Position along the link's beam, from the beam's root [m]. Default: the end of the link."""
    point: Annotated[Vector3 | None, measured_in("m")] = None
    """Point of the undeformed link, in the link's frame, instead of `x` [m]; the sensor is on the nearest segment."""
    fibre: Annotated[tuple[float, float] | None, measured_in("m")] = None
    """For strain: position (y, z) of the gauge in the section, relative to the centroid [m]."""
    axis: Vector3 | None = None
    """Measured direction, in axes of the link, or of frame 0 for a position; need not be normalized. Default: all
    three, one column each."""
    torque_constant: Positive | None = None
    """For current: joint torque per current, including the gear ratio [N m/A]; for a prismatic joint [N/A]."""
    gain: Annotated[float, msgspec.Meta(ge=-LARGE, le=LARGE)] = 1.0
    """Factor that converts the signal, in SI units and radians, to the column [unit of the column per SI unit]."""
    unit: str | None = None
    """Unit of the column, after the gain. Default: unit of the signal (1, m/s², rad/s, rad or m, N m or N, or A)."""
    bias: Annotated[float, msgspec.Meta(ge=-LARGE, le=LARGE)] = 0.0
    """Reading for a zero signal [unit of the column]."""
    bias_walk: Annotated[float, msgspec.Meta(ge=0, le=LARGE)] = 0.0
    """Random walk of the bias from t = 0: standard deviation `bias_walk` √t after a time t [unit of the column/√s]; it
    depends only on the seed, the sensor's name and the time."""
    delay: Annotated[NonNegative, measured_in("s")] = 0.0
    """Delay of the signal [s]; before the start of the run, the signal has its initial value."""
    filter: tuple[Filter, ...] = ()
    """Linear filters in series, which start in steady state. Default: no filter."""
    low_pass: Annotated[Frequency | None, measured_in("Hz")] = None
    """Frequency of a low-pass filter [Hz], short for a `filter` with this one, with `order` and `damping`."""
    order: Annotated[int, msgspec.Meta(ge=1, le=MOST)] | None = None
    """Order of the low-pass filter. Default: 2 with `damping`, otherwise 1."""
    damping: Deviation | None = None
    """Damping ratio of the low-pass filter, which is then of order 2 [1]. Default: a Butterworth filter."""
    rate: Annotated[Positive | None, measured_in("Hz")] = None
    """Sampling rate [Hz], at t = k / rate; readings stay constant in between. Default: every sample of the run."""
    resolution: Deviation | None = None
    """Quantization step of the readings [unit of the column]. Default: no quantization."""
    noise: Annotated[float, msgspec.Meta(ge=0, le=LARGE)] = 0.0
    """Standard deviation of white Gaussian noise on the readings [unit of the column]; without a rate, each stored
    sample of the run has an independent value."""
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] | None = None
    """Seed of the noise and of the bias walk, which depend only on the seed and the sensor's name. Default: 0."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_name()
        self._check_link()
        self._check_kind("sensor", self.kind)
        if self.x is not None and self.point is not None:
            raise both_given("point", self.point, f"x = {self.x!r}")
        if self.axis is not None:
            unit("axis", self.axis)
        if self.gain == 0:
            raise SceneError("gain = 0.0: must not be 0, which measures nothing", id="zero-gain")
        for key in ("noise", "bias_walk"):
            if 0 < getattr(self, key) < SMALL:
                raise self._refused(key, f"must be 0, or at least {SMALL:g}", "noise-too-small")
        self._check_unit()
        for key, of in (("order", ("low_pass",)), ("damping", ("low_pass",)), ("seed", ("noise", "bias_walk"))):
            if getattr(self, key) is not None and not any(getattr(self, each) for each in of):
                other = " or ".join(of)
                why = f"has no effect without {other}; give {other}, or leave {key} out"
                raise self._refused(key, why, "needs-another-key")
        if self.filter and self.low_pass is not None:
            raise both_given("low_pass", self.low_pass, "filter")
        if self.low_pass is not None:
            Filter(low_pass=self.low_pass, order=self.order, damping=self.damping)  # checks order and damping

    def _check_link(self) -> None:
        """Check that the sensor is on a link or on a tie."""
        if not self.link and not self.on_tie:
            raise missing("link", f"kind {self.kind!r} needs it")
        if self.link and self.on_tie:
            raise self._refused("link", f"kind {self.kind!r} takes tie", "key-of-another-kind")

    def _check_name(self) -> None:
        """Check that the name, which identifies columns, is valid and not used for another column of runs."""
        # other column names of a run; names that begin with "q ", "qd " and "tau " are also in use
        taken = (
            "t", "tip", "kinetic", "gravity", "elastic", "work", "imbalance", "attitude", "spin", "momentum",
            "angular momentum", "deflection",
        )  # fmt: skip
        for key, text in (("name", self.name), ("unit", self.unit)):
            if text is not None and (not text or text != text.strip() or re.search(r"[\[\]\n\r\t]", text)):
                why = "expected text without brackets, and without spaces at its ends"
                raise self._refused(key, why, "sensor-name")
        of_axes = r"(tip|(angular )?momentum|attitude|spin) [wxyz]$"
        if self.name in taken or re.match(f"(q|qd|tau) |{of_axes}", self.name):
            raise self._refused("name", "is the name of a column of every run; use another name", "sensor-name")

    def _check_unit(self) -> None:
        """Require a gain if the column's unit converts to the signal's unit, as deg does to rad, but V does not."""
        # conversion factors of instrument units, in addition to units of angle, length, force and torque
        instruments = {
            ("µm/m", "1"): 1e-6, ("um/m", "1"): 1e-6, ("µε", "1"): 1e-6, ("ppm", "1"): 1e-6, ("%", "1"): 1e-2,
            ("g", "m/s²"): 9.80665, ("mA", "A"): 1e-3,
        }  # fmt: skip
        for unit_ in map(self._own_unit, OF_JOINT) if self.unit is not None and self.gain == 1 else ():
            size = instruments.get((self.unit or "", unit_)) or conversion(self.unit or "", unit_)
            if size is not None and size != 1:
                gain = f"give gain = {1 / size:.10g} ({self.unit} per {unit_})"
                why = f"the column would be in {unit_}; {gain}, or leave unit out"
                raise self._refused("unit", why, "unit-missing")

    @property
    def filters(self) -> tuple[Filter, ...]:
        """Filters in series, whether given by `filter` or by `low_pass`."""
        if self.low_pass is None:
            return self.filter
        return (Filter(low_pass=self.low_pass, order=self.order, damping=self.damping),)

    @property
    def ideal(self) -> Sensor:
        """The sensor without noise, random walk and rounding: its readings depend smoothly on the run."""
        return msgspec.structs.replace(self, noise=0.0, bias_walk=0.0, seed=None, resolution=None)

    @property
    def sees_points(self) -> bool:
        """Whether the sensor measures the motion of a point."""
        return self.kind in ON_A_BASE

    @property
    def on_tie(self) -> bool:
        """Whether the sensor is on a tie, and not on a link."""
        return "tie" in kinds_of("sensor")[self.kind][0]

    @property
    def components(self) -> tuple[str, ...]:
        """Suffix of the sensor's name in each of its columns, such as " x", " y", " z", or "" for a single column."""
        if self.kind == "pressure":
            return " bore", " rod"
        return ("",) if not self.sees_points or self.axis is not None else (" x", " y", " z")

    def columns(self, slides: bool = False) -> tuple[str, ...]:
        """Names of the sensor's columns with units, for a joint that is prismatic (`slides`) or revolute."""
        return tuple(f"{self.name}{part} [{self.unit or self._own_unit(slides)}]" for part in self.components)

    def _own_unit(self, slides: bool) -> str:
        """SI unit of the sensor's signal, for a joint that is prismatic (`slides`) or revolute."""
        of_joint = OF_JOINT[slides]
        return kinds_of("sensor")[self.kind][2] or (of_joint.si if self.kind == "joint" else of_joint.torque)


def column_names(sensors: Sequence[Sensor], arm: Arm) -> tuple[str, ...]:
    """Names with units of all columns of the sensors, in order."""
    own = [sensor.kind in OF_THE_DRIVE and arm.slides[arm.number(sensor.link) - 1] for sensor in sensors]
    return tuple(name for sensor, slides in zip(sensors, own, strict=True) for name in sensor.columns(slides))


def sensor_mistakes(sensors: Sequence[Sensor], arm: Arm) -> Iterator[Diagnostic]:
    """Report sensors that cannot be used on this arm, and duplicate names; ties check their own sensors."""
    names = [sensor.name for sensor in sensors]
    for k, sensor in enumerate(sensors):
        path = f"sensor.{link_key(names, k)}"
        if names.index(sensor.name) < k:
            yield Diagnostic(f"{path}.name = {sensor.name!r}: names of sensors must differ", "name-twice")
        if not sensor.on_tie:
            yield from (Diagnostic(f"{path}.{wrong}", wrong.id) for wrong in _misfits(sensor, arm))


def _misfits(sensor: Sensor, arm: Arm) -> Iterator[Diagnostic]:
    """Mistakes of one sensor on an arm, in messages without the sensor's path."""
    kind, on = sensor.kind, f"link = {truncated(sensor.link)}"
    if is_on_base(sensor, arm):
        if not arm.base.free:
            yield Diagnostic(f"{on}: the base is fixed and does not move; name a link", "sensor-on-fixed-part")
        if kind not in ON_A_BASE:
            allowed = ", ".join(ON_A_BASE)
            yield Diagnostic(f"{on}: a {kind} sensor needs a link; allowed on the base are {allowed}", "sensor-on-base")
        if sensor.x is not None:
            reason = "the base has no beam; give a point, or leave both out for the origin of its frame"
            yield Diagnostic(f"x = {sensor.x!r}: {reason}", "sensor-on-base")
        return
    try:
        link = arm.links[arm.number(sensor.link) - 1]
    except ArgumentError as error:
        yield error.diagnostic
        return
    if kind in OF_THE_DRIVE and link.joint.locked:
        yield Diagnostic(f"{on}: its joint is locked; a {kind} sensor needs a free joint", "sensor-of-locked-joint")
    if kind == "strain" and link.flex not in {"z", "yz", "xyz"}:
        yield Diagnostic(f"{on}: is rigid; a strain gauge needs a link with flex of z, yz or xyz", "link-is-rigid")
    if beyond := beyond_beam(sensor.x, link):
        yield beyond
    elif kind == "strain" and link.rigidity in arm.rigidities and sensor.x is not None:
        table, aside = arm.rigidities[link.rigidity or ""], 1e-3 * link.beam.length
        unit = link.beam.length if table.relative else 1.0
        if (place := table.jump_at(sensor.x / unit, link.flex)) is not None:  # the strain is ambiguous there
            jump = place * unit
            remedy = f"move the gauge to one side, such as x = {jump - aside:.6g} or {jump + aside:.6g}"
            text = f"EI of link {link.name!r}, and so the strain, jumps there; {remedy}"
            yield Diagnostic(f"x = {sensor.x!r}: {text}", "gauge-on-jump")


def beyond_beam(x: float | None, link: Link) -> Diagnostic | None:
    """Mistake of a position beyond the end of a link's beam [m]."""
    if x is None or x <= link.beam.length:
        return None
    text = f"x = {x!r}: beyond the beam of link {link.name!r}, which is {link.beam.length:g} m long"
    return Diagnostic(text, "out-of-range")


def is_on_base(sensor: Sensor, arm: Arm) -> bool:
    """Whether a sensor is on the base, and not on a link named "base"."""
    return sensor.link == BASE and BASE not in {link.name for link in arm.links}
