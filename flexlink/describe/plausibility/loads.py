"""Hints on payloads, bodies, torques and forces, relative to rough dimensions and masses of the arm itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.describe.arm import Arm
from flexlink.describe.link import Link
from flexlink.describe.plausibility.sizes import hint_if_outside, largest_dimension, shown
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.scene import Scene


def of_places(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on offsets more than 20 times as long as the arm, and on centres of mass beyond three times its reach."""
    arm = scene.arm
    lengths = sum(span(link) for link in arm.links)
    points = [(f"{path}.center", body.center, 3.0 * about.reach) for path, body in bodies(arm)]
    from_ends = [("tip.center", arm.tip.center, arm.links[-1])]
    for k, (link, parent) in enumerate(zip(arm.links, arm.parents, strict=True), 1):
        path = arm.path(k)
        from_ends += [(f"{path}.mount.xyz", link.mount.xyz, arm.links[parent - 1])] if parent else []
        from_ends += [(f"{path}.end.center", link.end.center, link)]
        points += [(f"{path}.mount.xyz", link.mount.xyz, 20.0 * lengths if k > 1 else math.inf)]
    for path, point, link in from_ends:
        if link.length and point == (link.length, 0.0, 0.0):
            text = f"{path} = {shown(point)} m: is measured from the end of {link.name!r}, whose length this is"
            yield Diagnostic(f"{text}; leave it out", "length-twice")
    for path, point, limit in points:
        far = math.hypot(*point)
        if far > 100.0 or (far > 3.0 and far > limit > 0):
            yield from hint_if_outside(path, point, "place", max(far, 100.1))


def bodies(arm: Arm) -> list[tuple[str, RigidBody]]:
    """The payload and the rigid bodies of all links, with their paths."""
    parts = [(k, link, key) for k, link in enumerate(arm.links, 1) for key in ("hub", "end")]
    return [("tip", arm.tip), *((f"{arm.path(k)}.{key}", getattr(link, key)) for k, link, key in parts)]


