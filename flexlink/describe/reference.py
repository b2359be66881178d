"""Reference of a drive: desired angles in time, a move from point to point or a table, input-shaped if asked for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from flexlink.common.errors import ArgumentError, DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.describe import profiles
from flexlink.describe.reference_trajectory import ReferenceTrajectory, apart, from_rest_to_rest, side_by_side, still
from flexlink.describe.shaping import MOST_IMPULSES, InputShaper
from flexlink.describe.spec import NonNegative, PerLink, Positive, PositivePerLink, Spec, require_increasing, truncated

Row = tuple[float, ...]

LIMITS = ("max_rate_deg", "max_acceleration_deg", "max_jerk_deg")
TAKES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "quintic": (("to_deg",), ("from_deg", "start", "duration", *LIMITS)),
    "trapezoidal": (("to_deg",), ("from_deg", "start", "duration", *LIMITS[:2])),
    "s_curve": (("to_deg",), ("from_deg", "start", "duration", *LIMITS)),
    "linear": (("times", "angle_deg"), ()),
    "smooth": (("times", "angle_deg"), ("rate_deg", "acceleration_deg")),
    "hold": (("times", "angle_deg"), ()),
}
"""What each profile needs, and what it may have."""


class Reference(Spec, frozen=True):
    """Desired angles of the driven joints in time, one column per link [deg, deg/s, deg/s², deg/s³].

    A move, profile "quintic", "trapezoidal" (trapezoid of speed) or "s_curve" (limited jerk, up to 7 phases): from
    `from_deg`, by default `initial.joint_deg` of the scene, to `to_deg`, from `start` on. It lasts for `duration`, or
    as long as the slowest joint needs at its limits, of which one at least is then reached. All joints start and end
    together: each takes its own fastest profile, stretched in time to that of the slowest one. With a duration, a third
    of it is for speeding up, a third for braking, and of these a third each for rising and falling acceleration.

    A table, rows `angle_deg` at `times`, profile "linear", "hold" (steps without a ramp) or "smooth": a cubic spline
    from rest to rest, or, with `rate_deg`, cubic Hermite polynomials, or, with `acceleration_deg`, too, quintic ones.
    Before and after the table its first and last angles are held.

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
    to_deg: PerLink | None = None
    """Of a move: where it ends, one angle per link [deg]."""
    from_deg: PerLink | None = None
    """Of a move: where it starts, one angle per link [deg]. Default: `initial.joint_deg`."""
    start: NonNegative = 0.0
    """Of a move: when it starts [s]."""
    duration: Positive | None = None
    """Of a move: how long it takes [s]; else as long as its limits ask for."""
    max_rate_deg: PositivePerLink | None = None
    """Of a move: largest rate of each joint [deg/s]."""
    max_acceleration_deg: PositivePerLink | None = None
    """Of a move: largest acceleration of each joint [deg/s²]."""
    max_jerk_deg: PositivePerLink | None = None
    """Of a move: largest jerk of each joint [deg/s³]."""
    times: Row | None = None
    """Of a table: times of its rows [s]."""
    angle_deg: tuple[PerLink, ...] | None = None
    """Of a table: one row per time, of one angle per link [deg]."""
    rate_deg: tuple[PerLink, ...] | None = None
    """Of a smooth table: rates at its times [deg/s]; pieces are then cubic Hermite polynomials."""
    acceleration_deg: tuple[PerLink, ...] | None = None
    """Of a smooth table with rates: accelerations at its times [deg/s²]; pieces are then quintic."""
    shaper: InputShaper | None = None
    """Input shaper: delays copies of the reference so that it leaves no vibration."""

    def __post_init__(self) -> None:
        super().__post_init__()
        needs, may = TAKES[self.profile]
        for name in dict.fromkeys(name for both in TAKES.values() for part in both for name in part):
            value = getattr(self, name)
            missing, odd = name in needs and value is None, name not in (*needs, *may) and value not in (None, 0.0)
            if missing or odd:
                state = ": missing;" if missing else f" = {truncated(value)}:"
                takes = ", ".join(needs) + (f", and may have {', '.join(may)}" if may else "")
                raise SceneError(f"{name}{state} profile {self.profile!r} takes {takes}")
        if self.times is None:
            self._check_time_of_move()
        else:
            self._check_table(self.times)

    def _check_time_of_move(self) -> None:
        limits = [name for name in LIMITS if getattr(self, name) is not None]
        # without a limit of the acceleration a trapezoid would be a jump
        needed = {"quintic": LIMITS, "trapezoidal": LIMITS[1:2], "s_curve": LIMITS[2:]}[self.profile]
        if self.duration is not None and limits:
            raise SceneError(f"duration = {self.duration!r}: {limits[0]} is given, too; give only one")
        if self.duration is None and not set(limits) & set(needed):
            raise SceneError(f"duration: missing; give it, or {' or '.join(needed)}")

    def _check_table(self, times: Row) -> None:
        require_increasing("times", times)
        if self.acceleration_deg is not None and self.rate_deg is None:
            raise SceneError("rate_deg: missing; acceleration_deg needs it")
        for name in ("angle_deg", "rate_deg", "acceleration_deg"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != len(times):
                raise SceneError(f"{name} has {len(rows)} rows: expected one per time, {len(times)}")

    @property
    def from_initial(self) -> bool:
        """Whether it starts where the scene's joints are initially."""
        return self.to_deg is not None and self.from_deg is None

    @property
    def per_link(self) -> dict[str, Row]:
        """Every list of one number per link, by its key."""
        lists = {name: getattr(self, name) for name in ("to_deg", "from_deg", *LIMITS)}
        for name in ("angle_deg", "rate_deg", "acceleration_deg"):
            lists |= {f"{name}[{k}]": row for k, row in enumerate(getattr(self, name) or ())}
        return {name: row for name, row in lists.items() if row is not None}

    def course(self, initial_deg: ArrayLike, links: Sequence[int] | None = None) -> ReferenceTrajectory:
        """The desired angles in time [rad].

        Parameters
        ----------
        initial_deg
            Where the joints are initially, one angle per link [deg].
        links
            Numbers from 0 of the links whose angles are wanted, and which others wait for; None: all.

        Returns
        -------
        ReferenceTrajectory
            One angle per link asked for; called with times, it gives angles, rates and accelerations.

        Raises
        ------
        SceneError
            Lists are not of one number per link, or an angle changes faster than float64 can hold.
        DataFileError
            The shaper's own file is not valid.

        Examples
        --------
        >>> angle, rate, acceleration = move.course((30.0, -60.0))(0.25)
        >>> print(np.degrees(angle).round(1))  # half-way
        [ 45. -60.]
        """
        initial = np.asarray(initial_deg, dtype=np.float64)
        for name, row in self.per_link.items():
            if len(row) != len(initial):
                raise SceneError(f"{name} = {truncated(row)}: expected one number per link, {len(initial)}")
        chosen = list(range(len(initial)) if links is None else links)
        try:
            with np.errstate(all="ignore"):
                course = self._move(initial, chosen) if self.times is None else self._table(self.times, chosen)
        except ArgumentError as error:
            raise SceneError(str(error)) from None
        if self.shaper is None:
            return course
        try:
            return course.shaped(*self.shaper.impulses)
        except (ArgumentError, DataFileError) as error:
            kind = DataFileError if isinstance(error, DataFileError) else SceneError
            raise kind(f"shaper.{error}") from None

    def _move(self, initial: Array, links: list[int]) -> ReferenceTrajectory:
        start, to = initial if self.from_deg is None else np.array(self.from_deg), np.array(self.to_deg)
        shapes = {k: self._shape(k, abs(to[k] - start[k])) for k in links if to[k] != start[k]}
        lasts = self.duration or max((shape.duration for shape in shapes.values()), default=0.0)
        courses = []
        for k, a, b in zip(links, np.radians(start[links]), np.radians(to[links]), strict=True):
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
                    "start earlier"
                )
            courses.append(from_rest_to_rest(knots[there], c[there[:-1], :, None], np.array([b])))
        return side_by_side(courses)

    def _shape(self, link: int, distance: float) -> profiles.Shape:
        if self.duration is not None:
            return profiles.PLAIN[self.profile]
        limits = [getattr(self, name) for name in LIMITS]
        own = profiles.Limits(*(math.inf if values is None else values[link] for values in limits))
        return profiles.FASTEST[self.profile](distance, own)

    def _table(self, times: Row, links: list[int]) -> ReferenceTrajectory:
        t = np.array(times)
        known = [np.radians(rows)[:, links] for rows in (self.angle_deg, self.rate_deg, self.acceleration_deg) if rows]
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


