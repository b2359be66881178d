"""What hangs on an arm and turns it, beside the arm itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.material import Section
from flexlink.describe.plausibility.ranges import Range, ranges, told
from flexlink.describe.plausibility.situation import Situation, span
from flexlink.describe.plausibility.sizes import largest_dimension
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3

BRISK = 100.0
"""Angular acceleration that a drive may well give its rotor [rad/s²]."""


def of_gravity(scene: Scene) -> Iterator[str]:
    """Gravity in another unit, or in parts of that of the Earth."""
    g = math.hypot(*scene.gravity)
    yield from told("gravity", scene.gravity, "gravity_of_one" if g == 1.0 else "gravity", g)


def of_places(scene: Scene, about: Situation) -> Iterator[str]:
    """Offsets and centres of mass far beyond the arm."""
    arm = scene.arm
    lengths = sum(span(link) for link in arm.links)
    places: list[tuple[str, Vector3, float]] = [("tip.center", arm.tip.center, about.reach)]
    for k, link in enumerate(arm.links, 1):
        path = arm.path(k)
        places += [(f"{path}.mount.xyz", link.mount.xyz, lengths if k > 1 else math.inf)]
        places += [(f"{path}.hub.center", link.hub.center, about.reach)]
        places += [(f"{path}.end.center", link.end.center, about.reach)]
    for path, place, beside in places:
        far = math.hypot(*place)
        if far > 100.0 or (far > 3.0 and beside > 0 and far > 20.0 * beside):
            yield from told(path, place, "place", max(far, 100.1))


def of_bodies(scene: Scene, about: Situation) -> Iterator[str]:
    """Inertias that their masses cannot have."""
    arm = scene.arm
    bodies: list[tuple[str, RigidBody]] = [("tip", arm.tip)]
    for k, link in enumerate(arm.links, 1):
        bodies += [(f"{arm.path(k)}.hub", link.hub), (f"{arm.path(k)}.end", link.end)]
    for path, body in bodies:
        largest = max(body.inertia)
        if body.mass > 0 and largest > 0:
            gyration = math.sqrt(largest / body.mass)
            if gyration > about.reach:
                yield from told(f"{path}.inertia", largest, "gyration", gyration, 0.5)


def of_joints(scene: Scene, about: Situation) -> Iterator[str]:
    """Rotors, gears and roots beside what they move; torques beside what they turn."""
    arm, drive = scene.arm, scene.drive
    whole = about.inertia()
    for k, link in enumerate(arm.links):
        path, joint = arm.path(k + 1), link.joint
        for axis, (stiffness, _) in link.root_springs.items():
            sag = about.moment(k) / stiffness
            yield from told(f"{path}.root_stiffness.{axis}", stiffness, "root_sag", sag, -1.0, f" {sag:.2g} rad")
        if joint.slides:
            yield from _of_sliding_joint(scene, about, k)
            continue
        if whole > 0:
            yield from told(f"{path}.joint.armature", joint.armature, "armature", joint.armature / whole)
        if joint.gear_stiffness is not None:
            sag = about.moment(k) / joint.gear_stiffness
            yield from told(
                f"{path}.joint.gear_stiffness", joint.gear_stiffness, "gear_sag", sag, -1.0, f" {sag:.2g} rad"
            )
        usual = about.weight_moment(k) + BRISK * joint.armature
        for key, row in _torques(scene):
            if about.inertia(k) > 0:
                yield from told(arm.path(k + 1, key), row[k], "torque", abs(row[k]) / usual)
    if drive.rate is not None:
        yield from told("drive.rate", drive.rate, "rate", drive.rate)


def _of_sliding_joint(scene: Scene, about: Situation, k: int) -> Iterator[str]:
    """The same of one that slides: masses and forces, places far beyond the arm."""
    arm, joint = scene.arm, scene.arm.links[k].joint
    path, mass = arm.path(k + 1), about.mass(k)
    if mass > 0:
        usual = 9.81 * mass + BRISK * joint.armature
        for key, row in _torques(scene):
            yield from told(arm.path(k + 1, key), row[k], "force", abs(row[k]) / usual)
    if joint.gear_stiffness is not None and about.reach > 0:
        sag = about.force(k) / joint.gear_stiffness
        yield from told(f"{path}.joint.gear_stiffness", joint.gear_stiffness, "gear_slip", sag, -1.0, f" {sag:.2g} m")
    kept = {f"{path}.joint.limits_m": joint.limits_m or (), arm.path(k + 1, "initial.joint_m"): (scene.starts[k],)}
    for key, places in kept.items():
        # place along a sliding joint that is beyond what cranes reach [m]
        if places and max(map(abs, places)) > 100.0:
            yield from told(key, places if len(places) > 1 else places[0], "place", max(map(abs, places)))


def _torques(scene: Scene) -> list[tuple[str, Sequence[float]]]:
    drive = scene.drive
    rows: list[tuple[str, Sequence[float]]] = [("drive.torque", drive.torque)] if drive.torque else []
    if drive.torques:
        rows += [("drive.torques", tuple(max(map(abs, column)) for column in zip(*drive.torques, strict=True)))]
    return rows


def of_loads(scene: Scene, about: Situation) -> Iterator[str]:
    """Strains at the roots of flexible links, stretched out under weight, payload and wrench."""
    arm, wrench = scene.arm, scene.wrench
    force = max([math.hypot(*wrench.force), *(math.hypot(*row) for row in wrench.forces or ())])
    moment = max([math.hypot(*wrench.moment), *(math.hypot(*row) for row in wrench.moments or ())])
    for k, link in enumerate(arm.links):
        if link.flex == "rigid" or link.material is None or link.section is None:
            continue
        section, material = arm.sections[link.section], arm.materials[link.material]
        beyond = sum(about.spans[k:])
        parts = {
            "tip.mass": about.pull * about.payload * beyond, "wrench.force": force * beyond, "wrench.moment": moment,
        }  # fmt: skip
        own = about.moment(k) - parts["tip.mass"]
        strain = _strain(material.young, section, own + sum(parts.values()))
        # Young's modulus below which materials bear large strains [Pa]
        known = ranges()["strain_of_soft" if material.young < 5e9 else "strain"]
        if known.holds(strain):
            continue
        most = max(parts, key=lambda key: parts[key])
        yield _overload(arm, link, most if parts[most] > 10 * own else "", strain, known, scene)
        return  # one is enough: the next links bear less of the same


def _strain(E: float, section: Section, moment: float) -> float:
    """Of the outermost fibre, M c/(E I), bent about the stiffer axis: the least that such a moment does."""
    _, i_y, i_z, _ = section.properties
    return moment * largest_dimension(section)[1] / 2 / (E * max(i_y, i_z))


def _overload(arm: Arm, link: Link, cause: str, strain: float, known: Range, scene: Scene) -> str:
    """What a strain comes from: the load that makes most of it, or else a material that is too soft."""
    told = f"{link.name!r}, stretched out, would strain by {strain:.2g}: {known.reason}"
    if cause == "tip.mass":
        return f"tip.mass = {arm.tip.mass:g} kg: {told}; likely given in g: in SI {arm.tip.mass / 1e3:g} kg"
    if cause:
        value = getattr(scene.wrench, cause.partition(".")[2])
        unit = "mN" if cause == "wrench.force" else "N mm"
        return f"{cause} = {list(value)}: {told}; likely given in {unit}: a thousandth in SI"
    young = arm.materials[link.material or ""].young
    return (
        f"material.{link.material}.young = {young:g} Pa: {told}; likely given in kPa: in SI {young * 1e3:g} Pa"
        if strain < 1e3 * known.usual[1]
        else f"material.{link.material}.young = {young:g} Pa, section.{link.section}: {told}; look at their units"
    )
