"""Find displaced joint axes: single axes, or frames that are rotated or displaced together with their subtree."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from flexlink.common.products import cross
from flexlink.common.types import Array, Indices, Mask
from flexlink.diagnosis.patterns import TOLERANCE
from flexlink.engines.read_back import ReadBack


class Displacement(NamedTuple):
    """A displaced frame, or a displaced joint axis in a correct frame."""

    joint: int
    angle: float  # [rad]
    offset: float  # [m]
    rigid: bool = True  # whether the subtree moves rigidly; if not, it has further displacements
    axes: tuple[Array, Array] | None = None  # for a single axis: the axis in the file and ours, in the file's frame
    unit_factor: float | None = None  # if due to a wrong unit: distance from the previous joint / correct distance


def undo_displacements(
    ours: ReadBack, theirs: ReadBack, tolerance: float, units: Sequence[float] = ()
) -> tuple[ReadBack, list[Displacement], ReadBack]:
    """Move displaced joints of `theirs` back, one by one from the base outwards, each rigidly with its subtree.

    A single displaced axis is moved alone. `units` are factors by which a wrong unit of length can scale the distance
    between joints. If no rigid motion fits, frames further out are also wrong; our frames then replace them.
    Return `theirs` without its displacements, the displacements, and `ours` with these displacements.
    """
    if (factor := _common_unit(ours, theirs, tolerance, units)) is not None:
        offsets = np.linalg.norm(theirs.points - ours.points, axis=1)
        joints = displaced_joints(ours, theirs, tolerance)
        everywhere = [Displacement(int(k), 0.0, float(offsets[k]), unit_factor=factor) for k in joints]
        return _scaled(theirs, 1 / factor), everywhere, _scaled(ours, factor)
    displacements, ours_displaced = list[Displacement](), ours
    while len(joints := displaced_joints(ours, theirs, tolerance)):
        first, theirs, ours_displaced = _undo_one(ours, theirs, ours_displaced, int(joints[0]), tolerance, units)
        k = first.joint
        if displacements and k <= displacements[-1].joint:  # a motion within `TOLERANCE` may be inexact
            first = first._replace(rigid=False)
        displacements.append(first)
        if not first.rigid:
            return _with_tail_of(theirs, ours, k), displacements, _with_tail_of(ours_displaced, theirs, k)
    return theirs, displacements, ours_displaced


def _undo_one(
    ours: ReadBack, theirs: ReadBack, ours_displaced: ReadBack, k: int, tolerance: float, units: Sequence[float]
) -> tuple[Displacement, ReadBack, ReadBack]:
    """Return the displacement of the first displaced joint k, `theirs` without it, and `ours_displaced` with it."""
    sin, off = (float(part[k]) for part in deviations(ours, theirs))
    angle = float(np.arcsin(min(1.0, sin)))
    before, motion = int(ours.parents[k]), None  # its body may be displaced along or about its axis
    moved_before = np.linalg.norm(theirs.centers[before] - ours.centers[before]) > tolerance * reach(ours)
    if before >= 0 and ours.masses[before] > 0 and moved_before:
        motion = _rigid_motion(ours, theirs, before, tolerance)
    k, motion = (k, _rigid_motion(ours, theirs, k, tolerance)) if motion is None else (before, motion)
    if _only_axis_moved(ours, theirs, k, tolerance, rigid_behind=motion is not None):
        R = theirs.frames[k]
        axis, line = Displacement(k, angle, off, axes=(theirs.axes[k] @ R, ours.axes[k] @ R)), ("axes", "points")
        return axis, _with_rows_of(theirs, ours, k, line), _with_rows_of(ours_displaced, theirs, k, line)
    unit = _unit(ours, theirs, k, units)
    if motion is None and unit is not None:
        motion = np.eye(3), unit[1], theirs.points[k]
    further = _next_massive(ours, k) + 1  # more joints may be displaced
    motion = motion or _rigid_motion(ours, theirs, k, tolerance, further)
    if motion is None:
        return Displacement(k, angle, off, rigid=False), theirs, ours_displaced
    R, point, moved = motion
    offset, angle = float(np.linalg.norm(moved - point)), float(Rotation.from_matrix(R).magnitude())
    frame = Displacement(k, angle, offset, unit_factor=None if unit is None else unit[0])
    return frame, _moved_rigidly(theirs, k, R.T, moved, point), _moved_rigidly(ours_displaced, k, R, point, moved)


def _only_axis_moved(ours: ReadBack, theirs: ReadBack, k: int, tolerance: float, *, rigid_behind: bool) -> bool:
    """Whether joint k's subtree did not move: its next body and axes or, if not `rigid_behind`, all its bodies."""
    joints, one, other = behind(ours, k), ours.inertias, theirs.inertias
    # bodies whose centres of mass are displaced or whose principal axes are rotated (the inertias do not commute)
    square = np.linalg.norm(one, axis=(1, 2)) * np.linalg.norm(other, axis=(1, 2))
    moved = np.linalg.norm(theirs.centers - ours.centers, axis=1) > tolerance * reach(ours)
    moved |= np.linalg.norm(one @ other - other @ one, axis=(1, 2)) > tolerance * square
    here = ~moved[joints[ours.masses[joints] > 0]]
    following = not np.isin(np.flatnonzero(ours.parents == k), displaced_joints(ours, theirs, tolerance)).any()
    return bool(len(here) and ((here[0] and following) or (here.all() and not rigid_behind)))


