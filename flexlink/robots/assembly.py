"""The parts of a robot's path as the links of a scene."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from flexlink.chain.rigid import Pose
from flexlink.chain.rotation import rpy_from_matrix
from flexlink.common.errors import DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.describe.arm import Arm, Link
from flexlink.describe.conditions import InitialState, RunSettings
from flexlink.describe.joint import Joint, Mount
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3, short_list, truncated
from flexlink.robots.flexible import FlexibleLink, ImportedLink, bent, payload
from flexlink.robots.serial import Part, SerialPath


def origins_beyond(way: SerialPath) -> list[Array]:
    """By part, where the next joint, or of the last part the tip, is in its frame [m]."""
    return [*(part.origin.p for part in way.parts[1:]), way.end.p]


def assembled(
    name: str,
    way: SerialPath,
    flexible: Mapping[str, FlexibleLink],
    armature: Mapping[str, float],
    gravity: Vector3,
) -> tuple[Scene, list[ImportedLink]]:
    """The scene, and the links that it is made of; their Young's modulus is still that of their material.

    Raises
    ------
    DataFileError
        A part's inertia is none that a body can have, or nothing has inertia that the last joint moves.
    SceneError, ArgumentError
        As in `bent`; or a negative armature.
    """
    parts = list(_imported_links(way, flexible, armature))
    _check_last(parts[-1].link, [part.joint.parent for part in way.parts[1:]])
    links = [one.link for one in parts]
    links += _tip(way, _stop(links[-1]))
    starts = [math.degrees(way.positions[part.joint.name]) for part in way.parts]
    scene = Scene(
        name=name,
        about=f"{name} from {way.base} to {way.tip}, imported from URDF",
        arm=Arm(
            links=tuple(links),
            materials={one.link.name: one.material for one in parts if one.material is not None},
            sections={one.link.name: one.section for one in parts if one.section is not None},
        ),
        gravity=gravity,
        initial=InitialState(joint_deg=tuple(starts + [0.0] * (len(links) - len(starts)))),
        run=RunSettings(relative_tolerance=1e-4),
    )
    return scene, parts


def _imported_links(
    way: SerialPath, flexible: Mapping[str, FlexibleLink], armature: Mapping[str, float]
) -> Iterator[ImportedLink]:
    """Link by link."""
    at = np.zeros(3)  # where the link before ends, in the frame of its part
    for part, beyond in zip(way.parts, origins_beyond(way), strict=True):
        imported = ImportedLink(_rigid(part, at, armature.get(part.joint.name, 0.0)))
        if part.link in flexible:
            try:
                imported = bent(part, imported.link, flexible[part.link], beyond)
            except SceneError as error:
                raise SceneError(f"flexible: link {truncated(part.link)}: {error}") from None
        at = _stop(imported.link)
        yield imported


def _stop(link: Link) -> Array:
    """Where a link ends, in its frame [m]."""
    return np.array(link.line[1] if link.line else (0.0, 0.0, 0.0))


def _rigid(part: Part, before: Array, armature: float) -> Link:
    joint = part.joint
    try:
        hub = payload(part.body)
    except SceneError as error:
        folded = f" with {short_list(part.folded)}" if part.folded else ""
        raise DataFileError(f"link {truncated(part.link)}{folded}: {error}") from None
    x, y, z = joint.axis.tolist()
    lower, upper = map(math.degrees, joint.limits or (0.0, 0.0))
    return Link(
        name=part.link,
        mount=_mount(part.origin, before),
        joint=Joint(
            axis=(x, y, z),
            viscous=joint.damping,
            coulomb=joint.friction,
            armature=armature,
            limits_deg=(lower, upper) if lower < upper else None,  # many files say 0 and 0 for none
        ),
        hub=hub,
    )


def _mount(origin: Pose, before: Array) -> Mount:
    x, y, z = (origin.p - before + 0.0).tolist()
    roll, pitch, yaw = (_tidy(math.degrees(angle)) for angle in rpy_from_matrix(origin.R))
    return Mount(xyz=(x, y, z), rpy_deg=(roll, pitch, yaw))


def _tidy(degrees: float) -> float:
    """An angle without the rounding that made 89.99999999999999 of a right one."""
    near = round(degrees, 9)
    rounding = 1e-13  # few eps of half a turn
    return (near if abs(degrees - near) < rounding else degrees) + 0.0


def _tip(way: SerialPath, before: Array) -> list[Link]:
    """A rigid link that leads to the tip's frame, unless the last part is already there."""
    mount = _mount(way.end, before)
    if mount == Mount():
        return []
    taken = [part.link for part in way.parts]
    name = way.tip if way.tip not in taken else f"{way.tip} frame"
    return [Link(name=name, mount=mount, joint=Joint(locked=True))]


def _check_last(link: Link, before: Sequence[str]) -> None:
    """What the last joint moves has inertia; `before` are the links on which all joints but the first hang."""
    moved = link.hub.about(link.joint.direction) + link.joint.armature
    if moved == 0 and link.flex == "rigid":
        raise DataFileError(
            f"link {truncated(link.name)}: nothing beyond its joint has inertia; choose a tip before it"
            + "".join(f", as by --tip {name}" for name in before[-1:])
        )
