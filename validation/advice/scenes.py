"""Random arms in situations for which users need advice. A seed always gives the same scene; none was used for tuning.

One to three links, from stiff to very soft, each bending about all physically possible axes; planar or in space;
falling, driven by a pulsed or constant torque, by a PD controller, or with prescribed motion; with random payload,
taper, friction, damping and tip load.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec.structs import replace

import flexlink as fl
from flexlink.describe.spec import Vector3
from validation.random_arms import Dice

SITUATIONS = ("falling", "pulse", "constant", "pd", "led")
"""Situations, used in turn as the seed increases; five planar scenes alternate with five spatial ones."""

SAMPLES = 100

SOFTEST_LINK = 0.2
"""Largest static deflection of a horizontal link under its outboard mass, divided by the link's length."""
MATERIALS = {
    "aluminium": fl.Material(young=70e9, density=2700.0, poisson=0.33),
    "steel": fl.Material(young=210e9, density=7850.0, poisson=0.3),
    "plastic": fl.Material(young=3e9, density=1200.0, poisson=0.4),
}

ROBOT_FILE = Path(__file__).with_name("three_axis.urdf")
SECTIONS_OF_ROBOT = {
    "upper": fl.Section(shape="tube", outer=0.03, inner=0.026),
    "fore": fl.Section(shape="tube", outer=0.02, inner=0.017),
}
"""Sections of the robot's flexible links."""


