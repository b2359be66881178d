"""Build the links of a scene from the moving parts of a robot."""

import math
from collections.abc import Iterator, Mapping

import msgspec
import numpy as np

from flexlink.chain.coordinates import unique
from flexlink.chain.rigid import Pose, rpy_from_matrix
from flexlink.common.errors import DataFileError, SceneError
from flexlink.common.types import Array
from flexlink.common.wording import short_list, truncated
from flexlink.describe.arm import BASE, Arm, Base
from flexlink.describe.initial import BaseState, InitialState
from flexlink.describe.joint import Joint, Mount
from flexlink.describe.link import Link
from flexlink.describe.run_settings import RunSettings
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3
from flexlink.robots.flexible import FlexibleLink, ImportedLink, bent, payload
from flexlink.robots.kinematic_tree import Robot
from flexlink.robots.paths import Part, Paths


def assembled(
    robot: Robot, way: Paths, flexible: Mapping[str, FlexibleLink], armature: Mapping[str, float], gravity: Vector3
) -> tuple[Scene, list[ImportedLink]]:
    """Return the scene and its imported links; Young's moduli are not yet tuned to frequencies."""
    ends = short_list([tip.link for tip in way.tips])
    own = [part.link for part in way.parts]
    at_tips = [tip.link if tip.link not in own else f"{tip.link} frame" for tip in way.tips]
    # names of parts are the links', unless another part must refer to the base
    names = unique([BASE, *own, *at_tips]) if way.bears(0) > 1 else [BASE, *unique([*own, *at_tips])]
    parts = list(_imported_links(way, names, flexible, armature))
    links, starts = list[Link](), list[float]()
    for number, (part, imported) in enumerate(zip(way.parts, parts, strict=True), 1):
        links.append(_attached(imported.link, names[part.parent], links))
        starts.append(way.positions[part.joint.name])
        for k, tip in way.tips_on(number):
            mount = _mount(tip.place, _stop(imported.link))
            if mount != Mount() or way.bears(number) > 1:  # else the part itself ends at its only tip
                frame = Link(name=names[1 + len(way.parts) + k], mount=mount, joint=Joint(locked=True))
                links.append(_attached(frame, names[number], links))
                starts.append(0.0)
    slides = [link.joint.slides for link in links]
    angles = tuple(0.0 if slid else math.degrees(start) for start, slid in zip(starts, slides, strict=True))
    metres = tuple(start if slid else 0.0 for start, slid in zip(starts, slides, strict=True))
    base, pose = _base(way)
    materials = {one.link.name: one.material for one in parts if one.material is not None}
    sections = {one.link.name: one.section for one in parts if one.section is not None}
    scene = Scene(
        name=robot.name,
        about=f"{robot.name} from {way.base} to {ends}, imported from {robot.source}",
        arm=Arm(links=tuple(links), materials=materials, sections=sections, base=base),
        gravity=gravity,
        initial=InitialState(joint_deg=angles, joint_m=metres if any(slides) else None, base=pose),
        run=RunSettings(relative_tolerance=1e-4),
    )
    return scene, parts


def _attached(link: Link, on: str, before: list[Link]) -> Link:
    """Return the link with `on` set, unless its parent is the previous link or, for the first link, the base."""
    default = before[-1].name if before else BASE
    return link if on == default else msgspec.structs.replace(link, on=on)


def _base(way: Paths) -> tuple[Base, BaseState]:
    """Return the base and its initial state."""
    if way.free_base is None:
        return Base(), BaseState()
    place, body, folded = way.free_base
    mount = _mount(place, np.zeros(3))
    own = payload(body)
    try:
        base = Base(kind="free", mass=own.mass, center=own.center, inertia=own.inertia)
    except SceneError as error:
        others = f" with {short_list(folded)}" if folded else ""
        raise DataFileError(f"link {truncated(way.base)}{others}: {error}") from None
    return base, BaseState(xyz=mount.xyz, rpy_deg=mount.rpy_deg)


def _imported_links(
    way: Paths, names: list[str], flexible: Mapping[str, FlexibleLink], armature: Mapping[str, float]
) -> Iterator[ImportedLink]:
    """Yield the imported link of each part, from the base outward."""
    stops = [np.zeros(3)]  # end of the base and of each link, in the frame of its part
    for number, (part, beyond) in enumerate(zip(way.parts, way.beyond(), strict=True), 1):
        imported = ImportedLink(_rigid(part, names[number], stops[part.parent], armature.get(part.joint.name, 0.0)))
        if part.link in flexible:
            try:
                imported = bent(part, imported.link, flexible[part.link], beyond.p)
            except SceneError as error:
                raise SceneError(f"flexible: link {truncated(part.link)}: {error}") from None
        stops.append(_stop(imported.link))
        yield imported


def _stop(link: Link) -> Array:
    """Return the end of a link in its frame [m]."""
    return np.array(link.line[1] if link.line else (0.0, 0.0, 0.0))


def _rigid(part: Part, name: str, before: Array, armature: float) -> Link:
    joint = part.joint
    x, y, z = joint.axis.tolist()
    lower, upper = joint.limits or (0.0, 0.0)
    limited = lower < upper  # in many files 0 and 0 mean no limits
    moves = Joint(
        name=joint.name, kind="revolute" if joint.turns else "prismatic", axis=(x, y, z), viscous=joint.damping,
        coulomb=joint.friction, armature=armature,
        limits_deg=(math.degrees(lower), math.degrees(upper)) if limited and joint.turns else None,
        limits_m=(lower, upper) if limited and not joint.turns else None,
    )  # fmt: skip
    return Link(name=name, mount=_mount(part.origin, before), joint=moves, hub=payload(part.body))


def _mount(origin: Pose, before: Array) -> Mount:
    x, y, z = (origin.p - before + 0.0).tolist()
    roll, pitch, yaw = (_tidy(math.degrees(angle)) for angle in rpy_from_matrix(origin.R))
    return Mount(xyz=(x, y, z), rpy_deg=(roll, pitch, yaw))


def _tidy(degrees: float) -> float:
    """Round an angle to 9 decimals if that only removes a rounding error, as in 89.99999999999999."""
    near = round(degrees, 9)
    rounding = 1e-13  # a few eps times 180°
    return (near if abs(degrees - near) < rounding else degrees) + 0.0
