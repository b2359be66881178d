"""Three-index coordinates of joints, and joint names derived from them."""

import enum
import functools
from collections.abc import Iterable
from typing import NamedTuple

from flexlink.describe.arm import BASE
from flexlink.kernels.layout import SLIDES

BASE_NAMES = "x", "y", "z", "rx", "ry", "rz"
"""Names of the joints of a floating base, which are the first of the chain."""
BASE_AXES = (*range(SLIDES, SLIDES + 3), *range(3))
"""Axes along or about which these joints move, as in dtype `HINGE`: along X, Y, Z of frame 0, then about X, Y, Z."""
BASE_JOINTS = len(BASE_NAMES)
"""Number of these joints."""


class Kind(enum.Enum):
    """Kinds of coordinates, with all that other code asks of them; a new kind is one more row.

    `first` is the axis of its first coordinate; `names` are its coordinates within their link or base, with {} for the
    segment ("": the joint's own name); `place` is "base", "joint" or "beam"; `springs` are the motions that their
    springs resist, in words; `panel` of plots shows them; with `own_body` they move another body than other kinds at
    their place; if not `moves`, they move no body, and files of other programs lack them.
    """

    BASE = 1, BASE_NAMES, "base"
    JOINT = 0, ("",), "joint", (), "joints"
    GEAR = 3, ("gear",), "joint", ("gear",), "springs"
    ROOT = 4, ("root.x", "root.y", "root.z"), "joint", ("root", "root", "root"), "springs", True
    LAG = 7, ("lag",), "joint", (), "", False, False  # state of lagging friction
    HINGE = 1, ("{}.x", "{}.y", "{}.z"), "beam", ("torsion", "bending", "bending"), "springs"
    STRAIN = 8, ("{}.stretch", "{}.shear.y", "{}.shear.z"), "beam", ("stretch", "shear", "shear"), "springs", True

    def __init__(
        self, first: int, names: tuple[str, ...], place: str, springs: tuple[str, ...] = (), panel: str = "",
        own_body: bool = False, moves: bool = True,
    ) -> None:  # fmt: skip
        self.first, self.names, self.place, self.springs = first, names, place, springs
        self.panel, self.own_body, self.moves = panel, own_body, moves

    def at(self, link: int, segment: int = 0, axis: int = 0) -> "Coordinate":
        """Its coordinate of a link, counted from 1, at a segment; `axis`: place in `names`."""
        return Coordinate(link, segment, self.first + axis)


KINDS = {(kind.place, kind.first + k): kind for kind in Kind for k in range(len(kind.names))}
"""Kind of a coordinate, by its place and axis."""
SPRINGS = tuple(kind for kind in Kind if kind.springs)
"""Kinds of coordinates with springs."""


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
    def known(self) -> Kind | None:
        """Kind of the coordinate, None if there is none with these indices."""
        link, segment, axis = self
        return KINDS.get(("base" if not link else "beam" if segment else "joint", axis))

    @property
    def kind(self) -> Kind:
        """Kind of a coordinate of a chain."""
        kind = self.known
        assert kind is not None
        return kind

    @property
    def body(self) -> tuple[int, int, str]:
        """Key of the body that the coordinate moves, together with other coordinates of the same key."""
        return self.link, self.segment, self.kind.name if self.kind.own_body else ""

    @property
    def spring(self) -> str:
        """In words, the motion that its spring resists."""
        return self.kind.springs[self.axis - self.kind.first]

    @property
    def name(self) -> str:
        """Name within its link or base; "" for the joint."""
        return self.kind.names[self.axis - self.kind.first].format(self.segment)


@functools.lru_cache(maxsize=64)
def joint_names(
    links: tuple[str, ...], coordinates: tuple[Coordinate, ...], joints: tuple[str, ...]
) -> tuple[str, ...]:
    """Unique readable names of joints from their coordinates, in the same order; driven joints keep theirs."""
    driven = unique(joints[c.link - 1] for c in coordinates if c.kind is Kind.JOINT)
    known = list(dict.fromkeys([*driven, *joints]))  # locked joints keep their names, unless a driven joint has it
    hinges = (f"{links[c.link - 1] if c.link else BASE}.{c.name}" for c in coordinates if c.axis)
    others, names = iter(unique([*known, *hinges])[len(known) :]), iter(driven)
    return tuple(next(others if c.axis else names) for c in coordinates)


def unique(names: Iterable[str]) -> list[str]:
    """Return the names with a number appended to repeated ones."""
    taken: dict[str, None] = {}
    for name in names:
        candidate, number = name, 2
        while candidate in taken:
            candidate, number = f"{name}_{number}", number + 1
        taken[candidate] = None
    return list(taken)
