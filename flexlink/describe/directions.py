"""Directions in a link's frame: the joint's axis, and where the beam runs with its section."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.products import dot
from flexlink.common.types import Array
from flexlink.common.wording import truncated
from flexlink.describe.spec import Vector3


def unit(key: str, vector: Vector3 | Array) -> Array:
    """The direction of a vector, shape (3,); coordinate axes are exact.

    Raises
    ------
    SceneError
        The vector, called `key`, has no direction.
    """
    largest = max(map(abs, vector))
    if largest == 0:
        raise SceneError(f"{key} = {truncated(vector)}: must not be zero; it is a direction", id="zero-direction")
    scaled = np.array(vector) / largest
    direction: Array = scaled / math.hypot(*scaled)
    return direction


class Line(NamedTuple):
    """Where the beam runs in a link's frame.

    `start` [m] is its root, `length` [m] what it measures, `frame` (3, 3) the section's axes: v_link = frame @ v_beam.
    """

    start: Array
    length: float
    frame: Array


def line_of(ends: tuple[Vector3, Vector3], up: Vector3 | None, axis: Array) -> Line:
    """The line from one point to another, and the section's axes along it.

    x runs along the line, z is what of `up` stands across it, y = z × x. Instead of `up` it is by default `axis`, the
    joint's unit vector, so that a beam that bends about z stays in the plane in which the joint turns it; where that
    runs along the line, it is z of the link's frame, or y for a line within 45° of z.

    Raises
    ------
    SceneError
        The line has no length, or one beyond float64, or `up` runs along it.
    """
    start, stop = np.array(ends)
    with np.errstate(over="ignore"):  # refused below
        along = stop - start
    length = math.hypot(*along)
    if not 0 < length < math.inf:
        raise SceneError(
            f"line = {truncated(ends)}: is {length:g} m long; must run from one point to another", id="no-length"
        )
    x = unit("line", along)
    z = _across(x, axis if up is None else unit("up", up))
    if z is None and up is not None:
        raise SceneError(
            f"up = {truncated(up)}: runs along the line; must point across it, as the section's z", id="up-along-line"
        )
    if z is None:
        z = _across(x, np.eye(3)[2 if x[2] ** 2 < 0.5 else 1])
        assert z is not None  # at least 45° between them
    return Line(start, length, np.stack([x, np.cross(z, x), z], axis=1))


def _across(x: Array, direction: Array) -> Array | None:
    """The direction of what of a unit vector stands across x; None if nothing does.

    Taken across twice: where the two nearly line up, the first time leaves eps / angle along x.
    """
    if math.hypot(*np.cross(x, direction)) < 1e-6:  # parallel: files of robots state angles to some ten digits
        return None
    for _ in range(2):
        across = direction - dot(direction, x) * x
        direction = across / math.hypot(*across)
    return direction
