"""Curvature and twist of a link at rest: constant, tabulated along it, or due to a temperature gradient.

The centre line of a beam without loads begins at its root along x of the section. With s the distance along it, the
position r and the axes R of the sections obey (Love 1927, A Treatise on the Mathematical Theory of Elasticity, ch. 18)

    r' = R e_x        R' = R [κ₀]×        κ₀ = (twist, κ_y, κ_z)

in axes of the section, right-handed: κ_z > 0 bends the beam towards its y, κ_y > 0 away from its z. A temperature
T₀ + g_y y + g_z z with the expansion α strains the fibre (y, z) by α (g_y y + g_z z) = z κ_y − y κ_z, so it adds

    κ_y = α g_z        κ_z = −α g_y                (Boley & Weiner 1960, Theory of Thermal Stresses, ch. 10)
"""

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np

from flexlink.common.errors import SceneError, errors_at
from flexlink.common.types import Array
from flexlink.common.wording import both_given
from flexlink.describe.spec import NonNegative, Spec, Vector3, measured_in

Row = tuple[float, ...]


class Along(NamedTuple):
    """A number along a beam, linear between rows; at two rows of the same place it jumps."""

    x: Array  # (rows,), relative to the length, from 0 to 1
    values: Array  # (rows,)

    def at(self, x: Array) -> Array:
        """Values at places between rows, (…)."""
        return np.interp(x, self.x, self.values)


class _Table(Spec, frozen=True):
    """Columns along a beam."""

    x: Annotated[tuple[NonNegative, ...], measured_in("m")] = ()
    """Positions of the rows along the beam, from 0 at its root to its length [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._fill()
        check_rows(self, self.x)
        for name in self.__struct_fields__[1:]:
            column = getattr(self, name)
            if column and isinstance(column, tuple) and len(column) != len(self.x):
                raise self._refused(name, f"expected one number per row of x, {len(self.x)}", "one-per-row")

    def _fill(self) -> None:
        """Compute columns that are given in another form."""

    def along(self, column: Row) -> Along:
        """A column of the table, zero if it is not given."""
        x = np.array(self.x)
        return Along(x / x[-1], np.array(column or np.zeros(len(x))))


class RestCurvature(_Table, frozen=True):
    """Curvature of a link at rest as a table along it, or that of a measured centre line through points.

    Columns are linear between rows, and jump where two rows have the same x. The centre line through points is a cubic
    spline that begins along the beam's x, about which sections do not turn unless `link.twist` turns them.

    Examples
    --------
    >>> hook = {"x": [0, 0.5, 0.5, 1], "z": [0, 0, 3, 3]}  # straight, then bent
    >>> bent = fl.lump(scene.varied({"link.upper.length": 1.0, "link.upper.curvature": hook}))
    >>> print(f"{np.degrees(bent.rest.sum()):.1f}")  # °
    85.9
    >>> bow = {"points": [(x, 0.1 * x**2, 0.0) for x in np.linspace(0, 1, 9)]}
    >>> link = fl.Link(name="bow", flex="z", segments=9, material="steel", section="pipe", curvature=bow)
    >>> print(f"{link.length:.4f} m, {link.curvature.z[0]:.2f} 1/m at the root")
    1.0066 m, 0.20 1/m at the root
    """

    y: Annotated[Row, measured_in("1/m")] = ()
    """Curvature about the section's y [1/m]; positive bends away from its z. Default: 0."""
    z: Annotated[Row, measured_in("1/m")] = ()
    """Curvature about the section's z [1/m]; positive bends towards its y. Default: 0."""
    points: Annotated[tuple[Vector3, ...], measured_in("m")] = ()
    """Points of the centre line instead of columns, in axes of the beam's root from (0, 0, 0) on, at least four [m]."""
    file: str | None = None
    """A CSV file of such points, with columns x, y and z and their units, or a primary input file of BeamDyn, whose key
    points are read; relative to the scene's folder. BeamDyn's z, x and y are x, y and z of the beam."""
    untwisted: bool = False
    """Whether y and z are curvatures about axes that `link.twist` does not turn, as those of `points` always are [1].
    Default: about axes of the section."""

    def _fill(self) -> None:
        given = [name for name in ("file", "points", "x", "y", "z") if getattr(self, name)]
        if given[:1] not in (["file"], ["points"]):
            return
        if given[1:]:
            raise both_given(given[0], getattr(self, given[0]), given[1])
        from flexlink.data.blade_file import read_centre_line  # noqa: PLC0415  few scenes name one

        points = np.array(self.points)
        if self.file is not None:
            with errors_at(f"file = {self.file!r}: ", file=self.file):
                points = read_centre_line(Path(self.file))[:, :3]
        found = *shape_through(points)[:3], (), None, True
        for name, value in zip(("x", "y", "z", "points", "file", "untwisted"), found, strict=True):
            msgspec.structs.force_setattr(self, name, value)


