"""Joints that turn have degrees, those that slide have metres: lists of one number per link come in both units.

Such a list has a twin in the other unit (`joint_deg`, `joint_m`). A joint's number stands in the one that fits it, and
the other one has 0 there. Together they are one list in the joints' own units, deg or m, and from there on one in SI.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.common.types import Array

Row = tuple[float, ...]
Slides = tuple[bool, ...]
"""Whether each joint slides, one per link."""

IN_METRES = {
    "joint_deg": "joint_m",
    "rate_deg": "rate_m",
    "target_deg": "target_m",
    "to_deg": "to_m",
    "from_deg": "from_m",
    "max_rate_deg": "max_rate_m",
    "max_acceleration_deg": "max_acceleration_m",
    "max_jerk_deg": "max_jerk_m",
    "angle_deg": "position_m",
    "acceleration_deg": "acceleration_m",
}
"""Keys in degrees, and their twins in metres."""
TWINS = IN_METRES | {m: deg for deg, m in IN_METRES.items()}


def together(slides: Slides, deg: Row | None, m: Row | None) -> Row:
    """One number per link, [deg] of a joint that turns and [m] of one that slides, of two lists; zero without one.

    >>> print(together((False, True), (30.0, 0.0), (0.0, 0.5)), together((False, True), None, (0.0, 0.5)))
    (30.0, 0.5) (0.0, 0.5)
    """
    nothing = (0.0,) * len(slides)
    return tuple(b if s else a for s, a, b in zip(slides, deg or nothing, m or nothing, strict=True))


def in_si(slides: Sequence[bool] | NDArray[np.bool_], own: ArrayLike) -> Array:
    """Numbers in the joints' own units in rad, or m; those of a joint along the last axis."""
    return np.where(slides, own, np.radians(own)) if any(slides) else np.radians(own)


def row_in_si(slides: Slides, own: Row) -> list[float]:
    """The same of one row, as a list: of few numbers a tenth of the time.

    >>> row_in_si((False, True), (180.0, 2.0))
    [3.141592653589793, 2.0]
    """
    return [number if s else math.radians(number) for s, number in zip(slides, own, strict=True)]


def in_own(slides: Sequence[bool] | NDArray[np.bool_], si: ArrayLike) -> Array:
    """Numbers in rad or m in the joints' own units, deg or m; those of a joint along the last axis."""
    return np.where(slides, si, np.degrees(si)) if any(slides) else np.degrees(si)


def misplaced(slides: Slides, names: Sequence[str], lists: Mapping[str, Row]) -> Iterator[tuple[int, str, str]]:
    """What stands in the list of the wrong unit: number of the link, from 0, the key, and what is wrong.

    Of lists by their keys, whose last part may have a number of a row behind it: `reference.angle_deg[3]`.
    """
    for key, row in lists.items():
        name = key.rpartition(".")[2].partition("[")[0]
        for k, number in enumerate(row if name in TWINS else ()):
            if number and slides[k] == (name in IN_METRES):
                twin = key.replace(name, TWINS[name])
                kind = f"prismatic; give {twin}" if slides[k] else f"revolute; give {twin}"
                yield k, key, f"joint {names[k]!r} is {kind}"


def in_words(slides: bool, si: float, form: str = ".6g") -> str:
    """A coordinate as it is told: 30°, 0.5 m.

    >>> print(in_words(False, 0.5), in_words(True, 0.5))
    28.6479° 0.5 m
    """
    return f"{si:{form}} m" if slides else f"{np.degrees(si):{form}}°"


class KindOfJoint(NamedTuple):
    """Its name, its coordinate's own unit and that in SI, the unit of what drives it."""

    name: str
    unit: str
    si: str
    torque: str


OF_JOINT = {False: KindOfJoint("revolute", "deg", "rad", "N m"), True: KindOfJoint("prismatic", "m", "m", "N")}
"""By whether a joint slides."""
