"""Joint axes that lie elsewhere: by themselves, or in frames turned or displaced with all that hangs on them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.engines.read_back import Indices, ReadBack

Array = NDArray[np.float64]

FITS = 1e-9
"""How well one rigid motion must put back all that follows a joint, relative to the arm's size."""


NEARLY = 1e-3
"""How well a unit of length must explain a displacement, relative: numbers may have been rounded by hand."""


class Place(NamedTuple):
    """A frame placed elsewhere, or the line of a joint alone."""

    joint: int
    angle: float  # [rad]
    offset: float  # [m]
    alone: bool = True  # whether all behind it follows it rigidly; if not, that stands elsewhere by itself, too
    axes: tuple[Array, Array] | None = None  # of a line by itself, in a frame that is right: theirs and ours, in that
    times: float | None = None  # how many times the right distance from the joint before, if that is a unit of length


class Placed(NamedTuple):
    """Their record after what was placed elsewhere was put back, and ours placed like theirs."""

    theirs: ReadBack
    places: list[Place]
    ours: ReadBack


def put_back(ours: ReadBack, theirs: ReadBack, within: float, units: Sequence[float] = ()) -> Placed:
    """Put their joints back, from the base on: each time the first that is off, with all that follows it, rigidly.

    A line alone is put back alone. `units` are factors that a distance between joints may be too large by. Where
    nothing of this does it, frames beyond are wrong, too: it ends there, and they are taken as ours.
    """
    if (times := _all_times(ours, theirs, within, units)) is not None:
        away = np.linalg.norm(theirs.points - ours.points, axis=1)
        everywhere = [Place(int(k), 0.0, float(away[k]), times=times) for k in _off(ours, theirs, within)]
        return Placed(_stretched(theirs, 1 / times), everywhere, _stretched(ours, times))
    places, like_theirs = list[Place](), ours
    while len(off := _off(ours, theirs, within)):
        place, theirs, like_theirs = _one_back(ours, theirs, like_theirs, int(off[0]), within, units)
        if places and place.joint <= places[-1].joint:  # what fits within `FITS` may still be off
            place = place._replace(alone=False)
        places.append(place)
        if not place.alone:
            return Placed(_tail(theirs, ours, place.joint), places, _tail(like_theirs, theirs, place.joint))
    return Placed(theirs, places, like_theirs)


def _one_back(
    ours: ReadBack, theirs: ReadBack, like_theirs: ReadBack, k: int, within: float, units: Sequence[float]
) -> tuple[Place, ReadBack, ReadBack]:
    """The joint that is first off put back in theirs, and ours placed like theirs."""
    sin, off = (float(part[k]) for part in deviations(ours, theirs))
    turned = float(np.arcsin(min(1.0, sin)))
    fitted = None if (before := _along_its_axis(ours, theirs, k, within)) is None else _motion(ours, theirs, before)
    k, fitted = (k, _motion(ours, theirs, k)) if before is None or fitted is None else (before, fitted)
    if _line_alone(ours, theirs, k, within, rigid=fitted is not None):
        R = theirs.frames[k]
        axes = theirs.axes[k] @ R, ours.axes[k] @ R
        return Place(k, turned, off, axes=axes), _line_of(theirs, ours, k), _line_of(like_theirs, theirs, k)
    unit = _unit(ours, theirs, k, units)
    if fitted is None and unit is not None:
        fitted = np.eye(3), unit[1], theirs.points[k]
    fitted = fitted or _motion(ours, theirs, k, _next_massive(ours, k) + 1)  # more is wrong further out
    if fitted is None:
        return Place(k, turned, off, alone=False), theirs, like_theirs
    R, point, moved = fitted
    place = Place(k, _angle(R), float(np.linalg.norm(moved - point)), times=None if unit is None else unit[0])
    return place, _displaced(theirs, k, R.T, moved, point), _displaced(like_theirs, k, R, point, moved)


def _along_its_axis(ours: ReadBack, theirs: ReadBack, k: int, within: float) -> int | None:
    """The joint before, if what it carries lies elsewhere, though its line does not: along it, or turned about it."""
    moved = np.linalg.norm(theirs.centers[k - 1] - ours.centers[k - 1]) > within * size(ours)
    return k - 1 if k > 0 and ours.masses[k - 1] > 0 and moved else None


def _line_alone(ours: ReadBack, theirs: ReadBack, k: int, within: float, *, rigid: bool) -> bool:
    """Whether what joint k carries is where it should be: the next body and line, or, unless `rigid`, all bodies."""
    behind = np.flatnonzero(ours.masses[k:] > 0) + k
    here = ~_moved(ours, theirs, within)[behind]
    following = np.isin(k + 1, _off(ours, theirs, within), invert=True)
    return bool(len(here) and ((here[0] and following) or (here.all() and not rigid)))


def _moved(ours: ReadBack, theirs: ReadBack, within: float) -> NDArray[np.bool_]:
    """Bodies whose centres lie elsewhere, or whose principal axes are turned: then inertias do not commute."""
    one, other = ours.inertias, theirs.inertias
    turned = np.linalg.norm(one @ other - other @ one, axis=(1, 2))
    square = np.linalg.norm(one, axis=(1, 2)) * np.linalg.norm(other, axis=(1, 2))
    away = np.linalg.norm(theirs.centers - ours.centers, axis=1)
    return np.asarray((away > within * size(ours)) | (turned > within * square))


def _line_of(read: ReadBack, other: ReadBack, k: int) -> ReadBack:
    """The record with the line of joint k as in the other one."""
    axes, points = read.axes.copy(), read.points.copy()
    axes[k], points[k] = other.axes[k], other.points[k]
    return dataclasses.replace(read, axes=axes, points=points)


