"""Views of an arm: a planar one perpendicular to its plane, a spatial one from the side; gravity points down.

Films show a spatial arm obliquely in parallel projection. Figures show it from the side and from above, true to scale
along both axes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array


class View(NamedTuple):
    """Parallel projection: components of a vector to the right, upwards and towards the eye."""

    axes: Array  # (3, 3), rows right, up, towards the eye; frame 0
    spatial: bool  # whether the view may be rotated about `vertical`
    vertical: Array  # (3,), against gravity; frame 0

    def __call__(self, vectors: Array) -> Array:
        """Right, up and depth of vectors of frame 0, shape (…, 3)."""
        return np.asarray(vectors @ self.axes.T)

    def flat(self, points: Array) -> Array:
        """Coordinates in the picture [m] of points (…, 3): shape (2, …), right and up."""
        return np.moveaxis(self(points)[..., :2], -1, 0)

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of the axes that point right and up [m]."""
        right, up = (_axis_name(axis) for axis in self.axes[:2])
        return f"{right or 'across'} [m]", f"{up or 'up'} [m]"


def view_of(chain: Chain) -> View:
    """View perpendicular to the plane of motion, or, for a spatial arm, from the side and above."""
    gravity = float(np.linalg.norm(chain.gravity))
    vertical = -chain.gravity / gravity if gravity else np.array([0.0, 0.0, 1.0])
    if chain.is_planar:
        return View(_across(chain.axes[0], vertical, bool(gravity)), False, vertical)
    first = _level(vertical)
    second = np.cross(vertical, first)
    elevation, azimuth = math.radians(22.0), math.radians(-62.0)  # of the eye, above the horizon and about the vertical
    sideways = math.cos(azimuth) * first + math.sin(azimuth) * second
    towards = math.cos(elevation) * sideways + math.sin(elevation) * vertical
    right = np.cross(vertical, sideways)
    return View(np.array([right, np.cross(towards, right), towards]), True, vertical)


def views_of(chain: Chain, points: Array) -> list[View]:
    """Views that are true to scale: `view_of` a planar arm; else the side view that shows more, and the top view."""
    view = view_of(chain)
    if not view.spatial:
        return [view]
    vertical = view.vertical
    first = _level(vertical)
    second = np.cross(vertical, first)
    extents = np.ptp(points.reshape(-1, 3) @ np.array([first, second]).T, axis=0)
    right = first if extents[0] >= extents[1] else second
    side = np.array([right, vertical, np.cross(right, vertical)])
    return [View(axes, False, vertical) for axes in (side, np.array([first, second, vertical]))]


def view_of_motion(chain: Chain, rest: Array, moved: Array) -> View:
    """The one of `views_of` that shows most of the motion of points from `rest` to `moved`, both (…, 3)."""
    return max(views_of(chain, np.stack([rest, moved])), key=lambda view: float(np.abs(view.flat(moved - rest)).sum()))


def _axis_name(direction: Array) -> str:
    """x, −y, …: the axis of frame 0 along which a direction points; empty for any other."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) < 1 - 1e-6:
        return ""
    return f"{'' if direction[k] > 0 else '−'}{'xyz'[k]}"


def _across(normal: Array, vertical: Array, weighs: bool) -> Array:
    """Axes of a view normal to a plane: gravity down, else X right, or Y; a nearly level plane is seen from above."""
    rises, up = float(normal @ vertical), _part_across(vertical, normal)
    lying = 0.7  # cosine between normal and vertical above which a plane is seen from above
    if abs(rises) > lying and rises < 0:
        normal = -normal
    if not weighs or np.linalg.norm(up) < 1e-3:
        right = _level(normal)
        return np.array([right, np.cross(normal, right), normal])
    up = up / np.linalg.norm(up)
    right = np.cross(up, normal)
    if abs(rises) <= lying and right[np.argmax(np.abs(right))] < 0:
        normal, right = -normal, -right
    return np.array([right, up, normal])


def _level(vertical: Array) -> Array:
    """Unit vector perpendicular to the vertical that is nearest to X, or else to Y."""
    first = max((_part_across(axis, vertical) for axis in np.eye(3)), key=lambda v: round(float(v @ v), 6))
    return np.asarray(first / np.linalg.norm(first))


def _part_across(vector: Array, direction: Array) -> Array:
    return np.asarray(vector - (vector @ direction) * direction)
