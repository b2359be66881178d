"""Hints on payloads, bodies, torques and forces, relative to the arm itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flexlink.common.wording import Diagnostic
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.material import Section
from flexlink.describe.plausibility.ranges import Range, hint_if_outside, ranges
from flexlink.describe.plausibility.situation import Situation, span
from flexlink.describe.plausibility.sizes import largest_dimension
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3

BRISK = 100.0
"""Plausible angular acceleration of a rotor [rad/s²]."""


def of_gravity(scene: Scene) -> Iterator[Diagnostic]:
    """Gravity in another unit, or in multiples of g."""
    g = math.hypot(*scene.gravity)
    yield from hint_if_outside("gravity", scene.gravity, "gravity_of_one" if g == 1.0 else "gravity", g)


def of_places(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Offsets and centres of mass far beyond the arm."""
    arm = scene.arm
    lengths = sum(span(link) for link in arm.links)
    points: list[tuple[str, Vector3, float]] = [("tip.center", arm.tip.center, about.reach)]
    for k, link in enumerate(arm.links, 1):
        path = arm.path(k)
        points += [(f"{path}.mount.xyz", link.mount.xyz, lengths if k > 1 else math.inf)]
        points += [(f"{path}.hub.center", link.hub.center, about.reach)]
        points += [(f"{path}.end.center", link.end.center, about.reach)]
    for path, point, size in points:
        far = math.hypot(*point)
        if far > 100.0 or (far > 3.0 and size > 0 and far > 20.0 * size):
            yield from hint_if_outside(path, point, "place", max(far, 100.1))


def of_bodies(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Inertias too large for their masses."""
    arm = scene.arm
    bodies: list[tuple[str, RigidBody]] = [("tip", arm.tip)]
    for k, link in enumerate(arm.links, 1):
        bodies += [(f"{arm.path(k)}.hub", link.hub), (f"{arm.path(k)}.end", link.end)]
    for path, body in bodies:
        largest = max(body.inertia)
        if body.mass > 0 and largest > 0:
            gyration = math.sqrt(largest / body.mass)
            if gyration > about.reach:
                yield from hint_if_outside(f"{path}.inertia", largest, "gyration", gyration, 0.5)


def of_joints(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Rotors, gears and root springs relative to what they move; torques relative to what they turn."""
    arm, drive = scene.arm, scene.drive
    whole = about.inertia()
    for k, link in enumerate(arm.links):
        path, joint = arm.path(k + 1), link.joint
        for axis, (stiffness, _) in link.root_springs.items():
            sag = about.moment(k) / stiffness
            yield from hint_if_outside(
                f"{path}.root_stiffness.{axis}", stiffness, "root_sag", sag, -1.0, f" {sag:.2g} rad"
            )
        if joint.slides:
            yield from _of_sliding_joint(scene, about, k)
            continue
        if whole > 0:
            yield from hint_if_outside(f"{path}.joint.armature", joint.armature, "armature", joint.armature / whole)
        if joint.gear_stiffness is not None:
            sag = about.moment(k) / joint.gear_stiffness
            yield from hint_if_outside(
                f"{path}.joint.gear_stiffness", joint.gear_stiffness, "gear_sag", sag, -1.0, f" {sag:.2g} rad"
            )
        usual = about.weight_moment(k) + BRISK * joint.armature
        for key, row in _torques(scene):
            if about.inertia(k) > 0:
                yield from hint_if_outside(arm.path(k + 1, key), row[k], "torque", abs(row[k]) / usual)
    if drive.rate is not None:
        yield from hint_if_outside("drive.rate", drive.rate, "rate", drive.rate)


def _of_sliding_joint(scene: Scene, about: Situation, k: int) -> Iterator[Diagnostic]:
    """The same for a prismatic joint: masses, forces, and positions far beyond the arm."""
    arm, joint = scene.arm, scene.arm.links[k].joint
    path, mass = arm.path(k + 1), about.mass(k)
    if mass > 0:
        usual = 9.81 * mass + BRISK * joint.armature
        for key, row in _torques(scene):
            yield from hint_if_outside(arm.path(k + 1, key), row[k], "force", abs(row[k]) / usual)
    if joint.gear_stiffness is not None and about.reach > 0:
        sag = about.force(k) / joint.gear_stiffness
        yield from hint_if_outside(
            f"{path}.joint.gear_stiffness", joint.gear_stiffness, "gear_slip", sag, -1.0, f" {sag:.2g} m"
        )
    travel = {f"{path}.joint.limits_m": joint.limits_m or (), arm.path(k + 1, "initial.joint_m"): (scene.starts[k],)}
    for key, positions in travel.items():
        # position of a prismatic joint beyond the travel of cranes [m]
        if positions and max(map(abs, positions)) > 100.0:
            yield from hint_if_outside(
                key, positions if len(positions) > 1 else positions[0], "place", max(map(abs, positions))
            )


def _torques(scene: Scene) -> list[tuple[str, Sequence[float]]]:
    drive = scene.drive
    rows: list[tuple[str, Sequence[float]]] = [("drive.torque", drive.torque)] if drive.torque else []
    if drive.torques:
        rows += [("drive.torques", tuple(max(map(abs, column)) for column in zip(*drive.torques, strict=True)))]
    return rows


def of_loads(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Strains at the roots of flexible links, with the arm stretched out, by weight, payload and wrench."""
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
        # Young's modulus below which a material can bear large strains [Pa]
        known = ranges()["strain_of_soft" if material.young < 5e9 else "strain"]
        if known.holds(strain):
            continue
        most = max(parts, key=lambda key: parts[key])
        yield _overload(arm, link, most if parts[most] > 10 * own else "", strain, known, scene)
        return  # one is enough: later links bear less of the same load


def _strain(E: float, section: Section, moment: float) -> float:
    """Strain of the outermost fibre, M c/(E I), bent about the stiffer axis: the smallest that the moment can cause."""
    _, i_y, i_z, _ = section.properties
    return moment * largest_dimension(section)[1] / 2 / (E * max(i_y, i_z))


def _overload(arm: Arm, link: Link, cause: str, strain: float, known: Range, scene: Scene) -> Diagnostic:
    """Hint on a strain: it names the load that causes most of it, or the material if that is too soft."""
    why = f"{link.name!r}, stretched out, would strain by {strain:.2g}: {known.reason}"
    young = f"material.{link.material}.young"
    E = arm.materials[link.material or ""].young
    if cause == "tip.mass":
        text = f"tip.mass = {arm.tip.mass:g} kg: {why}; likely given in g: in SI {arm.tip.mass / 1e3:g} kg"
    elif cause:
        value = getattr(scene.wrench, cause.partition(".")[2])
        unit = "mN" if cause == "wrench.force" else "N mm"
        text = f"{cause} = {list(value)}: {why}; likely given in {unit}: in SI a thousandth"
    elif strain < 1e3 * known.usual[1]:
        text = f"{young} = {E:g} Pa: {why}; likely given in kPa: in SI {E * 1e3:g} Pa"
    else:
        text = f"{young} = {E:g} Pa, section.{link.section}: {why}; check their units"
    return Diagnostic(text, "likely-unit")