def _offset(read: ReadBack, k: int) -> Array:
    """From the point on the joint before, or the origin of frame 0, to that on joint k."""
    return np.asarray(read.points[k] - (read.points[k - 1] if k else 0.0))


def _unit(ours: ReadBack, theirs: ReadBack, k: int, units: Sequence[float]) -> tuple[float, Array] | None:
    """The unit by which the distance from the joint before is too large, and where joint k lies without it.

    That is on our line, wherever along its line their point on the joint before lies.
    """
    offset = _offset(theirs, k)
    far, right = (float(np.linalg.norm(_offset(read, k))) for read in (theirs, ours))
    along = theirs.axes[k - 1] if k else np.zeros(3)
    v = np.cross(ours.axes[k], along)
    for times in units if right > FITS * size(ours) else ():
        point = theirs.points[k] - (1 - 1 / times) * offset
        missed = np.cross(ours.axes[k], point - ours.points[k])
        slide = -float(missed @ v) / float(v @ v) if v @ v > FITS else 0.0
        if 0.5 < far / times / right < 2 and float(np.linalg.norm(missed + slide * v)) <= NEARLY * right:
            return times, point + slide * along
    return None


def deviations(ours: ReadBack, theirs: ReadBack) -> tuple[Array, Array]:
    """Of every joint's line: the sine of the angle, and the distance [m] of their point from our line."""
    sin = np.linalg.norm(np.cross(ours.axes, theirs.axes), axis=1)
    return sin, np.linalg.norm(np.cross(ours.axes, theirs.points - ours.points), axis=1)


def size(read: ReadBack) -> float:
    """How far the arm reaches at zero angles [m]."""
    return float(max(np.abs(read.points).max(), np.abs(read.centers).max(), np.finfo(float).tiny))


def _off(ours: ReadBack, theirs: ReadBack, within: float) -> Indices:
    """Joints whose lines lie elsewhere."""
    sin, off = deviations(ours, theirs)
    return np.flatnonzero((sin > within) | (off > within * size(ours)))


def _all_times(ours: ReadBack, theirs: ReadBack, within: float, units: Sequence[float]) -> float | None:
    """The unit in which all places of joints are too large, if there is one."""
    if not len(_off(ours, theirs, within)):
        return None
    return next((times for times in units if not len(_off(ours, _stretched(theirs, 1 / times), within))), None)


def _stretched(read: ReadBack, times: float) -> ReadBack:
    """Joints, and what they carry with them, so many times as far from the origin of frame 0."""
    points = times * read.points
    tip = None if read.tip is None else times * read.tip
    return dataclasses.replace(read, points=points, centers=points + read.centers - read.points, tip=tip)


def _motion(ours: ReadBack, theirs: ReadBack, k: int, stop: int | None = None) -> tuple[Array, Array, Array] | None:
    """R and a point with its image, which move our joints and bodies from k on, up to `stop`, to theirs; None: no such.

    R by Kabsch: the rotation nearest to Σ theirs oursᵀ, over axes and, from the point on joint k, all points.
    """
    one, other = _marks(ours, k, stop), _marks(theirs, k, stop)
    L = size(ours)
    p, moved = one[0], other[0]
    a, b = (
        np.concatenate([read.axes[k:stop], (marks - marks[0]) / L]) for read, marks in ((ours, one), (theirs, other))
    )
    U, _, V = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return (R, p, moved) if np.abs(a @ R.T - b).max() <= FITS else None


def _marks(read: ReadBack, k: int, stop: int | None) -> Array:
    """Points that move with joints and bodies from k on: feet, on the axes, of the next centre of mass; centres."""
    following = [_next_massive(read, j) for j in range(read.n)[k:stop]]
    axes = read.axes[k:stop]
    lever = read.centers[following] - read.points[k:stop]
    feet = read.points[k:stop] + axes * np.einsum("ji,ji->j", axes, lever)[:, None]
    return np.concatenate([feet, read.centers[k:stop][read.masses[k:stop] > 0]])


def _next_massive(read: ReadBack, k: int) -> int:
    """The first body from joint k on that has mass; k itself if none has."""
    return int(np.argmax(read.masses[k:] > 0)) + k


def _displaced(read: ReadBack, k: int, R: Array, point: Array, image: Array) -> ReadBack:
    """All from joint k on turned by R and moved so that the point comes to its image."""
    places = (read.axes, read.frames, read.points, read.centers, read.inertias)
    axes, frames, points, centers, inertias = (x.copy() for x in places)
    axes[k:], frames[k:] = axes[k:] @ R.T, R @ frames[k:]
    points[k:], centers[k:] = (image + (x[k:] - point) @ R.T for x in (points, centers))
    inertias[k:] = R @ inertias[k:] @ R.T
    tip = None if read.tip is None else image + R @ (read.tip - point)
    moved: dict[str, Any] = {"axes": axes, "frames": frames, "points": points, "centers": centers, "inertias": inertias}
    return dataclasses.replace(read, **moved, tip=tip)


def _tail(read: ReadBack, other: ReadBack, k: int) -> ReadBack:
    """The record with places from joint k on as in the other one."""
    fields = ("axes", "points", "centers", "inertias")
    behind: dict[str, Any] = {f: np.concatenate([getattr(read, f)[:k], getattr(other, f)[k:]]) for f in fields}
    return dataclasses.replace(read, **behind, tip=other.tip)


def _angle(R: Array) -> float:
    """Of a rotation, also of a small one [rad]."""
    sin = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.arctan2(sin, (np.trace(R) - 1) / 2))