class RestTwist(_Table, frozen=True):
    """Twist of a link at rest as a table along it; linear between rows, with jumps where two rows have the same x.

    The initial twist of BeamDyn's key points is positive about −x here. A cubic spline along their centre line connects
    the angles (BeamDyn fits polynomials to points and angles). They count from axes that BeamDyn tilts along the line
    so that its x has no part along its y; this turn about the line, nonzero if the line bends in space, is in `rate`.

    Examples
    --------
    >>> blade = {"x": [0, 1.25], "rate": [0.4, 0]}  # rad/m
    >>> print(fl.Link(name="blade", length=1.25, twist=blade, material="steel", section="strip").twist.rate)
    (0.4, 0.0)
    """

    rate: Annotated[Row, measured_in("rad/m")] = ()
    """Twist per length about the beam's axis [rad/m]."""
    root: Annotated[float, measured_in("rad")] = 0.0
    """Angle of the section at the root about the beam's axis, from the axes that follow from `link.up` [rad]."""
    file: str | None = None
    """A primary input file of BeamDyn instead, relative to the scene's folder; name it in `curvature` too if the axis
    is not straight."""

    def _fill(self) -> None:
        if self.file is None:
            return
        if given := [name for name in ("x", "rate", "root") if getattr(self, name)]:
            raise both_given("file", self.file, given[0])
        from flexlink.data.blade_file import read_centre_line  # noqa: PLC0415  few scenes name one

        with errors_at(f"file = {self.file!r}: ", file=self.file):
            keys = read_centre_line(Path(self.file), twisted=True)
            x, _, _, rate = shape_through(keys[:, :3], keys[:, 3])
        for name, value in {"x": x, "rate": rate, "root": float(keys[0, 3]), "file": None}.items():
            msgspec.structs.force_setattr(self, name, value)


class ThermalGradient(Spec, frozen=True):
    """A temperature gradient across a link's section, which bends the link at rest.

    Examples
    --------
    >>> sunlit = {"gradient": 500.0, "expansion": 23e-6}  # aluminium, 10 K across 20 mm
    >>> bent = fl.lump(scene.varied({"link.upper.thermal": sunlit}))
    >>> print(np.degrees(bent.rest[1:3]).round(2))  # °, away from the warm side
    [-0.33 -0.33]
    """

    gradient: Annotated[float | tuple[float, float], measured_in("K/m")]
    """Temperature gradient along the section's y, or along its y and z [K/m]; positive if the side of larger y is
    warmer."""
    expansion: Annotated[float, measured_in("1/K")]
    """Thermal expansion α of the material [1/K]: 12e-6 for steel, 23e-6 for aluminium."""

    @property
    def curvatures(self) -> tuple[float, float]:
        """Curvature about the section's y and z [1/m]."""
        along_y, along_z = self.gradient if isinstance(self.gradient, tuple) else (self.gradient, 0.0)
        return self.expansion * along_z, -self.expansion * along_y


def shape_through(points: Array, angles: Array | float = 0.0) -> list[Row]:
    """Positions s along a cubic spline through points (k, 3) that begins along x, and its κ_y and κ_z there.

    Sections do not turn about the tangent t, so t' = κ_z e_y − κ_y e_z; their axes follow from double reflections (Wang
    et al. 2008, ACM Trans. Graph. 27, 2). Last is the twist of sections whose angles (k,), which a spline connects,
    count from axes whose y has no part along z of the root: these turn about t by t_z d atan2(t_y, t_x).
    """
    from scipy.interpolate import CubicSpline  # noqa: PLC0415  slow to import: 0.1 s

    chords = np.linalg.norm(np.diff(points, axis=0), axis=1)
    if len(points) < 4 or points[0].any() or not chords.all():
        text = f"points: {len(points)} from {points[:1].tolist()}: expected at least four, from (0, 0, 0) on"
        raise SceneError(f"{text}, no two equal", id="centre-line")
    knots, x = np.append(0.0, np.cumsum(chords)), np.eye(3)[0]
    begins = CubicSpline(knots, points)(0.0, 1)
    off = np.degrees(np.arccos(np.clip(begins[0] / np.linalg.norm(begins), -1.0, 1.0)))
    if off > 5.0:  # more than a spline through few points errs
        text = f"points begin {off:.3g}° from x, along which the beam begins; turn them, or the link by its mount"
        raise SceneError(text, id="centre-line")
    line, parts = CubicSpline(knots, points, bc_type=((1, x), "not-a-knot")), 16
    u = np.interp(np.arange((len(points) - 1) * parts + 1) / parts, np.arange(len(points)), knots)
    gauss, weights = np.polynomial.legendre.leggauss(4)
    speeds = np.linalg.norm(line(u[:-1, None] + np.diff(u)[:, None] * (gauss + 1) / 2, 1), axis=2)
    s = np.append(0.0, np.cumsum(speeds @ weights / 2 * np.diff(u)))
    r, rate = line(u), line(u, 1)
    speed = np.linalg.norm(rate, axis=1, keepdims=True)
    t, bends = rate / speed, line(u, 2) / speed**2  # t' and a part along t
    y = np.tile(np.eye(3)[1], (len(u), 1))
    for k in range(len(u) - 1):
        y[k + 1] = _mirrored(y[k], r[k + 1] - r[k])
        y[k + 1] = _mirrored(y[k + 1], t[k + 1] - _mirrored(t[k], r[k + 1] - r[k]))
    turns = t[:, 2] * (t[:, 0] * bends[:, 1] - t[:, 1] * bends[:, 0]) / (t[:, :2] ** 2).sum(axis=1)
    turns += CubicSpline(knots, angles * np.ones(len(points)))(u, 1) / speed[:, 0]
    found = s, -(bends * np.cross(t, y)).sum(axis=1), (bends * y).sum(axis=1), turns
    return [tuple(column.tolist()) for column in found]


