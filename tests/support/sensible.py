"""Random arms that an engineer could have designed, with all numbers in SI, so no hint about units is expected."""

import math

import numpy as np

import flexlink as fl

MATERIALS = {
    "steel": fl.Material(young=2.1e11, density=7850.0),
    "aluminium": fl.Material(young=7e10, density=2700.0, poisson=0.33),
    "CFRP": fl.Material(young=1.4e11, density=1600.0), "titanium": fl.Material(young=1.14e11, density=4430.0),
    "wood": fl.Material(young=1.1e10, density=500.0), "nylon": fl.Material(young=2.5e9, density=1140.0, poisson=0.4),
    "spring steel": fl.Material(young=2.06e11, density=7800.0, loss_time=1e-5),
    "balsa": fl.Material(young=3e9, density=150.0), "magnesium": fl.Material(young=4.5e10, density=1740.0),
    "glass fibre": fl.Material(young=4e10, density=1900.0), "lead": fl.Material(young=1.6e10, density=11340.0),
}  # fmt: skip


def sensible_arm(seed: int) -> fl.Scene:
    """Arm of 0.05 to 60 m, slender or stubby, whose links can bear their load."""
    dice = np.random.default_rng(seed)
    name = str(dice.choice(list(MATERIALS)))
    material = MATERIALS[name]
    count = int(dice.integers(1, 5))
    total = float(10 ** dice.uniform(math.log10(0.05), math.log10(60.0)))
    parts = dice.dirichlet(np.full(count, 4.0)) * total
    least, most = (6.0, 60.0) if total < 10.0 else (18.0, 40.0)  # long booms are hollow and must bear their weight
    slender = float(10 ** dice.uniform(math.log10(least), math.log10(most)))
    h = total / slender
    links, sections = [], {}
    for k, part in enumerate(map(float, parts)):
        width = min(h * (1.0 - 0.15 * k), 0.6 * part)
        sections[f"s{k}"] = _section(dice, width)
        flex = str(dice.choice(["z", "yz", "xyz", "rigid"]))
        links.append(
            fl.Link(
                name=f"link{k}", length=round(part, 4), material=name, section=f"s{k}", flex=flex,
                segments=1 if flex == "rigid" else 3, joint=_joint(dice), hub=_motor(dice, width, material),
            )
        )  # fmt: skip
    mass = sum(material.density * sections[k.section].properties.area * k.length for k in links)
    tip = fl.RigidBody(mass=float(dice.choice([0.0, 0.1, 0.5, 1.5])) * mass)
    angles = tuple(round(float(a), int(dice.integers(0, 3))) for a in dice.uniform(-90, 90, count))
    down = [(0.0, 0.0, -9.81), (0.0, -9.81, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.62)]
    return fl.Scene(
        name=f"sensible {seed}", gravity=down[int(dice.integers(0, 4))], initial=fl.InitialState(joint_deg=angles),
        arm=fl.Arm(links=tuple(links), materials={name: material}, sections=sections, tip=tip),
        drive=_drive(dice, links, mass, tip.mass, total), run=_run(dice),
    )  # fmt: skip


def _section(dice: np.random.Generator, width: float) -> fl.Section:
    shapes = ["tube", "box"] if width > 0.4 else ["rectangle", "circle", "tube", "box", "strip"]
    match str(dice.choice(shapes)):
        case "rectangle":
            return fl.Section(shape="rectangle", height=width, width=0.5 * width)
        case "strip":
            return fl.Section(shape="rectangle", height=width, width=0.1 * width)
        case "circle":
            return fl.Section(shape="circle", diameter=width)
        case "box":
            return fl.Section(shape="box", height=width, width=0.8 * width, wall=0.05 * width)
        case _:
            return fl.Section(shape="tube", outer=width, inner=float(dice.uniform(0.7, 0.95)) * width)


def _joint(dice: np.random.Generator) -> fl.Joint:
    limits = None if dice.random() < 0.7 else (-170.0, 170.0)
    return fl.Joint(viscous=float(dice.choice([0.0, 0.1])), limits_deg=limits)


def _motor(dice: np.random.Generator, width: float, material: fl.Material) -> fl.RigidBody:
    if dice.random() < 0.5:
        return fl.RigidBody()
    mass = material.density * width**3
    return fl.RigidBody(mass=mass, inertia=(mass * width**2 / 6,) * 3)


def _drive(dice: np.random.Generator, links: list[fl.Link], mass: float, tip: float, reach: float) -> fl.Drive:
    holding = 9.81 * (mass / 2 + tip) * reach
    n = len(links)
    match int(dice.integers(0, 3)):
        case 0:
            return fl.Drive(kind="constant", torque=(holding,) + (0.0,) * (n - 1))
        case 1:
            stiff = 100 * holding
            return fl.Drive(kind="pd", kp=(stiff,) * n, kd=(0.1 * stiff,) * n, target_deg=(10.0,) * n, rate=1000.0)
        case _:
            return fl.Drive()


def _run(dice: np.random.Generator) -> fl.RunSettings:
    return [
        fl.RunSettings(), fl.RunSettings(tolerance=1e-4), fl.RunSettings(relative_tolerance=1e-3, duration=30.0),
    ][int(dice.integers(0, 3))]  # fmt: skip