def behind(read: ReadBack, k: int) -> Indices:
    """Joint k and its subtree."""
    moves = np.zeros(read.n + 1, dtype=bool)  # the last entry represents the base
    moves[k] = True
    for j, before in enumerate(read.parents[k + 1 :].tolist(), k + 1):
        moves[j] = moves[before]
    return np.flatnonzero(moves[:-1])


def _with_rows_of(read: ReadBack, other: ReadBack, rows: int | slice, fields: Sequence[str], **more: Any) -> ReadBack:
    """The record, with rows of fields taken from the other record."""
    for field in fields:
        more[field] = getattr(read, field).copy()
        more[field][rows] = getattr(other, field)[rows]
    return dataclasses.replace(read, **more)


def _offset(read: ReadBack, k: int) -> Array:
    """Vector from the parent joint, or the origin of frame 0, to joint k."""
    before = read.parents[k]
    return np.asarray(read.points[k] - (read.points[before] if before >= 0 else 0.0))


def _unit(ours: ReadBack, theirs: ReadBack, k: int, units: Sequence[float]) -> tuple[float, Array] | None:
    """Unit factor of the distance from the parent joint that puts joint k on our axis, and its place there; or None."""
    tolerance = 1e-3  # relative: numbers may have been rounded manually
    offset = _offset(theirs, k)
    far, right = (float(np.linalg.norm(_offset(read, k))) for read in (theirs, ours))
    before = theirs.parents[k]
    along = theirs.axes[before] if before >= 0 else np.zeros(3)
    v = cross(ours.axes[k], along)
    for factor in units if right > TOLERANCE * reach(ours) else ():
        point = theirs.points[k] - (1 - 1 / factor) * offset
        missed = cross(ours.axes[k], point - ours.points[k])
        slide = -float(missed @ v) / float(v @ v) if v @ v > TOLERANCE else 0.0
        if 0.5 < far / factor / right < 2 and float(np.linalg.norm(missed + slide * v)) <= tolerance * right:
            return factor, point + slide * along
    return None


def deviations(ours: ReadBack, theirs: ReadBack) -> tuple[Array, Array]:
    """Sine of the angle between the axes of each joint, and distance [m] of their point from our axis (slides: 0)."""
    sin = np.linalg.norm(cross(ours.axes, theirs.axes), axis=1)
    off = np.linalg.norm(cross(ours.axes, theirs.points - ours.points), axis=1)
    return sin, np.where(ours.slides | theirs.slides, 0.0, off)


def reach(read: ReadBack) -> float:
    """Largest coordinate of a joint or a centre of mass at zero angles [m]."""
    return float(max(np.abs(read.points).max(), np.abs(read.centers).max(), np.finfo(float).tiny))


def turning(read: ReadBack) -> Mask:
    """Whether each body rotates; inertias of other bodies have no effect."""
    turns = np.append(~read.slides, False)
    for k, before in enumerate(read.parents):
        turns[k] |= turns[before]
    return turns[:-1]


