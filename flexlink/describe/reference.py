"""Reference of a drive: desired angles in time, a move from point to point or a table, input-shaped if asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe import profiles
from flexlink.describe.numbers import require_increasing, require_positive
from flexlink.describe.own_units import IN_METRES, OF_JOINT, Row, Slides, in_si, together
from flexlink.describe.reference_trajectory import ReferenceTrajectory, apart, from_rest_to_rest, side_by_side, still
from flexlink.describe.shaping import InputShaper
from flexlink.describe.spec import NonNegative, NonNegativePerLink, PerLink, Positive, Spec, measured_in

LIMITS = ("max_rate_deg", "max_acceleration_deg", "max_jerk_deg")
TAKES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "quintic": (("to_deg",), ("from_deg", "start", "duration", *LIMITS)),
    "trapezoidal": (("to_deg",), ("from_deg", "start", "duration", *LIMITS[:2])),
    "s_curve": (("to_deg",), ("from_deg", "start", "duration", *LIMITS)),
    "linear": (("times", "angle_deg"), ()),
    "smooth": (("times", "angle_deg"), ("rate_deg", "acceleration_deg")),
    "hold": (("times", "angle_deg"), ()),
}
"""What each profile needs, and what it may have, or the same in metres."""
TABLED = tuple(profile for profile, (needs, _) in TAKES.items() if "times" in needs)
LISTS = ("to_deg", "from_deg", *LIMITS)
OF_MOTION = ("angle_deg", "rate_deg", "acceleration_deg")


class Reference(Spec, frozen=True):
    """Desired angles of the driven joints in time, one column per link [deg, deg/s, deg/s², deg/s³].

    Positions of prismatic joints stand beside them [m, m/s, m/s², m/s³]: in `to_m` beside `to_deg` and so on, in
    `position_m` beside `angle_deg`. Either list has 0 where a link's joint is of the other kind; one of a kind that the
    arm does not have is left out.

    A move, profile "quintic", "trapezoidal" (trapezoid of speed) or "s_curve" (limited jerk, up to 7 phases): from
    `from_deg`, by default `initial.joint_deg` of the scene, to `to_deg`, from `start` on. It lasts for `duration`, or
    as long as the slowest joint needs at its limits, of which one at least is then reached. All joints start and end
    together: each takes its own fastest profile, stretched in time to that of the slowest one. With a duration, a third
    of it is for speeding up, a third for braking, and of these a third each for rising and falling acceleration.

    A table, rows `angle_deg` at `times`, profile "linear", "hold" (steps without a ramp) or "smooth": a cubic spline
    from rest to rest, or, with `rate_deg`, cubic Hermite polynomials, or, with `acceleration_deg`, too, quintic ones.
    Before and after the table its first and last angles are held. Its rows may stand in a CSV `file`.

    With a `shaper`, the sum of delayed references that leaves no vibration of its frequencies; it is later at its end.

    Examples
    --------
    >>> move = fl.Reference(profile="s_curve", to_deg=(60.0, -40.0), max_rate_deg=(90.0, 90.0), max_jerk_deg=(2e3, 2e3))
    >>> course = move.course((30.0, -60.0))  # from there
    >>> print(course.knots[-1].round(2))  # s
    0.78
    """

    profile: Literal["quintic", "trapezoidal", "s_curve", "linear", "smooth", "hold"]
    """A move (quintic, trapezoidal, s_curve), or a table (linear, smooth, hold)."""
    to_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """Of a move: where it ends, one angle per link [deg]."""
    to_m: Annotated[PerLink | None, measured_in("m")] = None
    """Of a move: where it ends, one position per link [m]."""
    from_deg: Annotated[PerLink | None, measured_in("deg")] = None
    """Of a move: where it starts, one angle per link [deg]. Default: `initial.joint_deg`."""
    from_m: Annotated[PerLink | None, measured_in("m")] = None
    """Of a move: where it starts, one position per link [m]. Default: `initial.joint_m`."""
    start: Annotated[NonNegative, measured_in("s")] = 0.0
    """Of a move: when it starts [s]."""
    duration: Annotated[Positive | None, measured_in("s")] = None
    """Of a move: how long it takes [s]; else as long as its limits ask for."""
    max_rate_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s")] = None
    """Of a move: largest rate of each joint [deg/s]."""
    max_rate_m: Annotated[NonNegativePerLink | None, measured_in("m/s")] = None
    """Of a move: largest rate of each prismatic joint [m/s]."""
    max_acceleration_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s²")] = None
    """Of a move: largest acceleration of each joint [deg/s²]."""
    max_acceleration_m: Annotated[NonNegativePerLink | None, measured_in("m/s²")] = None
    """Of a move: largest acceleration of each prismatic joint [m/s²]."""
    max_jerk_deg: Annotated[NonNegativePerLink | None, measured_in("deg/s³")] = None
    """Of a move: largest jerk of each joint [deg/s³]."""
    max_jerk_m: Annotated[NonNegativePerLink | None, measured_in("m/s³")] = None
    """Of a move: largest jerk of each prismatic joint [m/s³]."""
    times: Annotated[Row | None, measured_in("s")] = None
    """Of a table: times of its rows [s]."""
    angle_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg")] = None
    """Of a table: one row per time, of one angle per link [deg]."""
    rate_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg/s")] = None
    """Of a smooth table: rates at its times [deg/s]; pieces are then cubic Hermite polynomials."""
    acceleration_deg: Annotated[tuple[PerLink, ...] | None, measured_in("deg/s²")] = None
    """Of a smooth table with rates: accelerations at its times [deg/s²]; pieces are then quintic."""
    position_m: Annotated[tuple[PerLink, ...] | None, measured_in("m")] = None
    """Of a table: one row per time, of one position per link [m]."""
    rate_m: Annotated[tuple[PerLink, ...] | None, measured_in("m/s")] = None
    """Of a smooth table: rates of prismatic joints at its times [m/s]."""
    acceleration_m: Annotated[tuple[PerLink, ...] | None, measured_in("m/s²")] = None
    """Of a smooth table with rates: accelerations of prismatic joints at its times [m/s²]."""
    file: str | None = None
    """Of a table: a CSV file in place of its rows, with heads "t [s]" and, of every driven joint, "q NAME [deg]", or
    any unit of angles, of a prismatic joint of lengths; of a smooth table "qd NAME [deg/s]" and "qdd NAME [deg/s²]",
    too, if it has them. A path from the scene's folder; it is read once, when the scene is."""
    cutoff: Annotated[Positive | None, measured_in("Hz")] = None
    """Of a smooth table's file: frequency at which a zero-phase low-pass of its angles lets half of the amplitude
    through [Hz]; rates and accelerations are those of what is left. Default: those of the file, or of a spline."""
    shaper: InputShaper | None = None
    """Input shaper: delays copies of the reference so that it leaves no vibration."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cutoff is not None and (self.file is None or self.profile != "smooth"):
            raise SceneError(
                f"cutoff = {self.cutoff!r}: needs a file and profile 'smooth'; leave cutoff out", id="needs-another-key"
            )
        if self.file is not None:
            self._check_file()
            return
        needs, may = TAKES[self.profile]
        for name in dict.fromkeys(name for both in TAKES.values() for part in both for name in part):
            values = {key: getattr(self, key) for key in (name, IN_METRES.get(name, name))}
            if name in needs and all(value is None for value in values.values()):
                raise SceneError(
                    f"{name}: missing; profile {self.profile!r} takes {_taken(needs, may)}", id="missing-key"
                )
            for key, value in values.items():
                if name not in (*needs, *may) and value not in (None, 0.0):
                    takes = _taken(needs, may)
                    raise SceneError(
                        f"{key} = {truncated(value)}: profile {self.profile!r} takes {takes}", id="key-of-another-kind"
                    )
        self._check_limits()
        if self.times is None:
            self._check_time_of_move()
        else:
            self._check_table(self.times)

    def _check_file(self) -> None:
        """It stands for a table, and alone."""
        if self.profile not in TABLED:
            raise SceneError(
                f"file = {self.file!r}: profile {self.profile!r} takes {_taken(*TAKES[self.profile])}; a file is a "
                f"table's, of profile {', '.join(TABLED)}",
                id="key-of-another-kind",
            )
        for key in sorted([*_in_both(*LISTS, *OF_MOTION), "times", "start", "duration"]):
            if getattr(self, key) not in (None, 0.0):
                raise SceneError(f"file = {self.file!r}: {key} is given, too; give only one", id="both-given")

    def _check_limits(self) -> None:
        """A limit is positive, but of a joint whose limit is in the other unit."""
        given = {key.endswith("_m") for key in _in_both(*LISTS, *OF_MOTION) if getattr(self, key) is not None}
        for key in () if len(given) == 2 else _in_both(*LIMITS):
            beside = "; 0 is for joints that turn, whose lists in deg are given, too" if key.endswith("_m") else ""
            for k, limit in enumerate(getattr(self, key) or (), 1):
                require_positive(f"{key}.{k}", limit, beside)

    def _check_time_of_move(self) -> None:
        limits = [name for name in LIMITS if self._said(name)]
        # without a limit of the acceleration a trapezoid would be a jump
        needed = self._deciding
        if self.duration is not None and limits:
            raise SceneError(f"duration = {self.duration!r}: {limits[0]} is given, too; give only one", id="both-given")
        if self.duration is None and not set(limits) & set(needed):
            named = needed if self.to_m is None or self.to_deg is not None else [IN_METRES[name] for name in needed]
            raise SceneError(f"duration: missing; give it, or {' or '.join(named)}", id="missing-key")

    @property
    def _deciding(self) -> tuple[str, ...]:
        """Limits of which a move without a duration needs one."""
        return {"quintic": LIMITS, "trapezoidal": LIMITS[1:2], "s_curve": LIMITS[2:]}[self.profile]

    def _said(self, name: str) -> bool:
        """Whether a list is given, in either unit."""
        return getattr(self, name) is not None or getattr(self, IN_METRES[name]) is not None

    def _check_table(self, times: Row) -> None:
        require_increasing("times", times)
        if self._said("acceleration_deg") and not self._said("rate_deg"):
            raise SceneError("rate_deg: missing; acceleration_deg needs it", id="needs-another-key")
        for name in _in_both(*OF_MOTION):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(times):
                raise SceneError(f"{name} has {len(rows)} rows: expected one per time, {len(times)}", id="one-per-time")

    def starts_at_initial(self, *, slides: bool) -> bool:
        """Whether a joint that turns, or slides, starts where the scene's joints are initially."""
        return self.profile not in TABLED and (self.from_m if slides else self.from_deg) is None

    @property
    def per_link(self) -> dict[str, Row]:
        """Every list of one number per link, by its key."""
        lists = {key: getattr(self, key) for key in _in_both(*LISTS)}
        for key in _in_both(*OF_MOTION):
            lists |= {f"{key}[{k}]": row for k, row in enumerate(getattr(self, key) or ())}
        return {name: row for name, row in lists.items() if row is not None}

    def course(
        self, initial: ArrayLike, links: Sequence[int] | None = None, slides: Sequence[bool] | None = None
    ) -> ReferenceTrajectory:
        """The desired angles in time [rad], and positions of joints that slide [m].

        Parameters
        ----------
        initial
            Where the joints are initially, one number per link, [deg] or, where it slides, [m].
        links
            Numbers from 0 of the links whose angles are wanted, and which others wait for; None: all.
        slides
            Which of the joints slide, one per link; None: none.

        Returns
        -------
        ReferenceTrajectory
            One angle per link asked for; called with times, it gives angles, rates and accelerations.

        Raises
        ------
        SceneError
            Lists are not of one number per link, an angle changes faster than float64 can hold, or its table stands in
            a file, which scenes read.
        DataFileError
            The shaper's own file is not valid.

        Examples
        --------
        >>> angle, rate, acceleration = move.course((30.0, -60.0))(0.25)
        >>> print(np.degrees(angle).round(1))  # half-way
        [ 45. -60.]
        """
        if self.file is not None:
            raise SceneError(f"file = {self.file!r}: is read as part of a scene; take Scene.course", id="file-not-read")
        start = np.asarray(initial, dtype=np.float64)
        for name, row in self.per_link.items():
            if len(row) != len(start):
                raise SceneError(
                    f"{name} = {truncated(row)}: expected one number per link, {len(start)}", id="one-per-link"
                )
        chosen = list(range(len(start)) if links is None else links)
        kinds = (False,) * len(start) if slides is None else tuple(map(bool, slides))
        self._require_lists({kinds[k] for k in chosen})
        try:
            with np.errstate(all="ignore"):
                course = (
                    self._move(start, chosen, kinds) if self.times is None else self._table(self.times, chosen, kinds)
                )
        except ArgumentError as error:
            raise SceneError(str(error)) from None
        if self.shaper is None:
            return course
        try:
            return course.shaped(*self.shaper.impulses)
        except (ArgumentError, DataFileError) as error:
            kind = DataFileError if isinstance(error, DataFileError) else SceneError
            raise kind(f"shaper.{error}") from None

    def _require_lists(self, kinds: set[bool]) -> None:
        """Joints of either kind have goals, or tables, in their own unit."""
        for name in ("to_deg", *OF_MOTION):
            for key, slides in ((name, False), (IN_METRES[name], True)):
                if slides in kinds and self._said(name) and getattr(self, key) is None:
                    raise SceneError(f"{key}: missing; there are {OF_JOINT[slides].name} joints", id="missing-key")

    def _own(self, name: str, slides: Slides) -> Row:
        """A list in the joints' own units."""
        return together(slides, getattr(self, name), getattr(self, IN_METRES[name]))

    def _move(self, initial: Array, links: list[int], slides: Slides) -> ReferenceTrajectory:
        given = np.array([not self.starts_at_initial(slides=s) for s in slides])
        start = np.where(given, self._own("from_deg", slides), initial)
        to = np.array(self._own("to_deg", slides))
        shapes = {k: self._shape(k, abs(to[k] - start[k]), slides[k]) for k in links if to[k] != start[k]}
        lasts = self.duration or max((shape.duration for shape in shapes.values()), default=0.0)
        courses = []
        for k, a, b in zip(links, *(in_si(slides, place)[links] for place in (start, to)), strict=True):
            if k not in shapes:
                courses.append(still([a]))
                continue
            knots, c = shapes[k].lasting(lasts).pieces
            knots, c = knots + self.start, (b - a) * c
            c[:, 0] += a
            there = apart(knots)
            if not there[:-1].any():
                raise SceneError(
                    f"start = {self.start!r}: too late: float64 cannot resolve a move of {lasts:.3g} s at that time; "
                    "start earlier",
                    id="start-too-late",
                )
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
            raise SceneError(
                f"{deciding[0]}: missing; there are {OF_JOINT[slides].name} joints that move", id="missing-key"
            )
        rate, acceleration, jerk = (limits.get(key, math.inf) for key in keys)
        return fastest(distance, (rate, acceleration, jerk))

    def _table(self, times: Row, links: list[int], slides: Slides) -> ReferenceTrajectory:
        t = np.array(times)
        known = [self._rows(name, slides)[:, links] for name in OF_MOTION if self._said(name)]
        angles = known[0]
        if len(t) == 1:
            return still(angles[0])
        if self.profile == "hold":
            on_time = 8 * np.finfo(float).eps  # more than a sample's time may be off by: a sample sees what follows
            return ReferenceTrajectory(t * (1 - on_time), angles[:, None])
        if self.profile == "linear":
            return from_rest_to_rest(
                t, np.stack([angles[:-1], np.diff(angles, axis=0) / np.diff(t)[:, None]], 1), angles[-1]
            )
        return from_rest_to_rest(t, _smooth(t, known), angles[-1])

    def _rows(self, name: str, slides: Slides) -> Array:
        """A table [rad, m] and so on, (rows, links)."""
        both = getattr(self, name), getattr(self, IN_METRES[name])
        deg, m = (rows or (None,) * len(self.times or ()) for rows in both)
        return in_si(slides, [together(slides, *row) for row in zip(deg, m, strict=True)])


def _in_both(*keys: str) -> list[str]:
    """Keys of angles, each with its own in metres behind it."""
    return [one for key in keys for one in (key, IN_METRES[key])]


def _taken(needs: Sequence[str], may: Sequence[str]) -> str:
    """What a profile takes, in words."""
    return ", ".join(needs) + (f", and may have {', '.join(may)}" if may else "")


def _smooth(t: Array, known: list[Array]) -> Array:
    """A cubic spline through angles, or Hermite polynomials where rates, and accelerations, are known (m, ·, d)."""
    from scipy.interpolate import BPoly, CubicSpline, PPoly  # noqa: PLC0415  0.1 s that few scenes need

    if len(known) == 1:
        pieces = CubicSpline(t, known[0], bc_type="clamped")
    else:
        pieces = PPoly.from_bernstein_basis(BPoly.from_derivatives(t, np.stack(known, 1)))
    return np.asarray(pieces.c[::-1].transpose(1, 0, 2))
