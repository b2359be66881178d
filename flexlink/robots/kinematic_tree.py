"""A robot as URDF describes it: rigid links in a tree, and its joints' positions; anything else is a named error."""

import dataclasses
import functools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.rigid import Pose, SpatialInertia
from flexlink.common.errors import ArgumentError, DataFileError, Diagnostic
from flexlink.common.types import Array
from flexlink.common.wording import did_you_mean, plural, short_list, truncated
from flexlink.describe.spec import to_builtin

JointKind = Literal["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"]


@dataclasses.dataclass(frozen=True)
class Mimic:
    """Rule of a joint that follows another: position = multiplier · position of `leader` + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclasses.dataclass(frozen=True)
class TreeJoint:
    """A joint of a robot, between the links `parent` and `child`."""

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Pose  # frame of the child in that of the parent, at position 0
    axis: Array  # unit vector in the child's frame
    limits: tuple[float, float] | None  # positions [rad, m]
    damping: float  # [N m s/rad, N s/m]
    friction: float  # [N m, N]
    mimic: Mimic | None
    armature: float = 0.0  # [kg m², kg]

    @property
    def turns(self) -> bool:
        """Whether the joint is revolute or continuous."""
        return self.kind in {"revolute", "continuous"}

    @property
    def moves(self) -> bool:
        """Whether the joint is not fixed."""
        return self.kind != "fixed"

    def pose(self, position: float) -> Pose:
        """Return the child's frame in the parent's frame; floating, planar and spherical joints ignore `position`."""
        if self.kind == "prismatic":
            return self.origin.then(Pose(np.eye(3), self.axis * position))
        return self.origin.then(Pose(_turn(self.axis, position), np.zeros(3))) if self.turns else self.origin


def _turn(axis: Array, angle: float) -> Array:
    """Return the rotation matrix for an angle about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R: Array = np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K)
    return R


class Closure(NamedTuple):
    """What holds links together outside the tree: frames of two links, or the joints of two links in a ratio."""

    name: str
    kind: str  # of the tie
    ends: tuple[tuple[str, Pose], tuple[str, Pose]]
    ratio: float = 1.0
    lacks: str = ""  # why it is no tie
    lost: str = ""  # what the tie does not have
    axis: Sequence[float] = (0.0, 0.0, 1.0)  # of a hinge, in both frames


@dataclasses.dataclass(frozen=True, repr=False)
class Robot:
    """Links and joints by name, which form a tree; joints are in the file's order.

    `left_out` is what the file has and the reader does not read: by element, as `<visual>`, or attribute, as
    `<limit effort>`, the link or joint that has it, and its value, for each.
    """

    name: str
    links: Mapping[str, SpatialInertia]  # bodies in their frames; massless if the file gives no inertia
    joints: Mapping[str, TreeJoint]
    left_out: Mapping[str, Sequence[tuple[str, str]]]
    doubts: tuple[Diagnostic, ...] = ()  # angles that are likely in degrees
    closures: Sequence[Closure] = ()  # of loops
    source: str = "URDF"

    def __repr__(self) -> str:
        return f"<Robot {self.name!r}: {plural(len(self.links), 'link')}, {plural(len(self.joints), 'joint')}>"

    def __post_init__(self) -> None:
        if not self.links:
            raise DataFileError("no link; a robot has at least one", id="no-link")
        for joint in self.joints.values():
            for key, link in (("parent", joint.parent), ("child", joint.child)):
                if link not in self.links:
                    near = did_you_mean(link, self.links) or f"; links are {short_list(list(self.links))}"
                    why = f"<{key} link> = {truncated(link)}: there is no such link{near}"
                    raise DataFileError(f"joint {truncated(joint.name)}: {why}", id="link-missing-in-file")
        _check_roots(self)
        _check_mimics(self)

    @functools.cached_property
    def above(self) -> dict[str, TreeJoint]:
        """Parent joint of each link except the root."""
        parents: dict[str, TreeJoint] = {}
        for joint in self.joints.values():
            if (other := parents.setdefault(joint.child, joint)) is not joint:
                both = f"{truncated(other.name)} and {truncated(joint.name)}"
                why = "closed loops in URDF files are not supported: take one of the two joints out"
                child = f"link {truncated(joint.child)} is the child of two joints, {both}"
                raise DataFileError(f"{child}; {why}", id="closed-loop")
        return parents

    @functools.cached_property
    def below(self) -> dict[str, list[TreeJoint]]:
        """Child joints of each link."""
        children: dict[str, list[TreeJoint]] = {link: [] for link in self.links}
        for joint in self.joints.values():
            children[joint.parent].append(joint)
        return children

    @functools.cached_property
    def root(self) -> str:
        """The link without a parent joint."""
        return next(link for link in self.links if link not in self.above)

    def outward(self, base: str, stop: Collection[str] = ()) -> list[str]:
        """Return `base` and all links beyond it, parents first, except links beyond the joints in `stop`."""
        links = [base]
        for link in links:  # the loop appends to the list
            links += [joint.child for joint in self.below[link] if joint.name not in stop]
        return links

    def beyond(self, base: str) -> list[TreeJoint]:
        """Return all joints beyond a link, path by path; children of one link are in the file's order."""
        joints, open_ends = [], self.below[base][::-1]
        while open_ends:
            joints.append(open_ends.pop())
            open_ends += self.below[joints[-1].child][::-1]
        return joints

    def path(self, base: str, tip: str) -> list[TreeJoint] | None:
        """Return the joints from `base` outward to `tip`; None if `tip` does not lie beyond `base`."""
        joints: list[TreeJoint] = []
        while tip != base:
            if tip not in self.above:
                return None
            joints.append(self.above[tip])
            tip = joints[-1].parent
        return joints[::-1]

    def rule(self, joint: TreeJoint, stated: Collection[str] = ()) -> Mimic:
        """Return the joint, `stated` or free, that leads a chain of mimicking joints, and the rule for this joint."""
        scale, shift = 1.0, 0.0
        while joint.mimic is not None and joint.name not in stated:
            shift += scale * joint.mimic.offset
            scale *= joint.mimic.multiplier
            joint = self.joints[joint.mimic.leader]
        return Mimic(joint.name, scale, shift)

    def position(self, joint: TreeJoint, posture: Mapping[str, float]) -> float:
        """Return the position [rad, m] of a joint, from `posture` or from the joint that it mimics; otherwise 0."""
        rule = self.rule(joint, posture)
        return rule.multiplier * posture.get(rule.leader, 0.0) + rule.offset


