"""Directions in a link's frame: the joint axis, the beam axis and the axes of its section."""

import math
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.products import cross, dot
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.spec import Vector3


def unit(key: str, vector: Vector3 | Array) -> Array:
    """Return the unit vector along a vector, shape (3,), without rounding errors along a coordinate axis."""
    largest = max(map(abs, vector))
    if largest == 0:
        raise SceneError(f"{key} = {truncated(vector)}: a direction must not be zero", id="zero-direction")
    scaled = np.array(vector) / largest
    direction: Array = scaled / math.hypot(*scaled)
    return direction


class Line(NamedTuple):
    """Position and axes of the beam in a link's frame."""

    start: Array  # the beam's root [m]
    length: float  # [m]
    frame: Array  # (3, 3), rotates from the section's axes to the link's: v_link = frame @ v_beam


def line_of(ends: tuple[Vector3, Vector3], up: Vector3 | None, axis: Array) -> Line:
    """Return the line from one point to another, with the section's axes.

    x points along the line, z is the component of `up` perpendicular to it, y = z × x. The default of `up` is `axis`,
    the joint's unit vector, so a beam that bends about z stays in the plane of the joint's rotation. If the axis is
    parallel to the line, `up` is z of the link's frame, or y for a line within 45° of z.
    """
    start, stop = np.array(ends)
    with np.errstate(over="ignore"):  # overflow is checked below
        along = stop - start
    length = math.hypot(*along)
    if not 0 < length < math.inf:
        why = f"line = {truncated(ends)}: has length {length:g} m; must be positive and finite"
        raise SceneError(why, id="no-length")
    x = unit("line", along)
    z = _across(x, axis if up is None else unit("up", up))
    if z is None and up is not None:
        text = f"up = {truncated(up)}: is parallel to the line; must point across it, along the section's z"
        raise SceneError(text, id="up-along-line")
    if z is None:
        z = _across(x, np.eye(3)[2 if x[2] ** 2 < 0.5 else 1])
        assert z is not None  # x is at least 45° from this axis, so z exists
    return Line(start, length, np.array([x, cross(z, x), z]).T.copy())


def _across(x: Array, direction: Array) -> Array | None:
    """Unit vector along the component of `direction` perpendicular to x; None if `direction` is parallel to x.

    `direction` is projected twice: if it is nearly parallel to x, an error of eps / angle along x remains at first.
    """
    if math.hypot(*cross(x, direction)) < 1e-6:  # counts as parallel; robot files round angles to ten digits
        return None
    for _ in range(2):
        across = direction - dot(direction, x) * x
        direction = across / math.hypot(*across)
    return direction
