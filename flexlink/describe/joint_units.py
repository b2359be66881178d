"""Lists of one number per link in two units: degrees for revolute joints, metres for prismatic ones.

Such a list has a twin in the other unit (`joint_deg`, `joint_m`). A joint's number is in the list of its unit, and the
other list has 0 in its place. Both lists are merged into one in the joints' own units, deg or m, then converted to SI.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexlink.common.types import Array

Row = tuple[float, ...]
Slides = tuple[bool, ...]  # for each link, whether its joint is prismatic

IN_METRES = {
    "joint_deg": "joint_m", "rate_deg": "rate_m", "target_deg": "target_m", "to_deg": "to_m", "from_deg": "from_m",
    "max_rate_deg": "max_rate_m", "max_acceleration_deg": "max_acceleration_m", "max_jerk_deg": "max_jerk_m",
    "angle_deg": "position_m", "acceleration_deg": "acceleration_m",
}  # fmt: skip
"""Keys in degrees, with their twins in metres."""
TWINS = IN_METRES | {m: deg for deg, m in IN_METRES.items()}


def fits_joint(key: str, kind: str | None) -> bool:
    """Whether a list has numbers of joints of a kind; without a kind, they are revolute."""
    return key not in TWINS or (kind == "prismatic") != (key in IN_METRES)


def together(slides: Slides, deg: Row | None, m: Row | None) -> Row:
    """Merge two lists into one number per link, [deg] for revolute and [m] for prismatic joints; default zero.

    >>> print(together((False, True), (30.0, 0.0), (0.0, 0.5)), together((False, True), None, (0.0, 0.5)))
    (30.0, 0.5) (0.0, 0.5)
    """
    nothing = (0.0,) * len(slides)
    return tuple(b if s else a for s, a, b in zip(slides, deg or nothing, m or nothing, strict=True))


def in_si(slides: Sequence[bool] | NDArray[np.bool_], own: ArrayLike) -> Array:
    """Convert from the joints' own units, deg or m, to rad or m; joints are along the last axis."""
    return np.where(slides, own, np.radians(own)) if any(slides) else np.radians(own)


def in_joint_units(slides: Sequence[bool] | NDArray[np.bool_], si: ArrayLike) -> Array:
    """Convert from rad or m to the joints' own units, deg or m; joints are along the last axis."""
    return np.where(slides, si, np.degrees(si)) if any(slides) else np.degrees(si)


def misplaced(slides: Slides, names: Sequence[str], lists: Mapping[str, Row]) -> Iterator[tuple[int, str, str]]:
    """Find numbers given in the list of the wrong unit; yield the index of the link, the key, and what is wrong.

    `lists` maps keys to lists; the last part of a key may have a row index, as in `reference.angle_deg[3]`.
    """
    for key, row in lists.items():
        name = key.rpartition(".")[2].partition("[")[0]
        for k, number in enumerate(row if name in TWINS else ()):
            if number and slides[k] == (name in IN_METRES):
                twin = key.replace(name, TWINS[name])
                kind = f"prismatic; give {twin}" if slides[k] else f"revolute; give {twin}"
                yield k, key, f"joint {names[k]!r} is {kind}"


def in_words(slides: bool, si: float, form: str = ".6g") -> str:
    """A coordinate as text: 30°, 0.5 m.

    >>> print(in_words(False, 0.5), in_words(True, 0.5))
    28.6479° 0.5 m
    """
    return f"{si:{form}} m" if slides else f"{np.degrees(si):{form}}°"


class KindOfJoint(NamedTuple):
    """Names of a kind of joint, of its coordinate and drive, and of their units, in scenes and in SI; what it does."""

    name: str
    unit: str
    si: str
    torque: str
    place: str
    load: str
    moves: str
    motion: tuple[str, str, str]  # keys of its position, rate and acceleration in a scene


OF_MOTION = "angle_deg", "rate_deg", "acceleration_deg"  # keys of angle, rate and acceleration in a scene
IN_METRES_OF_MOTION = "position_m", "rate_m", "acceleration_m"
OF_JOINT = {
    False: KindOfJoint("revolute", "deg", "rad", "N m", "angle", "torque", "turns", OF_MOTION),
    True: KindOfJoint("prismatic", "m", "m", "N", "position", "force", "slides", IN_METRES_OF_MOTION),
}
"""Kinds of joints, by whether they slide."""
