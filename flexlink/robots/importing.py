"""URDF, MJCF, SDF → scene: import a complete robot, or the paths to some of its links, as an arm; links may bend.

Joints that mimic a free joint: on a fixed base they are inertia and friction of their leader.

A follower moves by k q̇ if its leader moves by q̇. A rigid body on it adds k² J to the inertia of the leader, where J is
its inertia about the axis (or its mass), k² d to viscous and |k| c to dry friction; exact except for its weight.

Find a beam's Young's modulus from a measured frequency.

Spring stiffness is proportional to E, and without gravity there is no other stiffness, so f ∝ √E. The frequency f₀ for
E₀ therefore gives E = E₀ (f/f₀)².
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np

from flexlink.chain.coordinates import Kind
from flexlink.chain.lumping import lump
from flexlink.chain.odd_bodies import of_odd_bodies
from flexlink.chain.rigid import Pose, SpatialInertia, rpy_from_matrix
from flexlink.common import safe_xml
from flexlink.common.errors import ArgumentError, DataFileError, Diagnostic
from flexlink.common.notebook import html_lines
from flexlink.common.types import Array
from flexlink.common.wording import short_list, truncated
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3
from flexlink.dynamics.vibration.modal import natural_frequencies
from flexlink.robots.assembly import assembled
from flexlink.robots.flexible import FlexibleLink, payload, rounded_down, slender_mass
from flexlink.robots.kinematic_tree import Closure, Mimic, Robot, TreeJoint, finite
from flexlink.robots.paths import Part, Paths, along, folded, paths
from flexlink.robots.robot_file import acts, read_robot

NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclasses.dataclass(frozen=True, repr=False)
class ImportResult:
    """The imported robot."""

    scene: Scene  # the arm, at rest in the given configuration, without a drive
    path: Paths = dataclasses.field(compare=False)  # joints, bodies and positions from which the scene was built
    largest_beams: Mapping[str, float]  # largest mass [kg] of a thin beam between joints, by link; 0 if they coincide
    # on joints and links that were folded, fixed or ignored, loops, flexible links, and what acts in some program but
    # is not read
    notes: tuple[Diagnostic, ...]
    # angles that are likely in degrees, a beam much lighter than its link, an inertia that no real body has, a joint
    # that mimics a moving one, a stiffness or rotor that is not read
    warnings: tuple[Diagnostic, ...]

    def __repr__(self) -> str:
        return f"<ImportResult {self.scene.name!r}: {_span(self.path)}>"

    def __str__(self) -> str:
        return "\n".join(self.notes)

    def _repr_html_(self) -> str:
        return html_lines("\n".join([*self.notes, *(f"warning: {doubt}" for doubt in self.warnings)]))


def import_urdf(
    path: str | Path | Robot, *, base: str | None = None, tip: str | Sequence[str] | None = None,
    free_base: bool = False, posture: Mapping[str, float] = NOTHING, locked: Mapping[str, float] = NOTHING,
    flexible: Mapping[str, FlexibleLink] = NOTHING, armature: Mapping[str, float] = NOTHING,
    gravity: Vector3 = (0.0, 0.0, -9.81),
) -> ImportResult:  # fmt: skip
    """Convert a URDF, MJCF or SDF file to a scene, with the complete robot or only the paths to some of its links.

    All hinges and sliding joints become joints of the scene, each after its parent, path by path in the file's
    order, with its own name (`Joint.name`). If a link has several children, they name it with `on`. Links connected by
    fixed joints are merged; mass, centre and inertia are preserved. If `tip` is given, only joints on the paths to the
    tips move. Everything attached to these paths, such as grippers, is rigid in the given configuration. Mimicking
    joints are rigid as well, but on a fixed base each adds the inertia and friction of its body to its leader. What
    closes loops in MJCF and SDF becomes ties.

    Parameters
    ----------
    path
        The URDF or SDF file, without its meshes, the MJCF file, which MuJoCo reads, or the result of `read_robot`.
    base
        Link where the paths begin; by default the root. Frame 0 is the root's frame.
    tip
        Link or links where the paths end. Default: all ends of the robot, after the last joint of each path.
    free_base
        Whether the base floats. Its link and everything fixed to it become the scene's `base`. Only links beyond this
        base are imported.
    posture
        Positions by joint [rad; m if sliding]: initial positions of free joints, constant positions of others.
        Default 0, or the middle of the limits if they exclude 0. Mimicking joints follow their leader.
    locked
        Positions of joints on the path that are locked, by joint [rad; m if sliding].
    flexible
        Flexible links on the path, by name; children of such a link are attached to the end of its beam.
    armature
        Rotor inertias by joint, reflected to the joint [kg m²; kg if sliding]; default: those of MJCF.
    gravity
        Gravitational acceleration [m/s²] in the root's frame, whose Z points up.

    Returns
    -------
    ImportResult
        The scene, and notes on the import.

    Raises
    ------
    ArgumentError
        A table is not a dict, a name or path does not exist in the robot, a joint on the path is floating, planar or
        mimics another, a position is beyond limits, a joint is in both `posture` and `locked`, or a beam does not fit
        into its link.
    DataFileError
        The file is not valid, a floating base lacks mass or inertia, or no joint on the way to a named tip moves
        any inertia.
    SceneError
        A value of `flexible` or `armature` is invalid, or M is indefinite due to an inertia that no real body has.

    Examples
    --------
    >>> bends = {"upper_arm": fl.FlexibleLink(frequency_hz=8.0)}  # all other links are rigid
    >>> found = fl.import_urdf("examples/reach_arm.urdf", flexible=bends, posture={"shoulder": 0.9})
    >>> found
    <ImportResult 'reach_arm': 5 joints from base to flange>
    >>> print(found.scene.arm)
    <Arm: 'turntable' (rigid), 'upper_arm' (yz), 'forearm' (rigid), 'wrist' (rigid), 'hand' (rigid), 'flange' (rigid)>
    """
    values = {
        "posture": (posture, "joint: position"), "locked": (locked, "joint: position"),
        "flexible": (flexible, "link: fl.FlexibleLink(frequency_hz=12.0)"), "armature": (armature, "joint: inertia"),
    }  # fmt: skip
    for key, (table, form) in values.items():
        if not isinstance(table, Mapping):
            given = type(table).__name__
            raise ArgumentError(f"{key} = {truncated(table)}: expected a dict {{{form}}}, got {given}", id="wrong-type")
    robot = path if isinstance(path, Robot) else read_robot(path)
    driven = {name for name, joint in robot.joints.items() if finite(armature.get(name, joint.armature))}
    way, lifeless = living_paths(robot, base, tip, posture, locked, free_base=free_base, rotors=driven)
    _check_links(way, flexible)
    armature = {part.joint.name: part.joint.armature for part in way.parts if part.joint.armature} | dict(armature)
    _check_joints(way, armature)
    way, rotors, following = with_followers(robot, way, locked, armature, gravity)
    scene, parts = assembled(robot, way, flexible, rotors, gravity)
    if odd := [*of_odd_bodies(scene.arm)]:
        lump(scene)  # refuses them if M is not positive
    for part, one in zip(way.parts, parts, strict=True):
        hertz = flexible[part.link].frequency_hz if part.link in flexible else None
        if hertz is not None:
            scene = tuned(scene, one.link.name, hertz)
    largest = {part.link: slender_mass(part, beyond.p) for part, beyond in zip(way.parts, way.beyond(), strict=True)}
    remarks = [one.remark for one in parts if one.remark is not None]
    carried = [note for note in following if note.id == "mimic-carried"]
    loops = [*ties_of(robot, way, [one.link.name for one in parts], locked, afloat=free_base)]
    notes = [*_notes(robot, way, {*posture, *locked}, lifeless), *(note for _, note in loops), *carried, *remarks]
    notes += [] if flexible else _beams(way, largest)
    bare = [part for part in way.parts if part.link in flexible and not robot.links[part.link].mass]
    lent = [f"{part.link}: has no <inertial>; its mass is that of {short_list(part.folded)}: check it" for part in bare]
    doubts = [*robot.doubts, *(Diagnostic(text, "no-mass") for text in lent), *(p.warning for p in parts if p.warning)]
    warnings = [*doubts, *odd, *(note for note in following if note not in carried), *_offers(robot, way, armature)]
    names = {part.joint.name: one.link.name for part, one in zip(way.parts, parts, strict=True)}
    ties = [
        {"name": name, "kind": "joint", "link": names[name], "to": {"link": names[by.leader]}, "ratio": by.multiplier}
        for name, by in way.followers.items()
    ]
    ties += [tie for tie, _ in loops if tie is not None]
    scene = scene.varied({"tie": ties}) if ties else scene
    return ImportResult(scene, way, largest, tuple(notes), tuple(warnings))


def _check_links(way: Paths, flexible: Mapping[str, FlexibleLink]) -> None:
    links = [part.link for part in way.parts]
    for link, specified in flexible.items():
        if holders := [part.link for part in way.parts if link in part.folded]:
            why = f"flexible: link {truncated(link)} is fixed to {truncated(holders[0])}; make that link flexible"
            raise ArgumentError(why, id="flexible-link-fixed")
        if link not in links:
            why = f"flexible: link {truncated(link)} is not between base and tip; allowed are {short_list(links)}"
            raise ArgumentError(why, id="unknown-link")
        if not isinstance(specified, FlexibleLink):
            why = f"flexible: {truncated(link)} = {truncated(specified)}: expected a FlexibleLink"
            raise ArgumentError(why, id="wrong-type")


def _check_joints(way: Paths, armature: Mapping[str, float]) -> None:
    free = [part.joint.name for part in way.parts]
    for joint, value in armature.items():
        if joint not in free:
            why = f"armature: joint {truncated(joint)} does not move in this arm; allowed are {short_list(free)}"
            raise ArgumentError(why, id="unknown-joint")
        if (number := finite(value)) is None or number < 0:
            why = f"armature: {truncated(joint)} = {truncated(value)}: expected a number >= 0 [kg m²]"
            raise ArgumentError(why, id="out-of-range")


def _span(way: Paths) -> str:
    return f"{len(way.parts)} joints from {way.base} to {short_list([tip.link for tip in way.tips])}"


def _notes(robot: Robot, way: Paths, stated: set[str], lifeless: tuple[str, ...]) -> Iterator[Diagnostic]:
    """Yield notes on how the robot was changed."""
    moving = sum(part.body.mass for part in way.parts)
    yield Diagnostic(f"{robot.name}: {_span(way)}; moving mass {moving:.6g} kg", "imported")
    if way.free_base is not None:
        _, body, attached = way.free_base
        text = f"{way.base}: the floating base, {body.mass:.6g} kg; includes {short_list(attached) or 'nothing else'}"
        yield Diagnostic(text, "imported-base")
    for part in way.parts:
        name, start = part.joint.name, way.positions[part.joint.name]
        if part.folded:
            text = f"{part.link}: includes {short_list(part.folded)}, which do not move relative to it"
            yield Diagnostic(text, "link-folded")
        if start and name not in stated and name not in way.followers:
            begins = f"starts at {start:.4g} {'rad' if part.joint.turns else 'm'}"
            yield Diagnostic(f"{name}: {begins}, the middle of its limits, which exclude 0", "joint-start")
        if name in way.followers:
            leader, ratio = way.followers[name].leader, way.followers[name].multiplier
            yield Diagnostic(f"{name}: moves by {ratio:g} times {leader}, held by a tie", "mimic-tied")
        if part.joint.limits is None and part.joint.kind != "continuous":
            yield Diagnostic(f"{name}: the file gives no limits", "limits-equal")
        lower, upper = part.joint.limits or (0.0, 1.0)
        if lower >= upper:
            odd = "equal" if lower == upper else "reversed"
            yield Diagnostic(f"{name}: limits {lower:g} and {upper:g} are {odd} and ignored", "limits-equal")
    if lifeless:
        yield Diagnostic(f"joints with no inertia attached are fixed: {short_list(lifeless)}", "joint-without-inertia")
    if empty := short_list([part.link for part in way.parts if not part.body.mass]):
        yield Diagnostic(f"no mass: {empty}; if that is not meant, add <inertial> there", "no-mass")
    if way.held:
        positions = [f"{name} at {way.positions[name]:.4g}" for name in way.held]
        yield Diagnostic(f"fixed at [rad, m]: {short_list(positions)}", "joint-fixed")
    yield from _ignored(robot)


def _ignored(robot: Robot) -> Iterator[Diagnostic]:
    """Note what was not read: elements and attributes with a mechanical name at their joints, all others by number."""
    others = []
    for what, found in robot.left_out.items():
        if not acts("mechanical", what):
            others.append(f"{len(found)} {what}")
            continue
        owners, values = zip(*found, strict=True)
        same = f" = {truncated(values[0])[1:-1]}" if values[0] and len(set(values)) == 1 else ""
        each = owners if same else [f"{owner} = {truncated(value)[1:-1]}".removesuffix(" = ") for owner, value in found]
        yield Diagnostic(f"{what}: left out ({short_list(each)}{same})", "left-out")
    if others:
        yield Diagnostic(f"ignored: {', '.join(others)}", "ignored")


def _offers(robot: Robot, way: Paths, armature: Mapping[str, float]) -> Iterator[Diagnostic]:
    """Warn of stiffnesses and rotors that the file gives to joints of the arm, with the keys that take them."""
    parts = {part.joint.name: part for part in way.parts}
    for what, found in robot.left_out.items():
        numbers = [(parts[owner], safe_xml.numbers_of(text) or [0.0]) for owner, text in found if owner in parts]
        stiff = acts("stiffness", what)
        given = [(part, x[0]) for part, x in numbers if x[0] > 0 and (stiff or part.joint.name not in armature)]
        if not given or not (stiff or acts("armature", what)):
            continue
        part, value = given[0]
        example = f"--armature {part.joint.name}={value:g}, times the square of the gear ratio"
        if stiff:
            key = f"--set 'link.{part.link}.joint.gear_stiffness={value:g}'"
            example = f"{key} --armature {part.joint.name}=I (I: the rotor's inertia)"
        others = f", and so on for {len(given)} joints" if len(given) > 1 else ""
        yield Diagnostic(f"{what} is left out; to use it, add {example}{others}", "left-out")


def _beams(way: Paths, largest: Mapping[str, float]) -> list[Diagnostic]:
    """Return a note on the largest beam of each link."""
    least = 0.01  # fraction of the link's mass; below this, joints are too close, or the mass is far from their line
    share = {part.link: largest[part.link] / part.body.mass for part in way.parts if part.body.mass}
    notes = list[Diagnostic]()
    for part in way.parts:
        if share.get(part.link, 0.0) >= least:
            most = f"at most {rounded_down(largest[part.link])} of its {part.body.mass:.4g} kg"
            notes.append(Diagnostic(f"{part.link}: a beam from joint to joint can carry {most}", "largest-beam"))
    if others := [link for link, part in share.items() if part < least]:
        notes.append(Diagnostic(f"too compact for a beam from joint to joint: {short_list(others)}", "no-beam"))
    return notes


def living_paths(
    robot: Robot, base: str | None, tip: str | Sequence[str] | None, posture: Mapping[str, float],
    locked: Mapping[str, float], *, free_base: bool, rotors: Collection[str],
) -> tuple[Paths, tuple[str, ...]]:  # fmt: skip
    """The `paths`, and the joints fixed as nothing beyond them has inertia; `rotors` are joints with an armature."""
    still: dict[str, None] = {}
    while True:
        found = paths(robot, base, tip, posture, locked, free_base=free_base, still=still)
        if not (lifeless := _lifeless(found, rotors)):
            return found, tuple(still)
        if tip is not None or len(lifeless) == len(found.parts):
            if not any(body.mass or body.inertia.any() for body in robot.links.values()):
                raise DataFileError("no link of this file has mass; give the moving links an <inertial>", id="no-mass")
            part = lifeless[-1]
            hint = f", for example --tip {part.joint.parent}" if part.parent else ""
            why = f"nothing beyond its joint has inertia; add <inertial> to it, or choose a tip before it{hint}"
            raise DataFileError(f"link {truncated(part.link)}: {why}", id="no-mass")
        still |= {part.joint.name: None for part in lifeless}


def _lifeless(way: Paths, rotors: Collection[str]) -> list[Part]:
    """Return the parts that have no inertia about their joint, and whose children have no inertia."""
    alive = [False] * (len(way.parts) + 1)  # also True for the parent of a body with inertia, whatever its axis
    found = []
    for number in range(len(way.parts), 0, -1):
        part = way.parts[number - 1]
        if part.joint.name in rotors or alive[number] or _moved(part.joint, part.body):
            alive[number] = alive[part.parent] = True
        else:
            found.append(part)
            alive[part.parent] |= part.body.mass > 0 or bool(part.body.inertia.any())
    return found[::-1]


def _moved(joint: TreeJoint, body: SpatialInertia) -> float:
    """Return the inertia [kg m²] of a body about its hinge, or its mass [kg] on a slide."""
    return payload(body).about(joint.axis) if joint.turns else body.mass


def with_followers(
    robot: Robot, way: Paths, locked: Collection[str], armature: Mapping[str, float], gravity: Vector3
) -> tuple[Paths, dict[str, float], list[Diagnostic]]:
    """Return the paths and the armatures with what followers add to their leaders, and a line on each follower."""
    rules, rotors, lines = _rules(robot, way, locked), dict(armature), []
    parts = {part.joint.name: part for part in way.parts}
    moving = {*rules, *parts}
    fixed = robot.outward(robot.root, moving) if way.free_base is None else []
    for name, rule in rules.items():
        joint, leader, k = robot.joints[name], parts[rule.leader].joint, rule.multiplier
        rigid = robot.outward(joint.child, moving) == robot.outward(joint.child)
        if not rigid or joint.parent not in fixed or not joint.axis.any():
            text = f"{name}: mimics {leader.name}, which moves; here {name} does not"
            lines.append(Diagnostic(text, "mimic-fixed"))
            continue
        body = folded(robot, joint.child, (), way.positions)[0]
        inertia = k * k * _moved(joint, body)
        rotors[leader.name] = rotors.get(leader.name, 0.0) + inertia
        damping, friction = leader.damping + k * k * joint.damping, leader.friction + abs(k) * joint.friction
        leader = dataclasses.replace(leader, damping=damping, friction=friction)
        parts[rule.leader] = dataclasses.replace(parts[rule.leader], joint=leader)
        R = along(robot.path(robot.root, joint.child) or [], way.positions).R
        kg, newton = ("kg m²", "N m") if leader.turns else ("kg", "N")
        weight = abs(k) * _weight(joint, body, R.T @ np.array(gravity))
        text = f"{name}: mimics {leader.name}, whose armature has its inertia, {inertia:.4g} {kg}"
        # 1e-12 N: right angles of a file are rounded
        lost = f"; its weight, up to {weight:.4g} {newton} there, is left out" if weight > 1e-12 else ""
        lines.append(Diagnostic(text + lost, "mimic-weight" if lost else "mimic-carried"))
    return dataclasses.replace(way, parts=tuple(parts.values())), rotors, lines


def _rules(robot: Robot, way: Paths, locked: Collection[str]) -> dict[str, Mimic]:
    """Rules of the joints that mimic a free joint; with a free base, only of those beyond the base."""
    free = {part.joint.name for part in way.parts}
    reached = set(robot.outward(robot.root if way.free_base is None else way.base))
    joints = [joint for joint in robot.joints.values() if joint.parent in reached and joint.moves]
    rules = {joint.name: robot.rule(joint, locked) for joint in joints if joint.name not in {*free, *locked}}
    return {name: rule for name, rule in rules.items() if rule.leader in free}


def _weight(joint: TreeJoint, body: SpatialInertia, gravity: Array) -> float:
    """Largest torque [N m] of a body's weight about a hinge, or its force [N] along a slide."""
    if joint.turns:
        return body.mass * math.hypot(*np.cross(joint.axis, body.center)) * math.hypot(*np.cross(joint.axis, gravity))
    return body.mass * abs(float(joint.axis @ gravity))