def of_bodies(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on inertias that are too large for the mass of their body, and on masses that are given twice."""
    arm, last = scene.arm, scene.arm.links[-1].end
    for path, body in bodies(arm):
        if body.mass > 0 and (gyration := math.sqrt(max(0.0, *body.inertia) / body.mass)) > about.reach:
            yield from hint_if_outside(f"{path}.inertia", max(body.inertia), "gyration", gyration, 0.5)
    for k, (link, mass) in enumerate(zip(arm.links, about.masses, strict=True), 1):
        hub, beam, middle = link.hub, mass - link.hub.mass - link.end.mass, (link.length / 2, 0.0, 0.0)
        # the mass of a complete link, as in a URDF file, up to its flanges
        if beam and 0.9 < hub.mass / beam < 1.2 and math.dist(hub.center, middle) < 0.1 * link.length:
            text = f"{arm.path(k)}.hub.mass = {hub.mass:g} kg: the beam has {beam:.4g} kg in the same place"
            yield Diagnostic(f"{text}; leave hub out, or material and section", "mass-twice")
    if arm.tip.mass and (last.mass, last.center) == (arm.tip.mass, arm.tip.center):
        text = f"{arm.path(len(arm.links))}.end.mass = {last.mass:g} kg: tip has the same mass in the same place"
        yield Diagnostic(f"{text}; leave one of them out", "mass-twice")


def of_masses(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on a payload much heavier than a rigid arm, and on bodies that are too heavy for the arm's size."""
    arm, own = scene.arm, sum(about.masses)
    if own > 0 and all(link.flex == "rigid" for link in arm.links):  # else the strain decides
        yield from hint_if_outside("tip.mass", about.payload, "payload", about.payload / own)
    for k, link in enumerate(arm.links, 1):
        if about.reach > 0:
            yield from hint_if_outside(f"{arm.path(k)}.hub.mass", link.hub.mass, "mass", link.hub.mass / about.reach**3)


def of_joints(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on rotors, gears, springs and torques that are implausible for the masses they move, and on controllers."""
    arm, whole, drive = scene.arm, about.inertia, scene.drive
    torques: list[tuple[str, Sequence[float]]] = [("drive.torque", drive.torque)] if drive.torque else []
    if drive.torques:
        torques.append(("drive.torques", [max(map(abs, column)) for column in zip(*drive.torques, strict=True)]))
    for k, link in enumerate(arm.links):
        path, joint, kind = arm.path(k + 1), link.joint, link.joint.terms
        for axis, (stiffness, _) in link.root_springs.items():
            sag, key = about.pull * about.first_moment(k) / stiffness, f"{path}.root_stiffness.{axis}"
            yield from hint_if_outside(key, stiffness, "root_sag", sag, -1.0, f" {sag:.2g} rad")
        if whole > 0 and not joint.slides:
            yield from hint_if_outside(f"{path}.joint.armature", joint.armature, "armature", joint.armature / whole)
        moved = about.mass(k) if joint.slides else about.first_moment(k)
        if (stiffness := joint.gear_stiffness or 0.0) and about.reach > 0:
            sag, name = about.pull * moved / stiffness, "gear_slip" if joint.slides else "gear_sag"
            detail = f" {sag:.2g} {kind.si}"
            yield from hint_if_outside(f"{path}.joint.gear_stiffness", stiffness, name, sag, -1.0, detail)
        usual = 9.81 * moved + 100.0 * joint.armature  # with a rotor that accelerates by 100 rad/s²
        for key, row in torques if moved > 0 else ():
            yield from hint_if_outside(arm.path(k + 1, key), row[k], kind.load, abs(row[k]) / usual)
    if drive.kind in {"computed_torque", "cascade"} and drive.kp:
        most, name = (max(drive.kp), "position_") if drive.kind == "cascade" else (math.sqrt(max(drive.kp)), "")
        yield from hint_if_outside("drive.kp", drive.kp, f"{name}bandwidth", most, detail=f" {most:.3g} rad/s")


def of_loads(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hint on an implausible strain at the root of a flexible link, if the arm were stretched out under its loads."""
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
        own = about.pull * about.first_moment(k) - parts["tip.mass"]
        # strain M c/(E I) of the outermost fibre about the stiffer axis: the least strain that the moment can cause
        stiff = material.young * max(section.properties[1:3])
        strain = (own + sum(parts.values())) * largest_dimension(section)[1] / 2 / stiff
        cause = max(parts, key=lambda key: parts[key])
        key, power = cause.partition(".")[2], 1.0
        path, value = cause, about.payload if key == "mass" else getattr(wrench, key)
        if parts[cause] <= 10 * own:
            path, value, power, key = f"material.{link.material}.young", material.young, -1.0, "young"
        # materials with a Young's modulus below 5e9 Pa can bear larger strains
        name = f"strain{'_of_soft' * (material.young < 5e9)}_by_{key}"
        detail = f"; {link.name!r}, stretched out, would strain by {strain:.2g}"
        if found := list(hint_if_outside(path, value, name, strain, power, detail)):
            yield from found
            return  # one hint is enough: later links bear less of the same load


class Situation(NamedTuple):
    """Rough dimensions and masses of an arm that is stretched out."""

    spans: tuple[float, ...]  # from each link's joint to the next joint [m]
    masses: tuple[float, ...]  # of each link, including hub and end [kg]
    payload: float  # kg
    gravity: float  # m/s²

    @property
    def reach(self) -> float:
        """Sum of all spans [m]."""
        return sum(self.spans)

    @property
    def pull(self) -> float:
        """Gravity, or at least a typical acceleration during handling [m/s²]."""
        # 0.3 m/s²: typical acceleration during handling, which is the load if there is no gravity, as in space
        return max(self.gravity, 0.3)

    def mass(self, k: int) -> float:
        """Mass of link k (from 0) and its subtree [kg]."""
        return sum(self.masses[k:]) + self.payload

    @property
    def inertia(self) -> float:
        """Inertia of the arm about its first joint [kg m²]."""
        return self.first_moment(0) * max(sum(self.spans), 1e-3)

    def first_moment(self, k: int) -> float:
        """First moment of mass of link k (from 0) and its subtree about its joint [kg m]."""
        first, at = 0.0, 0.0
        for span, mass in zip(self.spans[k:], self.masses[k:], strict=True):
            first += mass * (at + span / 2)
            at += span
        return first + self.payload * at


def situation_of(scene: Scene) -> Situation:
    """Return the rough dimensions and masses of a scene's arm."""
    links = scene.arm.links
    masses = []
    for link in links:
        own = link.hub.mass + link.end.mass
        if link.section is not None and link.material is not None:
            area = scene.arm.sections[link.section].properties.area
            own += scene.arm.materials[link.material].density * area * link.beam.length
        if link.rigidity is not None:
            rows = scene.arm.rigidities[link.rigidity].rows
            own += float(np.trapezoid(rows.masses[0], rows.x) / rows.x[-1] * link.beam.length)
        masses.append(own)
    beyond = [*(math.hypot(*after.mount.xyz) for after in links[1:]), 0.0]
    spans = tuple(span(link) + more for link, more in zip(links, beyond, strict=True))
    return Situation(spans, tuple(masses), scene.arm.tip.mass, math.hypot(*scene.gravity))


def span(link: Link) -> float:
    """Distance from a link's joint to its end [m]."""
    return math.dist((0.0, 0.0, 0.0), link.stop)
