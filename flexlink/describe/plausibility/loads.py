"""Hints on payloads, bodies, torques and forces, relative to rough dimensions and masses of the arm itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import Diagnostic
from flexlink.describe.arm import Arm
from flexlink.describe.drive import Drive
from flexlink.describe.link import Link
from flexlink.describe.material import Section
from flexlink.describe.plausibility.sizes import Range, hint_if_outside, largest_dimension, ranges
from flexlink.describe.rigid_body import RigidBody
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Vector3

BRISK = 100.0
"""Plausible angular acceleration of a rotor [rad/s²]."""


def of_gravity(scene: Scene) -> Iterator[Diagnostic]:
    """Hint on gravity that was probably given in another unit, or in multiples of g."""
    g = math.hypot(*scene.gravity)
    yield from hint_if_outside("gravity", scene.gravity, "gravity_of_one" if g == 1.0 else "gravity", g)


def of_places(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on offsets more than 20 times as long as the arm, and on centres of mass beyond three times its reach."""
    arm = scene.arm
    lengths = sum(span(link) for link in arm.links)
    most = 3.0 * about.reach
    points: list[tuple[str, Vector3, float]] = [("tip.center", arm.tip.center, most)]
    for k, link in enumerate(arm.links, 1):
        path = arm.path(k)
        points += [(f"{path}.mount.xyz", link.mount.xyz, 20.0 * lengths if k > 1 else math.inf)]
        points += [(f"{path}.hub.center", link.hub.center, most), (f"{path}.end.center", link.end.center, most)]
    for path, point, limit in points:
        far = math.hypot(*point)
        if far > 100.0 or (far > 3.0 and far > limit > 0):
            yield from hint_if_outside(path, point, "place", max(far, 100.1))


def of_bodies(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on inertias that are too large for the mass of their body."""
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


def of_masses(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on a payload much heavier than a rigid arm, and on bodies that are too heavy for the arm's size."""
    arm, own = scene.arm, sum(about.masses)
    if own > 0 and all(link.flex == "rigid" for link in arm.links):  # else the strain decides
        yield from hint_if_outside("tip.mass", about.payload, "payload", about.payload / own)
    for k, link in enumerate(arm.links, 1):
        if about.reach > 0:
            yield from hint_if_outside(f"{arm.path(k)}.hub.mass", link.hub.mass, "mass", link.hub.mass / about.reach**3)


def of_joints(scene: Scene, about: Situation) -> Iterator[Diagnostic]:
    """Hints on rotors, gears, root springs and torques that are implausible for the masses they move."""
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
    yield from _of_controller(drive)


def _of_controller(drive: Drive) -> Iterator[Diagnostic]:
    """Hints on an implausible sampling rate of a controller, and on gains of a bandwidth as large as PD gains."""
    if drive.rate is not None:
        yield from hint_if_outside("drive.rate", drive.rate, "rate", drive.rate)
    if drive.kind in {"computed_torque", "cascade"} and drive.kp:
        bandwidth = max(drive.kp) if drive.kind == "cascade" else math.sqrt(max(drive.kp))
        yield from hint_if_outside("drive.kp", drive.kp, "bandwidth", bandwidth, detail=f" {bandwidth:.3g} rad/s")


def _of_sliding_joint(scene: Scene, about: Situation, k: int) -> Iterator[Diagnostic]:
    """Hints on a prismatic joint: forces and gears implausible for the mass it moves, and positions beyond 100 m."""
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
        # limit for positions of prismatic joints, larger than the travel of cranes [m]
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
        own = about.moment(k) - parts["tip.mass"]
        strain = _strain(material.young, section, own + sum(parts.values()))
        # materials with a Young's modulus below 5e9 Pa can bear larger strains
        known = ranges()["strain_of_soft" if material.young < 5e9 else "strain"]
        if known.holds(strain):
            continue
        most = max(parts, key=lambda key: parts[key])
        yield _overload(arm, link, most if parts[most] > 10 * own else "", strain, known, scene)
        return  # one hint is enough: later links bear less of the same load


def _strain(E: float, section: Section, moment: float) -> float:
    """Strain M c/(E I) of the outermost fibre for bending about the stiffer axis: the least strain that M can cause."""
    _, i_y, i_z, _ = section.properties
    return moment * largest_dimension(section)[1] / 2 / (E * max(i_y, i_z))


def _overload(arm: Arm, link: Link, cause: str, strain: float, known: Range, scene: Scene) -> Diagnostic:
    """Hint on a strain; names the load that causes most of the strain, or else the material, which may be too soft."""
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


# Rough dimensions and masses of an arm, relative to which loads, positions and rotors are checked.


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

    def moment(self, k: int) -> float:
        """Moment about the joint of link k (from 0) due to the weight, or handling force, of its subtree [N m]."""
        return self.pull * self._first_moment(k)

    def weight_moment(self, k: int) -> float:
        """Moment about the joint of link k (from 0) due to the subtree's weight on Earth [N m]."""
        return 9.81 * self._first_moment(k)

    def force(self, k: int) -> float:
        """Weight, or handling force, of link k (from 0) and its subtree, along the axis of its joint [N]."""
        return self.pull * self.mass(k)

    def mass(self, k: int = 0) -> float:
        """Mass of link k (from 0) and its subtree [kg]."""
        return sum(self.masses[k:]) + self.payload

    def inertia(self, k: int = 0) -> float:
        """Inertia of link k (from 0) and its subtree about its joint [kg m²]."""
        return self._first_moment(k) * max(sum(self.spans[k:]), 1e-3)

    def _first_moment(self, k: int) -> float:
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
            own += float(np.trapezoid(rows.masses[0], rows.x))
        masses.append(own)
    beyond = [*(math.hypot(*after.mount.xyz) for after in links[1:]), 0.0]
    spans = tuple(span(link) + more for link, more in zip(links, beyond, strict=True))
    return Situation(spans, tuple(masses), scene.arm.tip.mass, math.hypot(*scene.gravity))


def span(link: Link) -> float:
    """Distance from a link's joint to its end [m]."""
    return math.dist((0.0, 0.0, 0.0), link.stop)