def _check_roots(robot: Robot) -> None:
    roots = [link for link in robot.links if link not in robot.above]
    if len(roots) > 1:
        why = f"{len(roots)} links have no parent joint, {short_list(roots)}; a robot has one root"
        raise DataFileError(why, id="several-roots")
    reached = set(robot.outward(roots[0])) if roots else set()
    if circle := [link for link in robot.links if link not in reached]:
        they_form = f"link {circle[0]} forms" if len(circle) == 1 else f"links {short_list(circle)} form"
        why = f"{they_form} a loop; closed loops in URDF files are not supported: take a joint out"
        raise DataFileError(why, id="closed-loop")


def _check_mimics(robot: Robot) -> None:
    checked: set[str] = set()
    for start in robot.joints.values():
        joint, way = start, {start.name: None}
        while joint.mimic is not None and joint.name not in checked:
            if (leader := joint.mimic.leader) not in robot.joints:
                why = f"joint {truncated(joint.name)}: mimics {truncated(leader)}, which does not exist"
                raise DataFileError(why, id="mimic")
            checked.add(joint.name)  # joints of this path are also in `way`, by which loops are detected
            joint = robot.joints[leader]
            if leader in way:
                why = f"joint {truncated(leader)}: mimics itself, by way of {short_list(list(way))}"
                raise DataFileError(why, id="mimic")
            way[leader] = None


def positions_of(robot: Robot, stated: Mapping[str, float]) -> dict[str, float]:
    """Return the position of every joint; by default 0, or the middle of the limits if they exclude 0."""
    leaders = dict(stated)
    for joint in robot.joints.values():
        if joint.limits is not None and joint.mimic is None and joint.name not in leaders:
            lower, upper = joint.limits
            leaders[joint.name] = 0.0 if lower <= 0 <= upper or lower > upper else (lower + upper) / 2
    return {joint.name: robot.position(joint, leaders) for joint in robot.joints.values()}


def check_stated(robot: Robot, posture: Mapping[str, float], locked: Mapping[str, float]) -> None:
    """Check that the given positions are within the limits and belong to joints that have a position."""
    for key, stated in (("posture", posture), ("locked", locked)):
        for name, value in stated.items():
            _check(robot, key, name, value)
    for name in locked:
        if name in posture:
            why = f"joint {truncated(name)}: in posture and in locked; remove it from posture"
            raise ArgumentError(why, id="both-given")


def finite(value: object) -> float | None:
    """Return a finite NumPy or Python number as float; None for anything else."""
    number = to_builtin(value)
    if isinstance(number, bool) or not isinstance(number, int | float):
        return None
    return float(number) if math.isfinite(number) else None


def _check(robot: Robot, key: str, name: object, value: object) -> None:
    joint = require_one_of(key, name, robot.joints)
    if joint.kind in {"fixed", "floating", "planar", "spherical"}:
        why = f"{key}: joint {truncated(name)} is {joint.kind}; only hinges and slides have a position"
        raise ArgumentError(why, id="joint-type-in-file")
    if joint.mimic is not None and key == "posture":
        why = f"{key}: joint {truncated(name)} mimics {truncated(joint.mimic.leader)}; give the position of that joint"
        raise ArgumentError(why, id="mimic")
    if (number := finite(value)) is None:
        why = f"{key}: {truncated(name)} = {truncated(value)}: expected a finite number [rad; m for a slide]"
        raise ArgumentError(why, id="out-of-range")
    lower, upper = joint.limits or (-math.inf, math.inf)
    if not lower <= number <= upper and lower < upper:
        given, low, high = (
            f"{x!r} rad ({math.degrees(x):.6g}°)" if joint.turns else f"{x!r} m" for x in (number, lower, upper)
        )
        raise ArgumentError(f"{key}: {truncated(name)} = {given}: must be between {low} and {high}", id="out-of-range")