def displaced_joints(ours: ReadBack, theirs: ReadBack, tolerance: float) -> Indices:
    """Joints whose axes differ in direction or position."""
    sin, off = deviations(ours, theirs)
    return np.flatnonzero((sin > tolerance) | (off > tolerance * reach(ours)))


def _common_unit(ours: ReadBack, theirs: ReadBack, tolerance: float, units: Sequence[float]) -> float | None:
    """Factor of a wrong unit that scales all distances between joints; None if there is no such factor."""
    if not len(displaced_joints(ours, theirs, tolerance)):
        return None
    fits = (not len(displaced_joints(ours, _scaled(theirs, 1 / factor), tolerance)) for factor in units)
    return next(itertools.compress(units, fits), None)


def _scaled(read: ReadBack, factor: float) -> ReadBack:
    """The record, with the distances of joints and bodies from the origin of frame 0 scaled by a factor."""
    points = factor * read.points
    tip = None if read.tip is None else factor * read.tip
    return dataclasses.replace(read, points=points, centers=points + read.centers - read.points, tip=tip)


def _rigid_motion(
    ours: ReadBack, theirs: ReadBack, k: int, tolerance: float, stop: int | None = None
) -> tuple[Array, Array, Array] | None:
    """Rigid motion from our subtree of joint k (up to `stop`) to theirs: a rotation R, a point and its image; or None.

    R is the rotation nearest to Σ theirs oursᵀ (Kabsch) over axes and all points relative to joint k. If all points lie
    on one axis, R is the smallest of the possible rotations.
    """
    joints = behind(ours, k)
    joints = joints if stop is None else joints[joints < stop]
    one, other = (_marker_points(read, joints) for read in (ours, theirs))
    L = reach(ours)
    p, moved = one[0], other[0]
    both = (ours, one), (theirs, other)
    a, b = (np.concatenate([read.axes[joints], (points - points[0]) / L]) for read, points in both)
    U, sizes, V = np.linalg.svd(b.T @ a)
    if sizes[1] <= TOLERANCE * sizes[0]:
        v, c = cross(V[0], U[:, 0]), max(float(V[0] @ U[:, 0]), -0.5)  # the unit vectors are not opposite
        X = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
        R = np.asarray(np.eye(3) + X + X @ X / (1 + c))  # 1 + [v]× + [v]×²/(1 + c)
    else:
        R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return (R, p, moved) if np.abs(a @ R.T - b).max() <= max(TOLERANCE, tolerance) else None


def _marker_points(read: ReadBack, joints: Indices) -> Array:
    """Points that move with these joints: centres of mass, and the next one projected onto each axis that turns."""
    following = [_next_massive(read, j) for j in joints]
    axes, points = read.axes[joints], np.where(read.slides[joints, None], read.centers[following], read.points[joints])
    feet = points + axes * np.einsum("ji,ji->j", axes, read.centers[following] - points)[:, None]
    return np.concatenate([feet, read.centers[joints][read.masses[joints] > 0]])


def _next_massive(read: ReadBack, k: int) -> int:
    """First body with mass in the subtree of joint k; k itself if there is none."""
    joints = behind(read, k)
    return int(joints[np.argmax(read.masses[joints] > 0)])


def _moved_rigidly(read: ReadBack, k: int, R: Array, point: Array, image: Array) -> ReadBack:
    """The record with the subtree of joint k rotated by R and moved so the point coincides with its image."""
    fields = ("axes", "frames", "points", "centers", "inertias")
    moved: dict[str, Any] = {field: getattr(read, field).copy() for field in fields}
    at = behind(read, k)
    moved["axes"][at], moved["frames"][at] = read.axes[at] @ R.T, R @ read.frames[at]
    for field in ("points", "centers"):
        moved[field][at] = image + (moved[field][at] - point) @ R.T
    moved["inertias"][at] = R @ read.inertias[at] @ R.T
    on = read.n - 1 if read.tip_on is None else read.tip_on
    if read.tip is not None and on in at:
        moved["tip"] = image + R @ (read.tip - point)
    return dataclasses.replace(read, **moved)


def _with_tail_of(read: ReadBack, other: ReadBack, k: int) -> ReadBack:
    """The record, with positions and orientations in the subtree of joint k taken from the other record."""
    return _with_rows_of(read, other, slice(k, None), ("axes", "points", "centers", "inertias"), tip=other.tip)
