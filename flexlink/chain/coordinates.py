"""Three-index coordinates of joints, and joint names derived from them."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from typing import NamedTuple

from flexlink.chain import free_base
from flexlink.describe.arm import BASE

ROOT = 4
"""Axis in a `Coordinate` for the root spring about X; the next two are for the springs about Y and Z."""
LAG = ROOT + 3
"""Axis in a `Coordinate` for the internal coordinate of a joint's lagging friction."""
STRETCH = LAG + 1
"""Axis in a `Coordinate` for the slide of a beam along X; the next two are for slides along Y and Z."""


class Coordinate(NamedTuple):
    """The paper's three indices: link from 1, segment from 0, and axis (0 active joint, 1 twist, 2 and 3 bending).

    (link, 0, 3) is the hinge of an elastic gear, about the joint's axis; (link, 0, 4) … (link, 0, 6) are the hinges of
    root springs about X, Y, Z; (link, 0, 7) is an internal coordinate, whose rate is the state of the joint's lagging
    friction; (link, segment, 8) … (link, segment, 10) are the slides of a beam that stretches along X and shears along
    Y and Z. (0, 0, 1) … (0, 0, 6) are the joints of a free base: three along X, Y, Z and three about them.
    """

    link: int
    segment: int
    axis: int

    @property
    def of_base(self) -> bool:
        """Whether the coordinate belongs to a floating base."""
        return self.link == 0

    @property
    def of_root(self) -> bool:
        """Whether the coordinate is a hinge of a link's root spring."""
        return self.link > 0 and ROOT <= self.axis < LAG

    @property
    def bends(self) -> bool:
        """Whether the coordinate is the angle of a hinge within a beam, bending or twist."""
        return self.segment > 0 and self.axis < STRETCH

    @property
    def strains(self) -> bool:
        """Whether the coordinate is a slide within a beam, stretch or shear."""
        return self.axis >= STRETCH


@functools.lru_cache(maxsize=64)
def joint_names(
    links: tuple[str, ...], coordinates: tuple[Coordinate, ...], joints: tuple[str, ...]
) -> tuple[str, ...]:
    """Unique readable names of joints from their coordinates, in the same order; driven joints keep theirs."""
    driven = unique(joints[c.link - 1] for c in coordinates if c.axis == 0)
    known = list(dict.fromkeys([*driven, *joints]))  # locked joints keep their names, unless a driven joint has it
    hinges = (f"{links[c.link - 1] if c.link else BASE}.{_hinge_name(c)}" for c in coordinates if c.axis)
    others, names = iter(unique([*known, *hinges])[len(known) :]), iter(driven)
    return tuple(next(others if c.axis else names) for c in coordinates)


def _hinge_name(coordinate: Coordinate) -> str:
    """Name of a hinge within its link, or within a free base."""
    link, segment, axis = coordinate
    if link == 0:
        return free_base.NAMES[axis - 1]
    if axis == LAG:
        return "lag"
    if axis >= STRETCH:
        return f"{segment}.{('stretch', 'shear.y', 'shear.z')[axis - STRETCH]}"
    if axis >= ROOT:
        return f"root.{'xyz'[axis - ROOT]}"
    return "gear" if axis and not segment else f"{segment}.{' xyz'[axis]}"


def unique(names: Iterable[str]) -> list[str]:
    """Return the names with a number appended to repeated ones."""
    taken: dict[str, None] = {}
    for name in names:
        candidate, number = name, 2
        while candidate in taken:
            candidate, number = f"{name}_{number}", number + 1
        taken[candidate] = None
    return list(taken)
