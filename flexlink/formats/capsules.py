"""Draw a chain as capsules without mass or contact: one along each rigid segment, coloured by link.

A chain has no cross-sections. A capsule gets the radius of a solid cylinder that has the segment's inertia about its
axis, r = √(2 I / m), limited to a visible fraction of the arm's length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.chain.coordinates import unique
from flexlink.common.products import dot, product
from flexlink.common.types import Array
from flexlink.formats.document import decimals, valid

THICKNESS = 0.004, 0.04  # smallest and largest radius as fractions of the arm's length
COLOURS = (
    (0.00, 0.45, 0.70), (0.90, 0.62, 0.00), (0.00, 0.62, 0.45), (0.80, 0.47, 0.65),
    (0.34, 0.71, 0.91), (0.84, 0.37, 0.00), (0.94, 0.89, 0.26), (0.45, 0.45, 0.45),
)  # fmt: skip
"""Colour-blind-safe palette of Okabe and Ito; the links use its colours in turn."""


class Capsule(NamedTuple):
    """A capsule from the origin of a body to the origin of the next body."""

    end: Array  # far end in the body's frame [m]
    radius: float  # [m]
    colour: tuple[str, str]  # name of the colour; red, green, blue and opacity

    @property
    def length(self) -> float:
        """Distance between the centres of the two end caps [m]."""
        return math.sqrt(dot(self.end, self.end))

    @property
    def pose(self) -> tuple[float, ...]:
        """Pose (x, y, z, roll, pitch, yaw) of the capsule's midpoint, with local Z along the capsule."""
        x, y, z = map(float, self.end)
        return x / 2, y / 2, z / 2, 0.0, math.atan2(math.hypot(x, y), z), math.atan2(y, x)


def capsules(chain: Chain) -> Iterator[Capsule | None]:
    """Yield, for every body attached to another, the capsule from parent to body; None if their origins coincide."""
    of_link = colours(chain)
    hanging = chain.bodies[chain.bodies["parent"] > 0]
    ends = hanging["translation"]
    lengths = np.linalg.norm(ends, axis=1)
    shortest, thinnest, thickest = (share * float(lengths.sum()) for share in (1e-9, *THICKNESS))
    for body, end, length in zip(chain.bodies[hanging["parent"] - 1], ends, lengths, strict=True):
        if length <= shortest:  # the length is only a rounding error; MuJoCo refuses such capsules
            yield None
            continue
        along = dot(end, product(body["inertia"], end)) / length**2
        radius = math.sqrt(2 * along / body["mass"]) if body["mass"] > 0 else 0.0
        yield Capsule(end, min(max(radius, thinnest), thickest), of_link[chain.coordinates[body["first"]].link - 1])


def capsules_behind(chain: Chain) -> dict[int, list[Capsule]]:
    """Return the capsules of each joint; a body's capsules belong to its last hinge."""
    parents = chain.bodies["parent"][chain.bodies["parent"] > 0]
    found = dict[int, list[Capsule]]()
    for k, capsule in zip((chain.bodies["stop"][parents - 1] - 1).tolist(), capsules(chain), strict=True):
        if capsule is not None:
            found.setdefault(k, []).append(capsule)
    return found


def colours(chain: Chain) -> list[tuple[str, str]]:
    """Return for every link its name, and red, green, blue and opacity."""
    names = unique(map(valid, chain.link_names))
    return [(name, decimals([*COLOURS[number % len(COLOURS)], 1.0])) for number, name in enumerate(names)]
