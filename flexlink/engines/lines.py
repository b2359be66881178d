"""Joint axes that lie elsewhere: frames that are turned or displaced, with all that hangs on them."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.engines.read_back import ReadBack

Array = NDArray[np.float64]

FITS = 1e-9
"""How well one rigid motion must put back all that follows a joint, relative to the arm's size."""


class Place(NamedTuple):
    """A frame placed elsewhere."""

    joint: int
    angle: float  # [rad]
    offset: float  # [m]
    alone: bool  # whether all behind it follows it rigidly; if not, that stands elsewhere by itself, too


class Placed(NamedTuple):
    """Their record after what was placed elsewhere was put back, and ours placed like theirs."""

    theirs: ReadBack
    places: list[Place]
    ours: ReadBack


def put_back(ours: ReadBack, theirs: ReadBack, within: float) -> Placed:
    """Put their joints back, from the base on: each time the first that is off, with all that follows it, rigidly.

    Where no rigid motion does it, frames beyond are wrong, too: it ends there, and they are taken as ours.
    """
    places, like_theirs = list[Place](), ours
    while (k := _first_off(ours, theirs, within)) is not None:
        again = bool(places) and k <= places[-1].joint  # what fits within `FITS` may still be off
        fitted = None if again else _motion(ours, theirs, k)
        if fitted is None:
            sin, off = (float(part[k]) for part in deviations(ours, theirs))
            places.append(Place(k, float(np.arcsin(min(1.0, sin))), off, alone=False))
            return Placed(_tail(theirs, ours, k), places, _tail(like_theirs, theirs, k))
        R, point, moved = fitted
        places.append(Place(k, _angle(R), float(np.linalg.norm(moved - point)), alone=True))
        theirs = _displaced(theirs, k, R.T, moved, point)
        like_theirs = _displaced(like_theirs, k, R, point, moved)
    return Placed(theirs, places, like_theirs)


def deviations(ours: ReadBack, theirs: ReadBack) -> tuple[Array, Array]:
    """Of every joint's line: the sine of the angle, and the distance [m] of their point from our line."""
    sin = np.linalg.norm(np.cross(ours.axes, theirs.axes), axis=1)
    return sin, np.linalg.norm(np.cross(ours.axes, theirs.points - ours.points), axis=1)


def size(read: ReadBack) -> float:
    """How far the arm reaches at zero angles [m]."""
    return float(max(np.abs(read.points).max(), np.abs(read.centers).max(), np.finfo(float).tiny))


def _first_off(ours: ReadBack, theirs: ReadBack, within: float) -> int | None:
    sin, off = deviations(ours, theirs)
    bad = np.flatnonzero((sin > within) | (off > within * size(ours)))
    return int(bad[0]) if len(bad) else None


def _motion(ours: ReadBack, theirs: ReadBack, k: int) -> tuple[Array, Array, Array] | None:
    """R and a point with its image, which move our joints and bodies from k on to theirs; None if nothing rigid does.

    R by Kabsch: the rotation nearest to Σ theirs oursᵀ, over axes and, from the point on joint k, all points.
    """
    one, other = _marks(ours, k), _marks(theirs, k)
    L = size(ours)
    p, moved = one[0], other[0]
    a, b = (np.concatenate([read.axes[k:], (marks - marks[0]) / L]) for read, marks in ((ours, one), (theirs, other)))
    U, _, V = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return (R, p, moved) if np.abs(a @ R.T - b).max() <= FITS else None


def _marks(read: ReadBack, k: int) -> Array:
    """Points that move with joints and bodies from k on: feet, on the axes, of the next centre of mass; centres."""
    massive = read.masses > 0
    following = [int(np.argmax(massive[j:])) + j for j in range(k, read.n)]
    lever = read.centers[following] - read.points[k:]
    axes = read.axes[k:]
    feet = read.points[k:] + axes * np.einsum("ji,ji->j", axes, lever)[:, None]
    return np.concatenate([feet, read.centers[k:][massive[k:]]])


def _displaced(read: ReadBack, k: int, R: Array, point: Array, image: Array) -> ReadBack:
    """All from joint k on turned by R and moved so that the point comes to its image."""
    axes, points, centers, inertias = (x.copy() for x in (read.axes, read.points, read.centers, read.inertias))
    axes[k:] = axes[k:] @ R.T
    points[k:], centers[k:] = (image + (x[k:] - point) @ R.T for x in (points, centers))
    inertias[k:] = R @ inertias[k:] @ R.T
    tip = None if read.tip is None else image + R @ (read.tip - point)
    return dataclasses.replace(read, axes=axes, points=points, centers=centers, inertias=inertias, tip=tip)


def _tail(read: ReadBack, other: ReadBack, k: int) -> ReadBack:
    """The record with places from joint k on as in the other one."""
    fields = ("axes", "points", "centers", "inertias")
    behind: dict[str, Any] = {f: np.concatenate([getattr(read, f)[:k], getattr(other, f)[k:]]) for f in fields}
    return dataclasses.replace(read, **behind, tip=other.tip)


def _angle(R: Array) -> float:
    """Of a rotation, also of a small one [rad]."""
    sin = np.linalg.norm([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / 2
    return float(np.arctan2(sin, (np.trace(R) - 1) / 2))
