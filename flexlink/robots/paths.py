"""Paths through a robot from a link to its tips; everything else is rigidly attached to these paths or to the base."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from flexlink.chain.arguments import require_one_of
from flexlink.chain.rigid import HERE, Pose, SpatialInertia
from flexlink.common.errors import ArgumentError
from flexlink.common.wording import short_list, truncated
from flexlink.robots.kinematic_tree import Mimic, Robot, TreeJoint, check_stated, positions_of


@dataclasses.dataclass(frozen=True)
class Part:
    """The bodies that move with one free joint: its child link and everything rigidly attached to that link."""

    joint: TreeJoint
    link: str
    parent: int  # number of the parent part, from 1; 0 for the base
    origin: Pose  # frame of `link` at position 0, in the parent part's frame; that of a fixed base is the root's
    body: SpatialInertia  # in the frame of `link`
    folded: tuple[str, ...]  # names of the other links of the part


class Tip(NamedTuple):
    """A link where a path ends: the number of its part, from 1, and the link's frame in the frame of this part."""

    link: str
    part: int
    place: Pose


@dataclasses.dataclass(frozen=True)
class Paths:
    """The moving parts of a robot from the base outward, path by path, and the tips."""

    base: str
    tips: tuple[Tip, ...]
    parts: tuple[Part, ...]
    positions: Mapping[str, float]  # of all joints of the robot [rad, m]
    held: tuple[str, ...]  # movable joints that are fixed and affect the arm: before the base, or within one part
    # of a floating base: the frame of its link in the root's frame, its body, and the links that are part of it
    free_base: tuple[Pose, SpatialInertia, tuple[str, ...]] | None = None
    followers: Mapping[str, Mimic] = dataclasses.field(default_factory=dict)  # joints of parts that follow another part

    def tips_on(self, number: int) -> list[tuple[int, Tip]]:
        """Return the tips of a part, by its number from 1, each with the tip's number from 0."""
        return [(k, tip) for k, tip in enumerate(self.tips) if tip.part == number]

    def bears(self, number: int) -> int:
        """Number of parts and tips attached to a part."""
        return sum(part.parent == number for part in self.parts) + len(self.tips_on(number))

    def beyond(self) -> list[Pose]:
        """For each part, return the frame of the next joint or, if there is none, of the tip; a beam ends there.

        If a part has several child joints, the joint with the most joints beyond it is used.
        """
        joints = [1] * (len(self.parts) + 1)
        for number in range(len(self.parts), 0, -1):
            joints[self.parts[number - 1].parent] += joints[number]
        nexts: list[int] = [0] * (len(self.parts) + 1)
        for number, part in enumerate(self.parts, 1):
            if not nexts[part.parent] or joints[number] > joints[nexts[part.parent]]:
                nexts[part.parent] = number
        places = {tip.part: tip.place for tip in reversed(self.tips)}
        return [self.parts[after - 1].origin if after else places[k] for k, after in enumerate(nexts[1:], 1)]


def paths(
    robot: Robot, base: str | None, tip: str | Sequence[str] | None, posture: Mapping[str, float],
    locked: Mapping[str, float], *, free_base: bool = False, still: Collection[str] = (),
) -> Paths:  # fmt: skip
    """Find the moving parts of a robot; arguments are as in `import_urdf`, `still` names other fixed joints.

    With a tip, the joints on the path to it move; without one, all joints beyond the base except mimicking joints. The
    position of a joint that follows one of them begins at the offset of its rule.
    """
    base = robot.root if base is None else _link(robot, "base", base)
    check_stated(robot, posture, locked)
    tips: list[str] | None = None
    if tip is not None:
        several = isinstance(tip, Sequence) and not isinstance(tip, str)
        tips = list(dict.fromkeys(_link(robot, "tip", name) for name in (tip if several else [tip])))
        if not tips:
            why = f"tip = {tip!r}: name a link, or leave it out for the complete robot"
            raise ArgumentError(why, id="unknown-link")
    way = _way(robot, base, tips)
    span = f"beyond {base!r}" if tips is None else f"between {base!r} and {short_list([repr(name) for name in tips])}"
    for name in locked:
        if robot.joints[name] not in way:
            why = f"locked: joint {truncated(name)} is not {span}; put it into posture"
            raise ArgumentError(why, id="unknown-joint")
    loose = [joint for joint in way if joint.moves and joint.name not in locked and joint.name not in still]
    free = {joint.name: None for joint in loose if joint.mimic is None}
    rules = {joint.name: robot.rule(joint, locked) for joint in loose if joint.mimic is not None and tips is not None}
    followers = {name: rule for name, rule in rules.items() if rule.leader in free and rule.multiplier}
    for joint in loose:
        if joint.name not in followers and (joint.mimic is None or tips is not None):
            _check_fit(joint, span)
    free |= dict.fromkeys(followers)
    ways = {span: way} if tips is None else {f"between {base!r} and {end!r}": robot.path(base, end) for end in tips}
    for where, one in ways.items():
        if not any(joint.name in free for joint in one or []):
            raise ArgumentError(f"no movable joint {where}; the arm needs at least one", id="no-movable-joint")
    positions = positions_of(robot, {**posture, **locked})
    place = along(robot.path(robot.root, base) or [], positions)
    for k, joint in enumerate(way):
        if joint.name in followers:
            positions[joint.name] -= (offset := followers[joint.name].offset)  # from which positions are measured
            limits = joint.limits and (joint.limits[0] - offset, joint.limits[1] - offset)
            way[k] = dataclasses.replace(joint, origin=joint.pose(offset), limits=limits)
    parts, places = _parts(robot, way, free, positions, {base: (0, HERE if free_base else place)})
    stems, moving = {part.parent for part in parts}, {joint.name for joint in loose}
    ends = tips or [robot.outward(part.link, moving)[-1] for k, part in enumerate(parts, 1) if k not in stems]
    floating = (place, *folded(robot, base, free, positions)) if free_base else None
    found = Paths(base, tuple(Tip(end, *places[end]) for end in ends), parts, positions, (), floating, followers)
    return dataclasses.replace(found, held=_held(robot, found))