def _mirrored(v: Array, normal: Array) -> Array:
    """A vector v behind the mirror that is perpendicular to a normal."""
    square = normal @ normal
    return v - (2.0 * (normal @ v) / square if square else 0.0) * normal


Curvature = RestCurvature | float | tuple[float, float]
RestShape = tuple[Along, Along, Along]
"""Twist [rad/m], κ_y and κ_z [1/m] along a beam."""


def rest_shape(curvature: Curvature, twist: RestTwist | float, thermal: ThermalGradient | None) -> RestShape | None:
    """Twist and curvature of a beam at rest; None if it is straight and not twisted."""
    if not (curvature or twist or thermal):
        return None
    twisted = twist.along(twist.rate) if isinstance(twist, RestTwist) else _constant(twist)
    if isinstance(curvature, RestCurvature):
        bent = [curvature.along(curvature.y), curvature.along(curvature.z)]
        if curvature.untwisted and twist:
            bent = _turned(bent, twisted, getattr(twist, "root", 0.0), curvature.x[-1])
    else:
        bent = [_constant(κ) for κ in (curvature if isinstance(curvature, tuple) else (0.0, curvature))]
    warm = (0.0, 0.0) if thermal is None else thermal.curvatures
    κ_y, κ_z = (part._replace(values=part.values + added) for part, added in zip(bent, warm, strict=True))
    found = twisted, κ_y, κ_z
    return found if any(part.values.any() for part in found) else None


def _turned(bent: list[Along], twist: Along, root: float, length: float) -> list[Along]:
    """Curvatures about axes of sections that twist turns, from those about axes that it does not turn."""
    rows = np.unique(np.concatenate([bent[0].x, twist.x]))
    parts = -(-1024 // (len(rows) - 1))  # linear in between: an error of 1e-6 if the beam turns by 5 rad
    x = np.interp(np.arange((len(rows) - 1) * parts + 1) / parts, np.arange(len(rows)), rows)
    φ, ends = np.append(0.0, np.cumsum(np.diff(x) * twist.at((x[:-1] + x[1:]) / 2))), np.repeat(x, 2)[1:-1]
    c, s = (f(root + length * np.repeat(φ, 2)[1:-1]) for f in (np.cos, np.sin))
    inside = ends + np.repeat(np.diff(x), 2) * np.tile([1e-9, -1e-9], len(x) - 1)  # on this side of a jump
    κ_y, κ_z = (part.at(inside) for part in bent)
    return [Along(ends, c * κ_y + s * κ_z), Along(ends, c * κ_z - s * κ_y)]


def _constant(value: float) -> Along:
    return Along(np.array([0.0, 1.0]), np.array([value, value]))


def ends(*given: object) -> Iterator[float]:
    """Last position of each of these that is a table [m]."""
    yield from (table.x[-1] for table in given if isinstance(table, _Table))


def check_rows(table: Spec, x: tuple[float, ...]) -> None:
    """Refuse positions of rows that do not begin at 0 and increase; between the ends two may be equal."""
    if len(x) < 2 or x[0] != 0:
        raise table._refused("x", "expected two rows or more, from the root, x = 0, to the end", "rigidity-table")
    for k, (before, here) in enumerate(itertools.pairwise(x), 1):
        if here < before or (k >= 2 and here == before == x[k - 2]):
            why = f"must not be less than x[{k - 1}] = {before!r}; at most two rows may be equal"
            raise SceneError(f"x[{k}] = {here!r}: {why}", id="rigidity-table")
    if x[0] == x[1] or x[-1] == x[-2]:
        raise table._refused("x", "the ends of a beam cannot have jumps; give one row there", "rigidity-table")


def wrong_end(end: float, length: float) -> str:
    """Why a table does not fit a beam; "" if both end at the same place, up to rounding of the numbers in files."""
    text = f"ends at x = {end!r} m; the beam ends at {length!r} m; both must be equal"
    return text if abs(end - length) > 1e-6 * length else ""
