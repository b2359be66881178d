"""The path through a robot from one link to another, with all else as rigid parts of it or of what does not move."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from flexlink.chain.rigid import HERE, Pose, SpatialInertia
from flexlink.common.errors import ArgumentError
from flexlink.describe.spec import did_you_mean, short_list, to_builtin, truncated
from flexlink.robots.kinematic_tree import Robot, TreeJoint


@dataclasses.dataclass(frozen=True)
class Part:
    """What moves with one free joint: the link behind it and all that hangs rigidly on that.

    `origin` is the frame of `link`, at angle 0, in the frame of the part before (of the first: in the root's frame),
    `body` is in that frame; `folded` are the other links that it is made of.
    """

    joint: TreeJoint
    link: str
    origin: Pose
    body: SpatialInertia
    folded: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class SerialPath:
    """A serial arm: its parts from the base outward, and the frame of the link `tip` in that of the last part.

    `positions` [rad, m] are those of all joints of the robot; `held` names the joints of it that could move, do not,
    and matter: those before the arm, and those between links of one part.
    """

    base: str
    tip: str
    parts: tuple[Part, ...]
    end: Pose
    positions: Mapping[str, float]
    held: tuple[str, ...]


def serial(
    robot: Robot,
    base: str | None,
    tip: str | None,
    posture: Mapping[str, float],
    locked: Mapping[str, float],
) -> SerialPath:
    """The arm between two links of a robot.

    Parameters
    ----------
    robot
        The robot.
    base, tip
        Links; by default the root, and the end of the only chain of joints that can turn, if there is only one.
    posture
        Positions [rad; prismatic m] of joints: where free ones start, and where others stay. Unless stated 0, or, if
        the limits exclude that, their middle. A joint that mimics another follows it.
    locked
        Positions of joints between base and tip that stay there, too: all that are not hinges must be among them.

    Raises
    ------
    ArgumentError
        A name that the robot does not have, a position beyond limits, of what has none, or stated twice, no path from
        base outward to tip, no free joint on it, or one that is no hinge.
    """
    base = robot.root if base is None else _known("base", base, robot.links)
    for key, stated in (("posture", posture), ("locked", locked)):
        for name, value in stated.items():
            _check_stated(robot, key, name, value)
    for name in locked:
        if name in posture:
            raise ArgumentError(f"joint {truncated(name)}: is in posture and in locked; leave it out of posture")
    tip = _only_tip(robot, base, locked) if tip is None else _known("tip", tip, robot.links)
    way = robot.path(base, tip)
    if way is None:
        raise ArgumentError(
            f"tip = {truncated(tip)}: is not reached from base = {truncated(base)} outward; choose a link beyond it"
        )
    for name in locked:
        if robot.joints[name] not in way:
            raise ArgumentError(
                f"locked: joint {truncated(name)} is not between {base!r} and {tip!r}; put it into posture"
            )
    free = [joint for joint in way if _moves(joint) and joint.name not in locked]
    for joint in free:
        if (reason := _unfit(joint)) is not None:
            raise ArgumentError(
                f"joint {truncated(joint.name)}, between {base!r} and {tip!r}, {reason}; only hinges can move: "
                f"fix it, as by --locked {joint.name}=0.0{' (m)' if joint.kind == 'prismatic' else ''}"
            )
    if not free:
        raise ArgumentError(f"no movable joint between {base!r} and {tip!r}; the arm needs at least one")
    positions = _positions(robot, {**posture, **locked})
    parts, end = _parts(robot, base, way, [joint.name for joint in free], positions)
    return SerialPath(base, tip, parts, end, positions, _held(robot, parts))


def _parts(
    robot: Robot, base: str, way: Sequence[TreeJoint], free: Sequence[str], positions: Mapping[str, float]
) -> tuple[tuple[Part, ...], Pose]:
    """Parts, and the pose of the last link of the way in the last of them."""
    parts: list[Part] = []
    pose = _along(robot.path(robot.root, base) or [], positions)
    for joint in way:
        if joint.name in free:
            links = robot.outward(joint.child, free)
            body = _folded(robot, links, positions)
            parts.append(Part(joint, joint.child, pose.then(joint.origin), body, tuple(links[1:])))
            pose = HERE
        else:
            pose = pose.then(joint.pose(positions[joint.name]))
    return tuple(parts), pose


def _held(robot: Robot, parts: Sequence[Part]) -> tuple[str, ...]:
    """Joints that could move, do not, and matter: before the base, or between links of one part."""
    before = robot.path(robot.root, robot.above[parts[0].link].parent) or []
    inside = [robot.above[link] for part in parts for link in part.folded]
    return tuple(joint.name for joint in (*before, *inside) if _moves(joint))


def _along(way: Sequence[TreeJoint], positions: Mapping[str, float]) -> Pose:
    pose = HERE
    for joint in way:
        pose = pose.then(joint.pose(positions[joint.name]))
    return pose


def _folded(robot: Robot, links: Sequence[str], positions: Mapping[str, float]) -> SpatialInertia:
    """The links as one body in the frame of the first, each joined to that on which it hangs, outermost first."""
    bodies = {link: robot.links[link] for link in links}
    for link in reversed(links[1:]):
        joint = robot.above[link]
        bodies[joint.parent] = bodies[joint.parent].plus(bodies[link].moved(joint.pose(positions[joint.name])))
    return bodies[links[0]]


def _moves(joint: TreeJoint) -> bool:
    return joint.kind != "fixed"


def _unfit(joint: TreeJoint) -> str | None:
    """Why a joint cannot be a free one of an arm."""
    if joint.mimic is not None:
        return f"mimics {truncated(joint.mimic.leader)}"
    sliding = ", and sliding joints are not supported" if joint.kind == "prismatic" else ""
    return None if joint.turns else f"is {joint.kind}{sliding}"


def _only_tip(robot: Robot, base: str, locked: Mapping[str, float]) -> str:
    """The end of the longest chain of hinges beyond the base, if all other ends are beyond the same joints."""
    stops = [j.name for j in robot.joints.values() if _moves(j) and _unfit(j) and j.name not in locked]
    chains: dict[tuple[str, ...], list[str]] = {(): []}
    joints: dict[str, tuple[str, ...]] = {base: ()}
    for link in robot.outward(base, stops)[1:]:
        joint = robot.above[link]
        own = (joint.name,) if _moves(joint) and joint.name not in locked else ()
        joints[link] = joints[joint.parent] + own
        chains.setdefault(joints[link], []).append(link)
    longest = max(chains, key=len)
    if not longest:
        raise ArgumentError(f"no movable joint beyond {base!r}; the arm needs at least one")
    others = [links[0] for way, links in chains.items() if longest[: len(way)] != way]
    if others:
        ends = short_list([chains[longest][-1], *others])
        raise ArgumentError(
            f"tip: missing; several arms begin at {base!r}; choose one of their ends: {ends}, "
            f"as by --tip {chains[longest][-1]}"
        )
    return chains[longest][-1]


def _positions(robot: Robot, stated: Mapping[str, float]) -> dict[str, float]:
    """Of every joint; what is not stated is 0, or in the middle of limits that exclude 0."""
    leaders = dict(stated)
    for joint in robot.joints.values():
        if joint.limits is not None and joint.mimic is None and joint.name not in leaders:
            lower, upper = joint.limits
            leaders[joint.name] = 0.0 if lower <= 0 <= upper else (lower + upper) / 2
    return {joint.name: robot.position(joint, leaders) for joint in robot.joints.values()}


def _known(key: str, name: object, names: Mapping[str, object]) -> str:
    if not isinstance(name, str) or name not in names:
        allowed = f"{short_list(list(names))}{did_you_mean(name, names)}"
        raise ArgumentError(f"{key} = {truncated(name)}: unknown; allowed are {allowed}")
    return name


def finite(value: object) -> float | None:
    """A number, NumPy's or Python's, that is finite; None for anything else."""
    number = to_builtin(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return None
    return float(number) if math.isfinite(number) else None


def _check_stated(robot: Robot, key: str, name: object, value: object) -> None:
    joint = robot.joints[_known(key, name, robot.joints)]
    if joint.kind in {"fixed", "floating", "planar"}:
        raise ArgumentError(f"{key}: joint {truncated(name)} is {joint.kind}; only hinges and slides have a position")
    if joint.mimic is not None and key == "posture":
        raise ArgumentError(
            f"{key}: joint {truncated(name)} mimics {truncated(joint.mimic.leader)}; give the position of that joint"
        )
    number = finite(value)
    if number is None:
        raise ArgumentError(
            f"{key}: {truncated(name)} = {truncated(value)}: expected a finite number [rad; m for a slide]"
        )
    lower, upper = joint.limits or (-math.inf, math.inf)
    if not lower <= number <= upper and lower < upper:
        given, low, high = (_said(joint, position) for position in (number, lower, upper))
        raise ArgumentError(f"{key}: {truncated(name)} = {given}: must be between {low} and {high}")


def _said(joint: TreeJoint, position: float) -> str:
    """A position with its unit, of a hinge in degrees, too, in which the command line takes it."""
    return f"{position!r} rad ({math.degrees(position):.6g}°)" if joint.turns else f"{position!r} m"