def random_scene(seed: int) -> fl.Scene:
    """An arm in a random situation."""
    dice = Dice(seed)
    situation, planar = SITUATIONS[seed % len(SITUATIONS)], (seed // len(SITUATIONS)) % 2 == 0
    stuff = dice.one_of(*MATERIALS)
    sections: dict[str, fl.Section] = {}
    links = tuple(_link(dice, k, stuff, sections, planar) for k in range(dice.one_of(1, 2, 2, 3)))
    material = replace(MATERIALS[stuff], loss_time=dice.one_of(0.0, 0.0, dice.decades(-5, -3)))
    mass = _mass(links, sections, material)
    tip = fl.RigidBody()
    if dice.chance(0.6):
        load = mass * dice.decades(-1.0, 0.3)
        tip = fl.RigidBody(mass=load, inertia=(load * 1e-3,) * 3)
    _thicken(links, sections, material, tip.mass)
    gravity = (0.0, -9.81, 0.0) if planar else dice.three(6.0)
    if situation != "falling" and dice.chance(0.3):
        gravity = (0.0, 0.0, 0.0)
    duration = dice.linear(0.4, 1.5)
    angles = tuple(dice.linear(-90.0, 90.0) for _ in links)
    arm = fl.Arm(links=links, materials={stuff: material}, sections=sections, tip=tip)
    scene = fl.Scene(
        name=f"{situation} {seed}", arm=arm, gravity=gravity, initial=fl.InitialState(joint_deg=angles),
        run=fl.RunSettings(duration=SAMPLES * (every := round(duration / SAMPLES, 4)), sample=every, step=every),
    )  # fmt: skip
    if dice.chance(0.2):
        scene = replace(scene, wrench=fl.Wrench(force=dice.three(2.0 * _mass(links[-1:], sections, material))))
    return _put_in(scene, situation, dice, _inertias(arm, material))


def tumbling_scene(seed: int) -> fl.Scene:
    """A planar arm without friction, released nearly upright: its motion is sensitive."""
    falling, dice = random_scene(2 * len(SITUATIONS) * seed), Dice(seed)
    links = tuple(replace(link, joint=fl.Joint(), damping=None) for link in falling.arm.links)
    angles = dice.linear(60.0, 120.0), *(dice.linear(-60.0, 60.0) for _ in links[1:])
    arm, run = replace(falling.arm, links=links), replace(falling.run, duration=10 * falling.run.duration)
    return replace(
        falling, name=f"tumbling {seed}", arm=arm, gravity=(0.0, -9.81, 0.0), wrench=fl.Wrench(), run=run,
        initial=fl.InitialState(joint_deg=angles),
    )  # fmt: skip


def released_scene(seed: int) -> fl.Scene:
    """An arm released from static equilibrium under its loads with locked joints; some are nearly rigid."""
    scene, dice = random_scene(seed), Dice(seed)
    thicker = dice.decades(0.0, 0.6)
    sections = {name: _scaled(section, thicker) for name, section in scene.arm.sections.items()}
    return replace(
        scene, name=f"released {scene.name}", arm=replace(scene.arm, sections=sections), motion=(),
        initial=replace(scene.initial, passive="static"),
    )  # fmt: skip


def robot_scene(duration: float) -> fl.Scene:
    """A three-axis robot from a URDF file with two flexible tubes as links; its waist turns while the arm falls."""
    flexible = {name: fl.FlexibleLink(section=section, flex="xyz") for name, section in SECTIONS_OF_ROBOT.items()}
    posture = {"waist": 0.3, "shoulder": -0.6, "elbow": 0.9}
    scene = fl.import_urdf(ROBOT_FILE, posture=posture, flexible=flexible).scene
    every = duration / SAMPLES
    run = replace(scene.run, duration=duration, sample=every)
    return replace(scene, initial=replace(scene.initial, rate_deg=(60.0, 0.0, 0.0)), run=run)


def _link(dice: Dice, k: int, stuff: str, sections: dict[str, fl.Section], planar: bool) -> fl.Link:
    length = dice.linear(0.3, 1.5)
    thick = length / dice.decades(1.2, 2.2)
    if dice.chance(0.5 if planar else 0.3):
        shape: dict[str, Any] = {"shape": "rectangle", "height": thick, "width": thick * dice.decades(-0.5, 0.7)}
    else:
        shape = {"shape": "tube", "outer": thick, "inner": thick * dice.linear(0.0, 0.9)}
    sections[f"s{k}"] = fl.Section(**shape)
    taper = dice.linear(0.4, 0.9) if dice.chance(0.25) else None
    if taper:
        sections[f"t{k}"] = fl.Section(**{key: taper * x if key != "shape" else x for key, x in shape.items()})
    friction: dict[str, Any] = {"coulomb": dice.decades(-1.5, 0.5), "coulomb_width": dice.decades(-1.5, -0.5)}
    joint = fl.Joint(
        viscous=dice.one_of(0.0, 0.0, dice.decades(-1.5, 0.5)), armature=dice.one_of(0.0, dice.decades(-2.5, -1.0)),
        **(friction if dice.chance(0.25) else {}),
    )  # fmt: skip
    rpy: Vector3 = (0.0, 0.0, 0.0) if planar else dice.one_of((0.0, 0.0, 0.0), (90.0, 0.0, 0.0), dice.three(90.0))
    motor = dice.decades(-1.0, 0.5) if dice.chance(0.4) else 0.0
    return fl.Link(
        name=f"link{k}", length=length, mount=fl.Mount(rpy_deg=rpy), joint=joint, material=stuff, section=f"s{k}",
        section_tip=f"t{k}" if taper else None, flex="xyz", segments=3,
        damping=fl.Damping(ratio=dice.linear(0.0, 0.05), at_hz=dice.decades(0.5, 1.5)) if dice.chance(0.2) else None,
        end=fl.RigidBody(mass=motor, inertia=(motor * 1e-3,) * 3) if motor else fl.RigidBody(),
    )  # fmt: skip


def _thicken(
    links: tuple[fl.Link, ...], sections: dict[str, fl.Section], material: fl.Material, outer_mass: float
) -> None:
    """From the tip inwards, thicken every link that bends by more than `SOFTEST_LINK` of its length.

    A cantilever has δ/L = 9.81 m L²/(3 E I). Scaling the thickness by s multiplies stiffness by s⁴ and weight by s².
    """
    for link in reversed(links):
        thinnest = sections[link.section_tip or link.section or ""].properties
        own = material.density * sections[link.section or ""].properties.area * link.length
        inertia = min(thinnest.i_y, thinnest.i_z)
        bent = 9.81 * (outer_mass + link.end.mass + own) * link.length**2 / (3 * material.young * inertia)
        scale = max(1.0, bent / SOFTEST_LINK) ** 0.5
        for name in filter(None, (link.section, link.section_tip)):
            sections[name] = _scaled(sections[name], scale)
        outer_mass += link.end.mass + scale**2 * own


def _scaled(section: fl.Section, scale: float) -> fl.Section:
    """Scale all sizes of a section."""
    sizes = {k: scale * v for k, v in msgspec.structs.asdict(section).items() if isinstance(v, float)}
    return replace(section, **sizes)


def _mass(links: tuple[fl.Link, ...], sections: dict[str, fl.Section], material: fl.Material) -> float:
    beams = sum(link.length * sections[link.section or ""].properties.area for link in links) * material.density
    return float(beams + sum(link.end.mass for link in links))


def _inertias(arm: fl.Arm, material: fl.Material) -> list[float]:
    """For each joint, the moment of inertia of all outboard links about it, as the rods of a straight arm [kg m²]."""
    found, outer_mass, reach = [], arm.tip.mass, 0.0
    for link in reversed(arm.links):
        beam = arm.sections[link.section or ""].properties.area * material.density * link.length
        outer_mass, reach = outer_mass + link.end.mass + beam / 3, reach + link.length
        found.append(outer_mass * reach**2)
        outer_mass += 2 * beam / 3
    return found[::-1]


def _put_in(scene: fl.Scene, situation: str, dice: Dice, inertias: list[float]) -> fl.Scene:
    """Add the `situation`: drive torques for accelerations of a few rad/s², or moves that end before the run does."""
    end = scene.run.duration
    torques = [dice.linear(-8.0, 8.0) * inertia for inertia in inertias]
    if situation == "pulse":
        t = np.linspace(0.0, end, 31)
        x = t / (end * dice.linear(0.4, 1.0))
        shape = np.where(x < 1, np.sin(2 * np.pi * np.minimum(x, 1.0)), 0.0)
        table = tuple(tuple(float(torque * y) for torque in torques) for y in shape)
        return replace(scene, drive=fl.Drive(kind="table", smooth=True, times=tuple(t.tolist()), torques=table))
    if situation == "constant":
        return replace(scene, drive=fl.Drive(kind="constant", torque=tuple(torques)))
    if situation == "pd":
        k = dice.decades(1.0, 2.0)
        targets = tuple(q + dice.linear(-60.0, 60.0) for q in scene.initial.joint_deg)
        kp = tuple(k * inertia for inertia in inertias)
        kd = tuple(2 * dice.linear(0.5, 1.0) * g / np.sqrt(k) for g in kp)
        return replace(scene, drive=fl.Drive(kind="pd", kp=kp, kd=tuple(map(float, kd)), target_deg=targets))
    if situation == "led":
        motions = tuple(_move(dice, f"link{k}", q, end) for k, q in enumerate(scene.initial.joint_deg))
        initial = replace(scene.initial, passive="static") if dice.chance(0.6) else scene.initial
        return replace(scene, motion=motions, initial=initial)
    return scene


def _move(dice: Dice, link: str, angle: float, end: float) -> fl.PrescribedMotion:
    """A move from rest to rest that ends before the run ends."""
    zero, there = (0.0, 0.0), angle + dice.linear(-80.0, 80.0)
    times = (0.0, end * dice.linear(0.4, 0.9))
    return fl.PrescribedMotion(link=link, times=times, angle_deg=(angle, there), rate_deg=zero, acceleration_deg=zero)