def _link(robot: Robot, key: str, name: object) -> str:
    """Check that a link has this name."""
    what = f"is a joint; its link is {robot.joints[str(name)].child!r}" if str(name) in robot.joints else "unknown"
    require_one_of(key, name, robot.links, what)
    return str(name)


def _way(robot: Robot, base: str, tips: Sequence[str] | None) -> list[TreeJoint]:
    """Return the joints from the base to the tips, or to all links, path by path."""
    if tips is None:
        return robot.beyond(base)
    wanted: dict[str, None] = {}
    for tip in tips:
        if (path := robot.path(base, tip)) is None:
            why = f"tip = {truncated(tip)}: not reached outward from base = {truncated(base)}; choose a link beyond it"
            raise ArgumentError(why, id="unknown-link")
        wanted |= {joint.name: None for joint in path}
    if len(tips) == 1:
        return [robot.joints[name] for name in wanted]
    return [joint for joint in robot.beyond(base) if joint.name in wanted]


def _check_fit(joint: TreeJoint, span: str) -> None:
    """Check that a joint of a path can be a free joint of an arm."""
    where = f"joint {truncated(joint.name)}, {span},"
    if joint.kind in {"floating", "planar", "spherical"}:
        base = f"--base {joint.child}{' --free-base' * (joint.kind == 'floating')}"
        remedy = f"begin beyond it, for example with {base}, or name tips that are not beyond it"
        remedy = "replace it in the file by three hinges with one centre" if joint.kind == "spherical" else remedy
        why = f"{where} is {joint.kind}; a joint of an arm has one coordinate: {remedy}"
        raise ArgumentError(why, id="joint-type-in-file")
    if joint.mimic is not None:
        remedy = f"lock it, for example with --locked {joint.name}=0.0{'' if joint.turns else ' (m)'}"
        why = f"{where} mimics {truncated(joint.mimic.leader)}; it cannot move by itself: {remedy}"
        raise ArgumentError(why, id="mimic")


def _parts(
    robot: Robot, way: Sequence[TreeJoint], free: Collection[str], positions: Mapping[str, float],
    places: dict[str, tuple[int, Pose]],
) -> tuple[tuple[Part, ...], dict[str, tuple[int, Pose]]]:  # fmt: skip
    """Return the parts, and for each link on the path the number of its part and its frame in that part."""
    parts: list[Part] = []
    for joint in way:
        number, pose = places[joint.parent]
        if joint.name in free:
            body, others = folded(robot, joint.child, free, positions)
            parts.append(Part(joint, joint.child, number, pose.then(joint.origin), body, others))
            places[joint.child] = len(parts), HERE
        else:
            places[joint.child] = number, pose.then(joint.pose(positions[joint.name]))
    return tuple(parts), places


def _held(robot: Robot, found: Paths) -> tuple[str, ...]:
    """Return movable joints that are fixed and affect the arm; they precede the parts, or are within a part or base."""
    start = robot.root if found.free_base is None else found.base
    before: dict[str, None] = {}
    for part in found.parts:
        if not part.parent:
            way = robot.path(start, robot.above[part.link].parent) or []
            before |= {joint.name: None for joint in way if joint.moves}
    bodies = [part.folded for part in found.parts] + [found.free_base[2] if found.free_base else ()]
    inside = [robot.above[link] for links in bodies for link in links]
    return tuple({**before, **{joint.name: None for joint in inside if joint.moves}})


def along(way: Sequence[TreeJoint], positions: Mapping[str, float]) -> Pose:
    """Return the frame beyond the last of these joints in the frame before the first."""
    pose = HERE
    for joint in way:
        pose = pose.then(joint.pose(positions[joint.name]))
    return pose


def folded(
    robot: Robot, first: str, free: Collection[str], positions: Mapping[str, float]
) -> tuple[SpatialInertia, tuple[str, ...]]:
    """Merge a link and everything beyond it that no free joint moves, in the link's frame; also return their names."""
    links = robot.outward(first, free)
    bodies = {link: robot.links[link] for link in links}
    for link in reversed(links[1:]):
        joint = robot.above[link]
        bodies[joint.parent] = bodies[joint.parent].plus(bodies[link].moved(joint.pose(positions[joint.name])))
    return bodies[first], tuple(links[1:])
