"""A robot's URDF → a scene: the whole tree, or the paths to some links, as an arm, some of whose links bend."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from flexlink.common.errors import ArgumentError
from flexlink.common.notebook import html_lines
from flexlink.common.wording import short_list, truncated
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3
from flexlink.robots.assembly import assembled
from flexlink.robots.flexible import FlexibleLink, rounded_down, slender_mass
from flexlink.robots.kinematic_tree import Robot
from flexlink.robots.lifeless import living_paths
from flexlink.robots.paths import Paths
from flexlink.robots.positions import finite
from flexlink.robots.robot_file import read_robot
from flexlink.robots.tuning import tuned

NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclasses.dataclass(frozen=True, repr=False)
class ImportResult:
    """What became of a robot.

    Attributes
    ----------
    scene
        The arm, at rest at the stated posture, undriven.
    path
        Joints, bodies and positions that it was made of.
    largest_beams
        By link, the most mass [kg] that a thin beam from joint to joint can have; 0 where they have no distance.
    notes
        What was folded, held, left out, and what a flexible link is made of: a line each.
    warnings
        Doubts: a beam beside the mass of its link, a joint that follows one that moves, and stays.
    """

    scene: Scene
    path: Paths
    largest_beams: Mapping[str, float]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<ImportResult {self.scene.name!r}: {_span(self.path)}>"

    def __str__(self) -> str:
        return "\n".join(self.notes)

    def _repr_html_(self) -> str:
        return html_lines("\n".join([*self.notes, *(f"warning: {doubt}" for doubt in self.warnings)]))


def import_urdf(
    path: str | Path | Robot,
    *,
    base: str | None = None,
    tip: str | Sequence[str] | None = None,
    free_base: bool = False,
    posture: Mapping[str, float] = NOTHING,
    locked: Mapping[str, float] = NOTHING,
    flexible: Mapping[str, FlexibleLink] = NOTHING,
    armature: Mapping[str, float] = NOTHING,
    gravity: Vector3 = (0.0, 0.0, -9.81),
) -> ImportResult:
    """Read a robot from a URDF file and make a scene of it, whole, or of the paths to some of its links.

    All joints that turn or slide are joints of the scene, each after the one that it hangs on, path by path in the
    file's order; where several hang on a link, links say what they hang `on`. Fixed joints are folded: mass, centre and
    inertia are kept. Where `tip` is given, only what is on the way there moves, and whatever hangs on it, side
    branches, grippers, is rigid at the stated posture, as followers, joints that mimic others, always are.

    Parameters
    ----------
    path
        The file; it alone is read. Or what `read_robot` has made of it.
    base
        Link where the paths begin; by default the root. Frame 0 is the root's.
    tip
        Link where a path ends, or several. By default the ends of the whole robot, beyond the last joint of each path.
    free_base
        Whether the base floats: its link and what is fixed to it are the scene's `base`, and what is not beyond it is
        left out.
    posture
        Positions by joint [rad; m of a slide]: at which free joints start, and at which others stay. Unless stated 0,
        or, where the limits exclude it, their middle. A joint that mimics another follows it.
    locked
        Positions by joint on the way [rad; m of a slide] that stay there.
    flexible
        Links on the way that bend, by name; what hangs on such a link hangs on the end of its beam.
    armature
        Rotor inertias by joint [kg m²; kg of a slide], seen at the joint; URDF has none.
    gravity
        Acceleration [m/s²] in the root's frame, whose Z points up.

    Returns
    -------
    ImportResult
        The scene, and what was done.

    Raises
    ------
    ArgumentError
        No dict, a name that the robot does not have, no such path, a joint on it that floats, moves in a plane or
        follows another, a position beyond limits, a joint in `posture` and in `locked`, or a beam that does not fit
        into its link.
    DataFileError
        The file is no URDF, or says what cannot be; or the inertia of a folded link is none that a body can have, or
        that of a free base; or nothing has inertia that a joint moves on the way to a tip that is named.
    SceneError
        A value of `flexible` or `armature` that cannot be.

    Examples
    --------
    >>> bends = {"upper_arm": fl.FlexibleLink(frequency_hz=8.0)}  # the rest stays rigid
    >>> found = fl.import_urdf("examples/reach_arm.urdf", flexible=bends, posture={"shoulder": 0.9})
    >>> found
    <ImportResult 'reach_arm': 5 joints from base to flange>
    >>> print(found.scene.arm)
    <Arm: 'turntable' (rigid), 'upper_arm' (yz), 'forearm' (rigid), 'wrist' (rigid), 'hand' (rigid), 'flange' (rigid)>
    """
    for key, table in {"posture": posture, "locked": locked, "flexible": flexible, "armature": armature}.items():
        if not isinstance(table, Mapping):
            raise ArgumentError(
                f"{key} = {truncated(table)}: expected a dict, got {type(table).__name__}", id="wrong-type"
            )
    robot = path if isinstance(path, Robot) else read_robot(path)
    rotors = {joint for joint, inertia in armature.items() if finite(inertia)}
    way, lifeless = living_paths(robot, base, tip, posture, locked, free_base=free_base, rotors=rotors)
    _check_links(way, flexible)
    _check_joints(way, armature)
    scene, parts = assembled(robot.name, way, flexible, armature, gravity)
    for part, one in zip(way.parts, parts, strict=True):
        hertz = flexible[part.link].frequency_hz if part.link in flexible else None
        if hertz is not None:
            scene = tuned(scene, one.link.name, hertz)
    largest = {part.link: slender_mass(part, beyond.p) for part, beyond in zip(way.parts, way.beyond(), strict=True)}
    stated = {*posture, *locked}
    notes = [*_notes(robot, way, stated, lifeless), *filter(None, (one.remark for one in parts)), *_beams(way, largest)]
    warnings = [*filter(None, (one.warning for one in parts)), *_left_behind(robot, way)]
    return ImportResult(scene, way, largest, tuple(notes), tuple(warnings))


def _check_links(way: Paths, flexible: Mapping[str, FlexibleLink]) -> None:
    for link, asked in flexible.items():
        holders = [part.link for part in way.parts if link in part.folded]
        if holders:
            raise ArgumentError(
                f"flexible: link {truncated(link)} is fixed to {truncated(holders[0])}; make that link flexible",
                id="flexible-link-fixed",
            )
        if link not in [part.link for part in way.parts]:
            allowed = short_list([part.link for part in way.parts])
            raise ArgumentError(
                f"flexible: link {truncated(link)} is not between base and tip; allowed are {allowed}",
                id="unknown-link",
            )
        if not isinstance(asked, FlexibleLink):
            raise ArgumentError(
                f"flexible: {truncated(link)} = {truncated(asked)}: expected a FlexibleLink", id="wrong-type"
            )


def _check_joints(way: Paths, armature: Mapping[str, float]) -> None:
    free = [part.joint.name for part in way.parts]
    for joint, value in armature.items():
        if joint not in free:
            raise ArgumentError(
                f"armature: joint {truncated(joint)} does not move in this arm; allowed are {short_list(free)}",
                id="unknown-joint",
            )
        if (number := finite(value)) is None or number < 0:
            raise ArgumentError(
                f"armature: {truncated(joint)} = {truncated(value)}: expected a number >= 0 [kg m²]", id="out-of-range"
            )


def _span(way: Paths) -> str:
    return f"{len(way.parts)} joints from {way.base} to {short_list([tip.link for tip in way.tips])}"


def _notes(robot: Robot, way: Paths, stated: set[str], lifeless: tuple[str, ...]) -> list[str]:
    """What was done to the robot, a line each."""
    moving = sum(part.body.mass for part in way.parts)
    notes = [f"{robot.name}: {_span(way)}; moving mass {moving:.6g} kg"]
    if way.free_base is not None:
        others = short_list([*way.free_base.folded]) or "nothing else"
        notes.append(f"{way.base}: the base, free, {way.free_base.body.mass:.6g} kg; includes {others}")
    for part in way.parts:
        if part.folded:
            notes.append(f"{part.link}: includes {short_list(part.folded)}, which do not move relative to it")
        start, limits = way.positions[part.joint.name], part.joint.limits
        if start and part.joint.name not in stated:
            unit = "rad" if part.joint.turns else "m"
            notes.append(f"{part.joint.name}: starts at {start:.4g} {unit}, the middle of its limits, which exclude 0")
        if limits is not None and limits[0] == limits[1]:
            notes.append(f"{part.joint.name}: limits {limits[0]:g} and {limits[1]:g} are equal: ignored")
    if lifeless:
        notes.append(f"nothing beyond them has inertia, they do not move: {short_list(lifeless)}")
    if way.held:
        positions = [f"{name} at {way.positions[name]:.4g}" for name in way.held]
        notes.append(f"fixed at [rad, m]: {short_list(positions)}")
    left_out = [f"{count} {name}" for name, count in robot.left_out.items()]
    notes.append("ignored: " + ", ".join(["limits of effort and velocity", *left_out]))
    return notes


def _left_behind(robot: Robot, way: Paths) -> list[str]:
    """Followers of joints that move."""
    free = [part.joint.name for part in way.parts]
    leaders = {name: robot.leader(robot.joints[name]).name for name in way.held}
    moving = {name: leader for name, leader in leaders.items() if leader in free}
    return [f"{name}: mimics {leader}, which moves; here {name} does not" for name, leader in moving.items()]


def _beams(way: Paths, largest: Mapping[str, float]) -> list[str]:
    """The largest beam of each link."""
    least = 0.01  # below, the joints are too close, or not beside the body's mass
    share = {part.link: largest[part.link] / part.body.mass for part in way.parts if part.body.mass}
    notes = [
        f"{part.link}: at most {rounded_down(largest[part.link])} of its {part.body.mass:.4g} kg can be modelled as a "
        "bending beam from joint to joint"
        for part in way.parts
        if share.get(part.link, 0.0) >= least
    ]
    others = [part.link for part in way.parts if share.get(part.link, 0.0) < least]
    return [*notes, f"too compact for a beam from joint to joint: {short_list(others)}"] if others else notes
