"""Find joints with no inertia attached, which would make M singular; without named tips, an import makes them rigid."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from flexlink.common.errors import DataFileError
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
    """Return the moving parts of a robot, and the joints that are fixed because nothing beyond them has inertia.

    `rotors` are the joints with an armature. The other parameters are as in `paths`; `tip` None means all ends.

    Raises
    ------
    ArgumentError
        As in `paths`.
    DataFileError
        A joint on the path to a named tip has no inertia attached, all joints have none, or no link has inertia.
    """
    still: dict[str, None] = {}
    while True:
        found = paths(robot, base, tip, posture, locked, free_base=free_base, still=still)
        lifeless = _lifeless(found, rotors)
        if not lifeless:
            return found, tuple(still)
        if tip is not None or len(lifeless) == len(found.parts):
            if not any(body.mass or body.inertia.any() for body in robot.links.values()):
                raise DataFileError("no link of this file has mass; give the moving links an <inertial>", id="no-mass")
            part = lifeless[-1]
            hint = f", for example --tip {part.joint.parent}" if part.parent else ""
            raise DataFileError(
                f"link {truncated(part.link)}: nothing beyond its joint has inertia; choose a tip before it{hint}",
                id="no-mass",
            )
        still |= {part.joint.name: None for part in lifeless}


def _lifeless(way: Paths, rotors: Collection[str]) -> list[Part]:
    """Return the parts that have no inertia about their joint, and whose children have no inertia."""
    alive = [False] * (len(way.parts) + 1)  # also True for the parent of a body with inertia, whatever its axis
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
    """Return the mass [kg] of a part with a sliding joint, or the inertia [kg m²] of a part about its hinge."""
    body = payload(part.body)
    return body.about(part.joint.axis) if part.joint.turns else body.mass