def refuse_beyond(course: ReferenceTrajectory, joints: Sequence[tuple[str, tuple[float, float] | None]]) -> None:
    """Refuse a course that leaves the limits [deg] of the links of these names, at any extreme of any piece.

    Raises
    ------
    SceneError
        The message names the link, the angle reached and the limits.
    """
    rounding = MOST_IMPULSES * np.finfo(float).eps  # of an angle that is the sum of as many
    for (name, limits), *extremes in zip(joints, *np.degrees(course.extremes()), strict=True):
        low, high = limits or (-math.inf, math.inf)
        for angle in extremes:
            if max(low - angle, angle - high) > rounding * np.abs(extremes).max():
                reason = f"outside limits_deg = {[low, high]} of the joint of {name!r}"
                raise SceneError(f"reaches {angle:.9g} deg: {reason}")


def _smooth(t: Array, known: list[Array]) -> Array:
    """A cubic spline through angles, or Hermite polynomials where rates, and accelerations, are known (m, ·, d)."""
    from scipy.interpolate import BPoly, CubicSpline, PPoly  # noqa: PLC0415  0.1 s that few scenes need

    if len(known) == 1:
        pieces = CubicSpline(t, known[0], bc_type="clamped")
    else:
        pieces = PPoly.from_bernstein_basis(BPoly.from_derivatives(t, np.stack(known, 1)))
    return np.asarray(pieces.c[::-1].transpose(1, 0, 2))
