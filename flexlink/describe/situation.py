"""What is done to an arm: initial state, drive, prescribed motion, wrench at the tip, and how to integrate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from flexlink.common.errors import SceneError
from flexlink.describe import catalogue
from flexlink.describe.spec import NonNegative, Positive, Spec, Vector3, short

Array = NDArray[np.float64]
AUTO = "auto"  # in place of a method's name
Dynamics = Literal["articulated", "lu", "cholesky"]
"""Solvers of forward dynamics."""
Unstable = Literal["refuse", "allow"]
"""What becomes of a run that is not stable."""
Accuracy = Literal["tip", "deflection"]
"""What a relative tolerance is a part of."""


class Initial(Spec, frozen=True):
    """State at the start: one joint angle [deg] and rate [deg/s] per link; a locked joint stays at its angle.

    passive = "zero": springs slack.  "static": hinges bent as gravity and tip wrench bend them with the joints held.
    `q` [rad] and `qd` [rad/s], one number per joint of the chain in sequential order, take the place of all that, as
    `time` [s] does of t = 0: the state from which another run is continued.
    """

    joint_deg: tuple[float, ...]
    rate_deg: tuple[float, ...] | None = None  # default: at rest
    passive: Literal["zero", "static"] = "zero"
    q: tuple[float, ...] | None = None  # rad
    qd: tuple[float, ...] | None = None  # rad/s
    time: NonNegative = 0.0  # s

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.q is not None and self.passive == "static":
            raise SceneError(f"q = {short(self.q)}: passive = 'static' seeks the hinges' angles; give one of both")
        if self.qd is not None and self.rate_deg is not None:
            raise SceneError(f"qd = {short(self.qd)}: rate_deg is given, too; give one of both")

    @property
    def rates(self) -> tuple[float, ...]:
        """Rate of every joint [deg/s]; zero unless given."""
        return self.rate_deg or (0.0,) * len(self.joint_deg)


class Drive(Spec, frozen=True):
    """Drive torque T_EX at the active joints, one column per link [N m, N m/rad, N m s/rad, deg].

    constant: T_EX = torque.  table: `torques`, one row per time, held outside, in between linear or, if `smooth`, a
    cubic spline, which keeps the order of the integrator; or, if `hold`, each row held until the next time, as a
    sampled controller holds it.
    pd: T_EX = kp (target − q) − kd q̇.
    """

    kind: Literal["none", "constant", "table", "pd"] = "none"
    torque: tuple[float, ...] | None = None
    times: tuple[float, ...] | None = None  # s
    torques: tuple[tuple[float, ...], ...] | None = None
    kp: tuple[NonNegative, ...] | None = None
    kd: tuple[NonNegative, ...] | None = None
    target_deg: tuple[float, ...] | None = None
    smooth: bool = False
    hold: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        wanted = {
            "none": (), "constant": ("torque",), "table": ("times", "torques"), "pd": ("kp", "kd", "target_deg"),
        }[self.kind]  # fmt: skip
        for name in ("torque", "times", "torques", "kp", "kd", "target_deg"):
            if (getattr(self, name) is not None) != (name in wanted):
                takes, value = ", ".join(wanted) or "nothing else", getattr(self, name)
                said = ": missing;" if value is None else f" = {short(value)}:"
                raise SceneError(f"{name}{said} drive kind {self.kind!r} takes {takes}")
        if self.times is not None and (not self.times or np.any(np.diff(self.times) <= 0)):
            raise SceneError(f"times = {short(self.times)}: must increase")
        if self.smooth and len(self.times or ()) < 2:
            raise SceneError(f"smooth = {self.smooth}: needs a table with at least 2 times")
        if self.hold and (self.smooth or self.times is None):
            raise SceneError(f"hold = {self.hold}: takes a table that is not smooth")
        if self.times is not None and self.torques is not None and len(self.torques) != len(self.times):
            raise SceneError(f"torques has {len(self.torques)} rows: expected one per time, {len(self.times)}")


class Motion(Spec, frozen=True):
    """Prescribed motion of a link's active joint: its torque becomes an output.

    Angle [deg], rate [deg/s] and acceleration [deg/s²] at `times` [s], which start at 0; quintic polynomials in
    between, then on at the last rate.
    """

    link: str | int  # name, or number from 1
    times: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)]  # s
    angle_deg: tuple[float, ...]
    rate_deg: tuple[float, ...]
    acceleration_deg: tuple[float, ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.times[0] != 0 or np.any(np.diff(self.times) <= 0):
            raise SceneError(f"times = {short(self.times)}: must start at 0 and increase")
        for name in ("angle_deg", "rate_deg", "acceleration_deg"):
            if len(getattr(self, name)) != len(self.times):
                raise SceneError(
                    f"{name} has {len(getattr(self, name))} values: expected one per time, {len(self.times)}"
                )


class Wrench(Spec, frozen=True):
    """Constant force [N] and moment [N m] on the tip, in frame 0, acting at the tip frame's origin."""

    force: Vector3 = (0.0, 0.0, 0.0)
    moment: Vector3 = (0.0, 0.0, 0.0)