def clamped_frequency(scene: Scene, link: str) -> float:
    """First frequency [Hz] of a link clamped at its joint, all beyond it rigid, at the start, without gravity."""
    chain = lump(scene.varied({"gravity": (0.0, 0.0, 0.0)}))
    number, q = scene.arm.number(link), np.zeros(chain.n)
    q[chain.active] = scene.joint_positions[[chain.coordinate(k).link - 1 for k in chain.active]]
    others = [k for k in range(chain.n) if chain.coordinate(k).link != number or chain.coordinate(k).kind is Kind.JOINT]
    return float(natural_frequencies(chain, q, locked=others)[0] / (2 * np.pi))


def tuned(scene: Scene, link: str, hertz: float) -> Scene:
    """Return the scene with the link's Young's modulus set so that `clamped_frequency` is `hertz`."""
    name = scene.arm.links[scene.arm.number(link) - 1].material or link
    material, ratio = scene.arm.materials[name], hertz / clamped_frequency(scene, link)
    young = material.young * (ratio * ratio)
    specified = f"flexible: link {truncated(link)}: frequency_hz = {hertz!r}"
    if not 0 < young < math.inf:
        why = f"{specified}: needs young = {young:g} Pa, outside the range of float64"
        raise ArgumentError(why, id="frequency-out-of-reach")
    # do not use a path, because the name may contain any character
    stiffened = scene.varied({"material": scene.arm.materials | {name: msgspec.structs.replace(material, young=young)}})
    reached = clamped_frequency(stiffened, link)
    if not abs(reached / hertz - 1) <= 1e-6:
        raise ArgumentError(f"{specified}: young = {young:.4g} Pa gives {reached:.9g} Hz", id="frequency-out-of-reach")
    return stiffened


