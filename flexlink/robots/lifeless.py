"""Joints beyond which nothing has inertia: M would be singular. Of a whole robot they stay where they are."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence

from flexlink.common.errors import DataFileError, SceneError
from flexlink.common.wording import truncated
from flexlink.robots.flexible import payload
from flexlink.robots.kinematic_tree import Robot
from flexlink.robots.paths import Part, Paths, paths


def living_paths(
    robot: Robot,
    base: str | None,
    tip: str | Sequence[str] | None,
    posture: Mapping[str, float],
    locked: Mapping[str, float],
    *,
    free_base: bool,
    rotors: Collection[str],
) -> tuple[Paths, tuple[str, ...]]:
    """What moves of a robot, and the joints that stay because nothing beyond them has inertia.

    `rotors` are the joints that have an armature; the others as in `paths`, where `tip` None is the whole robot.

    Raises
    ------
    ArgumentError
        As in `paths`.
    DataFileError
        Nothing has inertia that a joint on the way to a tip that is named moves, or any joint at all; or no link has.
    """
    still: dict[str, None] = {}
    while True:
        found = paths(robot, base, tip, posture, locked, free_base=free_base, still=still)
        lifeless = _lifeless(found, rotors)
        if not lifeless:
            return found, tuple(still)
        if tip is not None or len(lifeless) == len(found.parts):
            if not any(body.mass or body.inertia.any() for body in robot.links.values()):
                raise DataFileError(
                    "no link of this file has mass; give the links that move their <inertial>", id="no-mass"
                )
            part = lifeless[-1]
            hint = f", as by --tip {part.joint.parent}" if part.parent else ""
            raise DataFileError(
                f"link {truncated(part.link)}: nothing beyond its joint has inertia; choose a tip before it{hint}",
                id="no-mass",
            )
        still |= {part.joint.name: None for part in lifeless}


def _lifeless(way: Paths, rotors: Collection[str]) -> list[Part]:
    """Parts without inertia about their joint on which nothing hangs but others without any."""
    alive = [False] * (len(way.parts) + 1)  # or carries something, which may move about another axis
    found = []
    for number in range(len(way.parts), 0, -1):
        part = way.parts[number - 1]
        if part.joint.name in rotors or alive[number] or _moved(part):
            alive[number] = alive[part.parent] = True
        else:
            found.append(part)
            alive[part.parent] |= part.body.mass > 0 or bool(part.body.inertia.any())
    return found[::-1]


def _moved(part: Part) -> float:
    """Mass [kg] that a slide moves, inertia [kg m²] about a hinge."""
    try:
        body = payload(part.body)
    except SceneError:  # which is told when it becomes a link
        return math.inf
    return body.about(part.joint.axis) if part.joint.turns else body.mass
