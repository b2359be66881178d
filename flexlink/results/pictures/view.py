"""Views of an arm: a planar arm is viewed perpendicular to its plane, a spatial arm from the side; gravity points down.

Films show a spatial arm from an oblique direction in parallel projection. Figures show it from the side and from above,
with both axes true to scale.
"""

import math
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array


class View(NamedTuple):
    """Parallel projection, which gives the components of a vector to the right, upwards and towards the eye."""

    axes: Array  # (3, 3), unit vectors in frame 0: right, up, towards the eye
    spatial: bool  # whether the view may be rotated about `vertical`
    vertical: Array  # (3,), opposite to gravity; frame 0

    def __call__(self, vectors: Array) -> Array:
        """Components of vectors (…, 3) in frame 0 to the right, upwards and towards the eye, shape (…, 3)."""
        return np.asarray(vectors @ self.axes.T)

    def flat(self, points: Array) -> Array:
        """Coordinates of points (…, 3) to the right and upwards in the picture [m], shape (2, …)."""
        return np.moveaxis(self(points)[..., :2], -1, 0)

    @property
    def labels(self) -> tuple[str, str]:
        """Labels of the axes that point right and up [m]."""
        right, up = (_axis_name(axis) for axis in self.axes[:2])
        return f"{right or 'across'} [m]", f"{up or 'up'} [m]"


def view_of(chain: Chain) -> View:
    """View of a planar arm perpendicular to its plane of motion; of a spatial arm, obliquely from above."""
    gravity = float(np.linalg.norm(chain.gravity))
    vertical = -chain.gravity / gravity if gravity else np.array([0.0, 0.0, 1.0])
    if "m" not in chain.joint_units and chain.all_axes_parallel_to(chain.axes[0]):  # unlike `is_planar`, also trees
        return View(_across(chain.axes[0], vertical, bool(gravity)), False, vertical)
    first = level(vertical)
    second = np.cross(vertical, first)
    elevation, azimuth = math.radians(22.0), math.radians(-62.0)  # direction of the eye
    sideways = math.cos(azimuth) * first + math.sin(azimuth) * second
    towards = math.cos(elevation) * sideways + math.sin(elevation) * vertical
    right = np.cross(vertical, sideways)
    return View(np.array([right, np.cross(towards, right), towards]), True, vertical)


def views_of(chain: Chain, points: Array) -> list[View]:
    """Views true to scale: for a planar arm its `view_of`; for a spatial arm the wider side view and the top view."""
    view = view_of(chain)
    if not view.spatial:
        return [view]
    vertical = view.vertical
    first = level(vertical)
    second = np.cross(vertical, first)
    extents = np.ptp(points.reshape(-1, 3) @ np.array([first, second]).T, axis=0)
    right = first if extents[0] >= extents[1] else second
    side = np.array([right, vertical, np.cross(right, vertical)])
    return [View(axes, False, vertical) for axes in (side, np.array([first, second, vertical]))]


def view_of_motion(chain: Chain, rest: Array, moved: Array) -> View:
    """The view among `views_of` that shows the motion of points from `rest` to `moved`, both (…, 3), best."""
    return max(views_of(chain, np.stack([rest, moved])), key=lambda view: float(np.abs(view.flat(moved - rest)).sum()))


def _axis_name(direction: Array) -> str:
    """Name of the axis of frame 0 along which a direction points, such as x or −y; empty for any other direction."""
    k = int(np.argmax(np.abs(direction)))
    return "" if abs(direction[k]) < 1 - 1e-6 else f"{'' if direction[k] > 0 else '−'}{'xyz'[k]}"


def _across(normal: Array, vertical: Array, weighs: bool) -> Array:
    """Axes of a view normal to a plane, from above if it is nearly level; without gravity X (else Y) points right."""
    rises, up = float(normal @ vertical), _part_across(vertical, normal)
    lying = 0.7  # cosine between normal and vertical above which a plane is viewed from above
    if abs(rises) > lying and rises < 0:
        normal = -normal
    if not weighs or np.linalg.norm(up) < 1e-3:
        right = level(normal)
        return np.array([right, np.cross(normal, right), normal])
    up = up / np.linalg.norm(up)
    right = np.cross(up, normal)
    if abs(rises) <= lying and right[np.argmax(np.abs(right))] < 0:
        normal, right = -normal, -right
    return np.array([right, up, normal])


def level(vertical: Array) -> Array:
    """Unit vector perpendicular to the vertical that is nearest to X, or else to Y."""
    first = max((_part_across(axis, vertical) for axis in np.eye(3)), key=lambda v: round(float(v @ v), 6))
    return np.asarray(first / np.linalg.norm(first))


def _part_across(vector: Array, direction: Array) -> Array:
    return np.asarray(vector - (vector @ direction) * direction)