# What closes the loops of an imported robot: ties between the parts of the arm, and a note on each.


def ties_of(
    robot: Robot, way: Paths, links: Sequence[str], locked: Collection[str], *, afloat: bool
) -> Iterator[tuple[dict[str, Any] | None, Diagnostic]]:
    """Yield for each closure of a robot its tie, or None, and a note; `links` are the names of the parts' links."""
    for closure in robot.closures:
        (a, A, why_a), (b, B, why_b) = (_place(robot, way, locked, afloat, closure.kind, *end) for end in closure.ends)
        apart = "" if a != b else "what it holds does not move relative to each other"
        if lacks := closure.lacks or why_a or why_b or apart:
            yield None, Diagnostic(f"{closure.name}: the loop is not closed: {lacks}", "loop-left-out")
            continue
        tie = _tie(closure, links, (a, A), (b, B)) if a else _tie(closure, links, (b, B), (a, A))
        ends = " and ".join(link for link, _ in closure.ends)
        yield tie, Diagnostic(f"{closure.name}: a tie of kind {closure.kind} holds {ends}{closure.lost}", "loop-tied")


def _place(
    robot: Robot, way: Paths, locked: Collection[str], afloat: bool, kind: str, link: str, frame: Pose
) -> tuple[int, Pose, str]:
    """The part, 0 for frame 0, to which a link belongs, and a frame of the link there; or why no tie can hold it."""
    numbers = {part.joint.name: k for k, part in enumerate(way.parts, 1)}
    path = robot.path(robot.root, link) or []
    on = max((k for k, joint in enumerate(path, 1) if joint.name in numbers), default=0)
    number, rest = numbers[path[on - 1].name] if on else 0, path[on:]
    known = {*locked, *(joint.name for joint in robot.path(robot.root, way.base) or [])}
    why = f"the joint of {link} is fixed" if kind == "joint" and rest else ""
    if afloat and not number and robot.path(way.base, link) is not None:
        why = f"{link} is part of the floating base, which a tie cannot hold"
    if any(joint.moves and joint.name not in known for joint in rest):
        tips = dict.fromkeys([*(tip.link for tip in way.tips), link])
        why = f"{link} does not move by itself; it does with {' '.join(f'--tip {tip}' for tip in tips)}"
    return number, along(rest, way.positions).then(frame), why


def _tie(closure: Closure, links: Sequence[str], one: tuple[int, Pose], other: tuple[int, Pose]) -> dict[str, Any]:
    """The tie of a closure between a part and another part, or frame 0."""
    (a, A), (b, B) = one, other
    to: dict[str, Any] = {"link": links[b - 1]} if b else {}
    tie: dict[str, Any] = {"name": closure.name, "kind": closure.kind, "link": links[a - 1], "to": to}
    if closure.kind == "joint":
        return tie | ({"ratio": closure.ratio} if b else {})
    to["point"] = B.p.tolist()
    if closure.kind == "weld":
        to["rpy_deg"] = np.degrees(rpy_from_matrix(B.R @ A.R.T)).tolist()
    if closure.kind == "hinge":
        tie["axis"], to["axis"] = ((frame.R @ np.array(closure.axis)).tolist() for frame in (A, B))
    return tie | {"point": A.p.tolist()}
