"""What closes the loops of an imported robot: ties between the parts of the arm, and a note on each."""

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np

from flexlink.chain.rigid import Pose, rpy_from_matrix
from flexlink.common.errors import Diagnostic
from flexlink.robots.kinematic_tree import Closure, Robot
from flexlink.robots.paths import Paths, along


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
