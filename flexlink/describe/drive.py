"""Drives of the joints: torques, tables and controllers."""

from typing import Annotated, Literal

import msgspec

from flexlink.common.errors import SceneError
from flexlink.common.wording import both_given, missing
from flexlink.describe import spec
from flexlink.describe.expected import kinds_of
from flexlink.describe.filters import Filter
from flexlink.describe.numbers import check_table
from flexlink.describe.reference import Reference


class DriveFilter(Filter, frozen=True):
    """A filter of a drive's torque: a low-pass, a notch, or a transfer function (`Filter`), of one link or of all.

    Examples
    --------
    >>> notch = fl.details.DriveFilter(notch=42.0, damping=0.3, link="fore")  # Hz
    >>> noise = fl.details.DriveFilter(low_pass=300.0)
    """

    link: str = ""
    """Name of the link whose joint's torque is filtered. Default: all."""


class Drive(spec.Spec, frozen=True):
    """Drive torques T_EX at the active joints, one per link; at prismatic joints, forces [N].

    constant: T_EX = torque [N m].  table: `torques`, one row per time, constant before the first and after the last
    row. Between rows the torque is linear by default, a cubic spline with `smooth` (which preserves the integrator's
    order), or constant until the next time with `hold`. The rows may be in a CSV `file`.
    pd: T_EX = kp (r − q) + kd (ṙ − q̇) + g [N m/rad, N m s/rad], where r is `target_deg` or the time-varying
    `reference`. g depends on `gravity`: zero ("none"), or the torque that keeps the joints at r against gravity, for
    the rigid arm ("rigid") or the arm bent by gravity ("static"); or g is a table of `torques` at `times`.
    computed_torque: T_EX = M (r̈ + kd (ṙ − q̇) + kp (r − q)) + T_GC, with kp [1/s²] and kd [1/s]. The mass matrix
    M and the gravity and Coriolis torques T_GC are computed for the rigid arm, at q and q̇ of the driven joints.
    cascade: the controller of an industrial drive, sampled at `rate`. The position loop asks for the rate
    v = kp (r − q) + `rate_feedforward` ṙ, within ± `max_rate_deg`, with kp [1/s]; the rate loop gives
    T_EX = F(kd (v − q̇) + I + `inertia` r̈ + g), where I_k = I_k−1 + ki (v − q̇) / rate starts at zero, and F are the
    `filter`s. I keeps its value while the torque is at its limit and v − q̇ would increase it (anti-windup).
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

    kind: Literal["none", "constant", "table", "pd", "computed_torque", "cascade"] = "none"
    """Drive of the joints: none, a constant torque, a table over time, or a controller (pd, computed_torque,
    cascade)."""
    torque: spec.PerLink | None = None
    """For constant: torque on each joint, one per link [N m]; for a prismatic joint, the force [N]."""
    times: Annotated[tuple[float, ...] | None, spec.measured_in("s")] = None
    """For a table, or a feedforward table of pd or cascade: times of its rows [s]."""
    torques: tuple[spec.PerLink, ...] | None = None
    """For a table, or a feedforward table of pd or cascade: one row per time, with one torque per link [N m], or force
    [N]."""
    file: str | None = None
    """For a table, or a feedforward table of pd or cascade: a CSV file instead of `times` and `torques`, with headers
    "t [s]" and "tau NAME [N m]" for every driven joint. The path is relative to the scene's folder; the file is read
    once, with the scene."""
    kp: spec.NonNegativePerLink | None = None
    """For a controller: position gains, one per link [N m/rad; N/m]; for computed_torque [1/s²]; for
    cascade [1/s]."""
    kd: spec.NonNegativePerLink | None = None
    """For a controller: rate gains, one per link [N m s/rad; N s/m]; for computed_torque [1/s]."""
    target_deg: Annotated[spec.PerLink | None, spec.measured_in("deg")] = None
    """For a controller: target angles of the joints, one per link [deg]."""
    target_m: Annotated[spec.PerLink | None, spec.measured_in("m")] = None
    """For a controller: target positions of prismatic joints, one per link [m]."""
    reference: Reference | None = None
    """For a controller: time-varying target of the joints, instead of `target_deg`."""
    gravity: Literal["none", "rigid", "static"] = "none"
    """For pd and cascade: feedforward torque that holds the rigid arm (rigid) or the arm bent by gravity (static) at
    the target."""
    ki: spec.NonNegativePerLink | None = None
    """For cascade: gains of the integral of the rate error, one per link [N m/rad; N/m]. Default: zero."""
    rate_feedforward: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None
    """For cascade: part of the reference's rate that is added to the rate that the position loop asks for, 0 … 1 [1].
    Default: 1, so the joints do not lag behind the reference."""
    inertia: spec.NonNegativePerLink | None = None
    """For cascade: torque for each rad/s² of the reference's acceleration, one per link [kg m²; kg]. Default: zero."""
    max_rate_deg: Annotated[spec.NonNegativePerLink | None, spec.measured_in("deg/s")] = None
    """For cascade: limits of the rate that the position loop asks for, one per link [deg/s]; 0: no limit. Default: no
    limits."""
    max_rate_m: Annotated[spec.NonNegativePerLink | None, spec.measured_in("m/s")] = None
    """For cascade: the same for prismatic joints, one number per link [m/s]; 0: no limit. Default: no limits."""
    filter: tuple[DriveFilter, ...] = ()
    """For cascade: filters of the torques in series, which start in steady state; each filters the torque of its
    `link`, or of all. Between samples, they take their input as linear."""
    smooth: bool = False
    """For a table: interpolate by a cubic spline, which preserves the integrator's order. Default: linear."""
    hold: bool = False
    """For a table: keep the values of each row until the next time."""
    effort: spec.PositivePerLink | None = None
    """Torque limit of each drive, one per link [N m; N]. Default: no limit."""
    rate: Annotated[spec.Positive | None, spec.measured_in("Hz")] = None
    """Sampling rate of the controller [Hz]; its torques stay constant between samples. Default: the controller is
    evaluated at every stage of a step."""
    delay: Annotated[spec.NonNegative, spec.measured_in("s")] = 0.0
    """For a sampled controller: time from a sampling instant until its torques act (computation and transmission) [s];
    any time, also parts of a sampling period or several periods."""

    def __post_init__(self) -> None:
        super().__post_init__()
        in_deg = self.target_deg is not None or self.target_m is None
        towards = ("target_deg" if in_deg else "target_m") if self.reference is None else "reference"
        needs, also, _ = kinds_of("drive")[self.kind]
        wanted = ("file",) if self.kind == "table" and self.file else (*map({"target": towards}.get, needs, needs),)
        may = (*also, *("target_m",) * (towards == "target_deg" in wanted))
        for name in (
            "torque", "times", "torques", "file", "kp", "kd", "target_deg", "target_m", "reference",
            "rate", "ki", "rate_feedforward", "inertia", "max_rate_deg", "max_rate_m",
        ):  # fmt: skip
            self._check_key(name, wanted, may)
        if self.filter and self.kind != "cascade":
            raise SceneError("filter: needs drive kind 'cascade'", id="key-of-another-kind")
        if self.file is None:
            check_table(self.times, {"torques": self.torques}, smooth=self.smooth, hold=self.hold)
        if self.gravity != "none" and self.kind not in {"pd", "cascade"}:
            raise self._refused("gravity", "needs drive kind 'pd' or 'cascade'", "needs-pd")
        if self.kind in {"pd", "cascade"}:
            self._check_feedforward()
        if self.delay and self.rate is None:
            why = "needs rate, the sampling rate of the controller [Hz], such as rate = 1000"
            raise self._refused("delay", why, "needs-another-key")

    @property
    def controls(self) -> bool:
        """Whether the torques depend on the motion of the joints."""
        return self.kind in {"pd", "computed_torque", "cascade"}

    def _check_key(self, name: str, wanted: tuple[str, ...], may: tuple[str, ...]) -> None:
        """Check that a key is given if it is wanted, and only if it is wanted or allowed."""
        value = getattr(self, name)
        if (value is not None) == (name in wanted) or name in may:
            return
        if name.startswith("target_") and "reference" in wanted:
            raise both_given(name, value, "reference")
        forms = {"target_deg": "target_deg or reference (target_m for prismatic joints)", "rate": "rate [Hz]"}
        takes = ", ".join(forms.get(key, key) for key in wanted) or "nothing else"
        takes = f"drive kind {self.kind!r}{', the default,' * (self.kind == 'none')} takes {takes}"
        if value is None:
            raise missing(name, takes)
        known, aim = kinds_of("drive").items(), "target" if name in {"target_deg", "target_m", "reference"} else name
        of = ", ".join(repr(kind) for kind, keys in known if kind != self.kind and aim in (*keys[0], *keys[1]))
        raise self._refused(name, f"{takes}; leave {name} out, or choose its kind, {of}", "key-of-another-kind")

    def _check_feedforward(self) -> None:
        """Check the feedforward table of a pd or cascade drive."""
        given = [name for name in ("times", "torques", "file") if getattr(self, name) is not None]
        if self.file is None and len(given) == 1:
            raise missing("torques" if self.times is not None else "times", "a feedforward table has times and torques")
        if self.file is not None and len(given) > 1:
            raise both_given("file", self.file, given[0])
        if given and self.gravity != "none":
            raise both_given("gravity", self.gravity, given[0])
        if self.hold:
            raise SceneError("hold = True: needs drive kind 'table'", id="key-of-another-kind")
