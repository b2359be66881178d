"""Reference of a drive: desired angles over time, as a point-to-point move or a table, with optional input shaping."""

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, SceneError, errors_at
from flexlink.common.types import Array
from flexlink.common.wording import both_given, missing, truncated
from flexlink.describe import profiles
from flexlink.describe.expected import kinds_of
from flexlink.describe.joint_units import IN_METRES, OF_JOINT, OF_MOTION, Row, Slides, in_si, together
from flexlink.describe.numbers import check_table, require_positive
from flexlink.describe.reference_trajectory import ReferenceTrajectory, distinct, from_rest_to_rest, side_by_side, still
from flexlink.describe.shaping import InputShaper
from flexlink.describe.spec import NonNegative, NonNegativePerLink, PerLink, Positive, Spec, measured_in

LIMITS = ("max_rate_deg", "max_acceleration_deg", "max_jerk_deg")
TABLED = ("linear", "smooth", "hold")  # profiles given by tables
LISTS = ("to_deg", "from_deg", *LIMITS)


class Reference(Spec, frozen=True):
    """Desired angles of the driven joints over time, one column per link [deg, deg/s, deg/s², deg/s³].

    Positions of prismatic joints [m, m/s, m/s², m/s³] are given in corresponding lists: `to_m` for `to_deg` and so on,
    `position_m` for `angle_deg`. Each list has 0 for joints of the other kind; omit lists that no joint needs.

    A move (profile "quintic", "trapezoidal" in speed, or "s_curve" with limited jerk and up to 7 phases) leads from
    `from_deg`, by default `initial.joint_deg` of the scene, to `to_deg`, beginning at `start`. It lasts `duration`, or
    as long as the slowest joint needs within its limits, at least one of which is then reached. All joints start and
    end together: the fastest profile of each joint is stretched to the duration of the slowest. If `duration` is given,
    ramps speed up and brake for a third of it each; in an "s_curve", acceleration rises and falls for a third of each.

    A table has rows `angle_deg` at `times`, with profile "linear", "hold" (steps without a ramp) or "smooth". A smooth
    table is a cubic spline from rest to rest, or Hermite polynomials: cubic if it has `rate_deg`, quintic if it also
    has `acceleration_deg`. The first and last angles apply before and after the table. It may be in a CSV `file`.
    A constant target needs no reference: give `drive.target_deg`.

    A `shaper` sums delayed copies of the reference that leave no vibration at its frequencies; this lengthens the move.

    Examples
    --------
    >>> move = fl.Reference(profile="s_curve", to_deg=(60.0, -40.0), max_rate_deg=(90.0, 90.0), max_jerk_deg=(2e3, 2e3))
    >>> course = move.course((30.0, -60.0))  # from there
    >>> print(course.knots[-1].round(2))  # s
    0.78
    """

    profile: Literal["quintic", "trapezoidal", "s_curve", "linear", "smooth", "hold"]
    """A move (quintic, trapezoidal, s_curve) or a table (linear, smooth, hold)."""
    to_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """For a move: final angles, one per link [deg]."""
    to_m: Annotated[PerLink | None, measured_in("m")] = None
    """For a move: final positions, one per link [m]."""
    from_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """For a move: initial angles, one per link [deg]. Default: `initial.joint_deg`."""
    from_m: Annotated[PerLink | None, measured_in("m")] = None
    """For a move: initial positions, one per link [m]. Default: `initial.joint_m`."""
    start: Annotated[NonNegative, measured_in("s")] = 0.0
    """For a move: start time [s]."""
    duration: Annotated[Positive | None, measured_in("s")] = None
    """For a move: duration [s]. Default: the shortest within the limits."""
    max_rate_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s")] = None
    """For a move: largest rate of each joint [deg/s]."""
    max_rate_m: Annotated[NonNegativePerLink | None, measured_in("m/s")] = None
    """For a move: largest rate of each prismatic joint [m/s]."""
    max_acceleration_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s²")] = None
    """For a move: largest acceleration of each joint [deg/s²]."""
    max_acceleration_m: Annotated[NonNegativePerLink | None, measured_in("m/s²")] = None
    """For a move: largest acceleration of each prismatic joint [m/s²]."""
    max_jerk_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s³")] = None
    """For a move: largest jerk of each joint [deg/s³]."""
    max_jerk_m: Annotated[NonNegativePerLink | None, measured_in("m/s³")] = None
    """For a move: largest jerk of each prismatic joint [m/s³]."""
    times: Annotated[Row | None, measured_in("s")] = None
    """For a table: times of its rows [s]."""
    angle_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg")] = None
    """For a table: one row per time, with one angle per link [deg]."""
    rate_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg/s")] = None
    """For a smooth table: rates at its times [deg/s], for cubic Hermite interpolation."""
    acceleration_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg/s²")] = None
    """For a smooth table with rates: accelerations at its times [deg/s²], for quintic interpolation."""
    position_m: Annotated[tuple[PerLink, ...] | None, measured_in("m")] = None
    """For a table: one row per time, with one position per link [m]."""
    rate_m: Annotated[tuple[PerLink, ...] | None, measured_in("m/s")] = None
    """For a smooth table: rates of prismatic joints at its times [m/s]."""
    acceleration_m: Annotated[tuple[PerLink, ...] | None, measured_in("m/s²")] = None
    """For a smooth table with rates: accelerations of prismatic joints at its times [m/s²]."""
    file: str | None = None
    """For a table: a CSV file instead of its rows, with headers "t [s]" and "q NAME [deg]" for every driven joint, in
    any unit of angle or length; for a smooth table optionally "qd NAME [deg/s]" and "qdd NAME [deg/s²]". The path is
    relative to the scene's folder; the file is read once, with the scene."""
    cutoff: Annotated[Positive | Literal["auto"] | None, measured_in("Hz")] = None
    """For a smooth table's file: cutoff frequency (50 % amplitude) of a zero-phase low-pass filter of its angles [Hz];
    "auto": by cross-validation. Default: rates and accelerations come from the file's columns, or from a spline."""
    shaper: InputShaper | None = None
    """Input shaper, which sums delayed copies of the reference that leave no vibration."""
    follows: Literal["joints", "tip"] = "joints"
    """With drive kind pd: what follows the reference: the joints, or the tip, by torques computed before a run."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cutoff is not None and (self.file is None or self.profile != "smooth"):
            raise self._refused("cutoff", "needs a file and profile 'smooth'; leave cutoff out", "needs-another-key")
        if self.file is not None:
            if self.profile not in TABLED:
                why = f"{self._takes}; a file needs profile {', '.join(TABLED)}"
                raise self._refused("file", why, "key-of-another-kind")
            for key in sorted([*_in_both(*LISTS, *OF_MOTION), "times", "start", "duration"]):
                if getattr(self, key) not in (None, 0.0):
                    raise both_given("file", self.file, key)
            return
        known = kinds_of("reference")
        needs, may, _ = known[self.profile]
        for name in dict.fromkeys(name for each in known.values() for name in (*each[0], *each[1])):
            values = {key: getattr(self, key) for key in (name, IN_METRES.get(name, name))}
            if name in needs and all(value is None for value in values.values()):
                raise missing(name, self._takes)
            for key, value in values.items():
                if name not in (*needs, *may) and value not in (None, 0.0):
                    raise self._refused(key, self._takes, "key-of-another-kind")
        self._check_limits()
        if self.times is None:
            self._check_time_of_move()
            return
        if self._is_given("acceleration_deg") and not self._is_given("rate_deg"):
            raise missing("rate_deg", "acceleration_deg needs it")
        check_table(self.times, {name: getattr(self, name) for name in _in_both(*OF_MOTION)}, smooth=False, hold=False)

    @property
    def _takes(self) -> str:
        """The keys that the profile needs, and the keys that it may have, in words."""
        needs, may, _ = kinds_of("reference")[self.profile]
        also = f", and may have {', '.join(may)}" if may else ""
        return f"profile {self.profile!r} takes {', '.join(needs)}{also}"

    def _check_limits(self) -> None:
        """Check that limits are positive; zeros are allowed for joints whose limit is given in the other unit."""
        given = {key.endswith("_m") for key in _in_both(*LISTS, *OF_MOTION) if getattr(self, key) is not None}
        for key in () if len(given) == 2 else _in_both(*LIMITS):
            why = "; 0 is only for revolute joints with a limit in deg" if key.endswith("_m") else ""
            for k, limit in enumerate(getattr(self, key) or (), 1):
                require_positive(f"{key}.{k}", limit, why)

    def _check_time_of_move(self) -> None:
        limits, needed = [name for name in LIMITS if self._is_given(name)], self._deciding
        if self.duration is not None and limits:
            raise both_given("duration", self.duration, limits[0])
        if self.duration is None and not set(limits) & set(needed):
            named = needed if self.to_m is None or self.to_deg is not None else [IN_METRES[name] for name in needed]
            raise missing("duration", f"give duration, or {' or '.join(named)}")

    @property
    def _deciding(self) -> tuple[str, ...]:
        """Limits, at least one of which a move without `duration` needs; a trapezoid needs the acceleration limit."""
        return {"quintic": LIMITS, "trapezoidal": LIMITS[1:2], "s_curve": LIMITS[2:]}[self.profile]

    def _is_given(self, name: str) -> bool:
        """Whether a list is given, in either unit."""
        return getattr(self, name) is not None or getattr(self, IN_METRES[name]) is not None

    def starts_at_initial(self, unit: str) -> bool:
        """Whether joints whose unit is deg or m start at their initial positions in the scene."""
        return self.profile not in TABLED and getattr(self, f"from_{unit}") is None

    @property
    def per_link(self) -> dict[str, Row]:
        """All lists of one number per link, by key."""
        lists = {key: getattr(self, key) for key in _in_both(*LISTS)}
        for key in _in_both(*OF_MOTION):
            lists |= {f"{key}[{k}]": row for k, row in enumerate(getattr(self, key) or ())}
        return {name: row for name, row in lists.items() if row is not None}

    def course(
        self, initial: ArrayLike, links: Sequence[int] | None = None, slides: Sequence[bool] | None = None
    ) -> ReferenceTrajectory:
        """Return the desired angles over time [rad], and positions of prismatic joints [m].

        Parameters
        ----------
        initial
            Initial positions of the joints, one number per link, [deg], or [m] if the joint is prismatic.
        links
            Indices from 0 of the links to include, which all finish together; None: all.
        slides
            Whether each joint is prismatic, one per link; None: none is.

        Returns
        -------
        ReferenceTrajectory
            One column per included link; call it with times to get angles, rates and accelerations.

        Raises
        ------
        SceneError
            A list does not have one number per link, an angle changes too fast for float64, or the table is in a
            file, which only scenes read.
        DataFileError
            The user's shaper file is invalid.

        Examples
        --------
        >>> angle, rate, acceleration = move.course((30.0, -60.0))(0.25)
        >>> print(np.degrees(angle).round(1))  # half-way
        [ 45. -60.]
        """
        if self.file is not None:
            raise self._refused("file", "only scenes read files; use Scene.course", "file-not-read")
        start = np.asarray(initial, dtype=np.float64)
        for name, row in self.per_link.items():
            if len(row) != len(start):
                text = f"{name} = {truncated(row)}: expected one number per link, {len(start)}"
                raise SceneError(text, id="one-per-link")
        chosen = list(range(len(start)) if links is None else links)
        kinds = (False,) * len(start) if slides is None else tuple(map(bool, slides))
        for name in ("to_deg", *OF_MOTION):  # there must be targets, or tables, in the unit of each kind of joint
            for key, slide in ((name, False), (IN_METRES[name], True)):
                if slide in {kinds[k] for k in chosen} and self._is_given(name) and getattr(self, key) is None:
                    raise missing(key, f"there are {OF_JOINT[slide].name} joints")
        with errors_at("", ArgumentError), np.errstate(all="ignore"):
            times = self.times
            course = self._move(start, chosen, kinds) if times is None else self._table(times, chosen, kinds)
        with errors_at("shaper.", ArgumentError):
            return course if self.shaper is None else course.shaped(*self.shaper.impulses)

    def _own(self, name: str, slides: Slides) -> Row:
        """The list `name` and its twin, merged in the joints' own units, deg or m."""
        return together(slides, getattr(self, name), getattr(self, IN_METRES[name]))

    def _move(self, initial: Array, links: list[int], slides: Slides) -> ReferenceTrajectory:
        given = np.array([not self.starts_at_initial(OF_JOINT[s].unit) for s in slides])
        start = np.where(given, self._own("from_deg", slides), initial)
        to = np.array(self._own("to_deg", slides))
        shapes = {k: self._shape(k, abs(to[k] - start[k]), slides[k]) for k in links if to[k] != start[k]}
        lasts = self.duration or max((shape.duration for shape in shapes.values()), default=0.0)
        courses = []
        for k, a, b in zip(links, *(in_si(slides, positions)[links] for positions in (start, to)), strict=True):
            if k not in shapes:
                courses.append(still([a]))
                continue
            knots, c = shapes[k].lasting(lasts).pieces
            knots, c = knots + self.start, (b - a) * c
            c[:, 0] += a
            there = distinct(knots)
            if not there[:-1].any():
                why = f"too late: float64 cannot resolve a move of {lasts:.3g} s at that time; start earlier"
                raise self._refused("start", why, "start-too-late")
            courses.append(from_rest_to_rest(knots[there], c[there[:-1], :, None], np.array([b])))
        return side_by_side(courses)

    def _shape(self, link: int, distance: float, slides: bool) -> profiles.Shape:
        plain, fastest = profiles.MOVES[self.profile]
        if self.duration is not None:
            return plain
        keys = [IN_METRES[name] if slides else name for name in LIMITS]
        limits = {key: values[link] for key in keys if (values := getattr(self, key)) is not None}
        for key, limit in limits.items():
            require_positive(f"{key}.{link + 1}", limit)
        deciding = [IN_METRES[name] if slides else name for name in self._deciding]
        if not limits.keys() & set(deciding):
            raise missing(deciding[0], f"there are {OF_JOINT[slides].name} joints that move")
        rate, acceleration, jerk = (limits.get(key, math.inf) for key in keys)
        return fastest(distance, (rate, acceleration, jerk))

    def _table(self, times: Row, links: list[int], slides: Slides) -> ReferenceTrajectory:
        t = np.array(times)
        known = [self._rows(name, slides)[:, links] for name in OF_MOTION if self._is_given(name)]
        angles = known[0]
        if len(t) == 1:
            return still(angles[0])
        if self.profile == "hold":
            on_time = 8 * np.finfo(float).eps  # a sample at a row's time, up to rounding, gets this row
            return ReferenceTrajectory(t * (1 - on_time), angles[:, None])
        if self.profile == "linear":
            slopes = np.diff(angles, axis=0) / np.diff(t)[:, None]
            return from_rest_to_rest(t, np.stack([angles[:-1], slopes], 1), angles[-1])
        return from_rest_to_rest(t, smooth_pieces(t, known), angles[-1])

    def _rows(self, name: str, slides: Slides) -> Array:
        """A table of angles, rates or accelerations in SI units, shape (rows, links)."""
        deg, m = (getattr(self, key) or (None,) * len(self.times or ()) for key in (name, IN_METRES[name]))
        return in_si(slides, [together(slides, *row) for row in zip(deg, m, strict=True)])


def _in_both(*keys: str) -> list[str]:
    """Keys in degrees, each followed by its twin in metres."""
    return [one for key in keys for one in (key, IN_METRES[key])]


def smooth_pieces(t: Array, known: list[Array]) -> Array:
    """Cubic spline through angles, or Hermite polynomials if rates are known; coefficients (m, ·, d)."""
    from scipy.interpolate import BPoly, CubicSpline, PPoly  # noqa: PLC0415  slow to import: 0.1 s

    if len(known) == 1:
        pieces = CubicSpline(t, known[0], bc_type="clamped")
    else:
        pieces = PPoly.from_bernstein_basis(BPoly.from_derivatives(t, np.stack(known, 1)))
    return np.asarray(pieces.c[::-1].transpose(1, 0, 2))