class Run(Spec, frozen=True):
    """How to integrate: method, steps, duration, time between stored samples [s], solver of forward dynamics.

    Steps are fixed, of length `step`, or follow from the error that is allowed at the end of the run: `tolerance` [m]
    of any body's place, or `relative_tolerance`, a part of the arm's reach (accuracy = "tip") or of its largest
    deflection so far (accuracy = "deflection"); `step` then has no effect. method = "auto", the default then, takes the
    cheapest method. Vibrations too small to matter for the tip's path may be damped away by accuracy = "tip".

    `unstable` = "allow" insists on a step beyond the largest stable one, and on a run whose energy does not balance.
    """

    method: str = ""  # default: RK4, or, with a tolerance, auto
    step: Positive = 1e-4  # s
    duration: NonNegative = 5.0  # s
    sample: Positive = 0.005  # s
    dynamics: Dynamics = "articulated"
    unstable: Unstable = "refuse"
    tolerance: Positive | None = None  # m
    relative_tolerance: Positive | None = None
    accuracy: Accuracy = "tip"

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.method:
            msgspec.structs.force_setattr(self, "method", "auto" if self.controlled else "RK4")
        msgspec.structs.force_setattr(self, "method", catalogue.absolute(self.method))
        if self.controlled:
            self._check_tolerance()
        else:
            whole("sample", self.sample, "step", self.step)
        whole("duration", self.duration, "sample", self.sample)

    def _check_tolerance(self) -> None:
        if self.tolerance is not None and self.relative_tolerance is not None:
            raise SceneError(
                f"relative_tolerance = {self.relative_tolerance!r}: tolerance = {self.tolerance!r} is given, too"
            )
        if self.accuracy == "deflection" and self.relative_tolerance is None:
            raise SceneError("accuracy = 'deflection': takes relative_tolerance, a part of the deflection")

    @property
    def controlled(self) -> bool:
        """Whether steps follow from a tolerance."""
        return self.tolerance is not None or self.relative_tolerance is not None

    def tolerance_within(self, reach: float) -> float:
        """The tolerance of an arm of this reach [m]."""
        return self.tolerance or (self.relative_tolerance or 0.0) * reach

    @property
    def steps_per_sample(self) -> int:
        """Number of fixed steps between two stored samples."""
        return round(self.sample / self.step)

    @property
    def samples(self) -> int:
        """Number of stored samples, the initial one included."""
        return round(self.duration / self.sample) + 1

    @property
    def times(self) -> Array:
        """Times of the stored samples [s] of a run that starts at t = 0, shape (samples,)."""
        return self.times_from(0.0)

    def times_from(self, start: float) -> Array:
        """Times of the stored samples [s]: whole multiples of the time between them, if the start is one."""
        between = self.sample if self.controlled else self.steps_per_sample * self.step
        first = start / between
        if abs(first - round(first)) <= 1e-9 * max(1.0, first):
            first = round(first)
        return (first + np.arange(self.samples, dtype=np.float64)) * between


def whole(name: str, value: float, unit_name: str, unit: float) -> None:
    """Check that `value` is a whole number of `unit`s, up to the rounding of decimal input.

    Raises
    ------
    SceneError
        It is not, or the number is beyond the integers of float64.
    """
    ratio = value / unit
    if not ratio < 2**53:
        raise SceneError(f"{name} = {value!r}: more than 2**53 times {unit_name} = {unit!r}")
    if abs(ratio - round(ratio)) > 1e-9 * max(1.0, ratio) or (value > 0 and round(ratio) == 0):
        raise SceneError(f"{name} = {value!r}: must be a multiple of {unit_name} = {unit!r}")


def implied(run: Run, changes: Mapping[str, object]) -> dict[str, None]:
    """Settings of a run that changes by path leave out: a tolerance takes the place of fixed steps, and reversely.

    Raises
    ------
    SceneError
        Both are given.
    """
    said = {path for path, value in changes.items() if value is not None}
    tolerances, step = said & {"run.tolerance", "run.relative_tolerance"}, "run.step" in said
    if tolerances and step:
        raise SceneError(f"run.step = {short(changes['run.step'])}: {min(tolerances)} is given, too")
    gone: list[str] = []
    if tolerances or step:
        gone += ["run.tolerance", "run.relative_tolerance"]
    if step:
        gone += ["run.accuracy"]
    if (tolerances and not run.controlled) or (step and run.method == AUTO):
        gone += ["run.method"]
    return dict.fromkeys(gone)
