"""flexlink: the arm as a scene, with cells of coupled springs, and motions with error control."""

from __future__ import annotations

import math

import numpy as np

import flexlink as fl
from flexarm_bench.case import Answer, Array, Case, Link, Settings

RULES = {"statics": "lobatto4", "buckling": "lobatto4", "frequencies": "lobatto4", "motion": "gauss"}
IN_SPACE = "lobatto2_rotation"
HINGES = {"statics": 32, "buckling": 64, "frequencies": 32, "motion": 20}
SEVERAL, TOLERANCE = 4, 1e-4  # hinges of links that fall together; part of the length by which a run may be off
RIGID = 1e6  # stiffness of a rigid direction, in terms of the largest other one
THIN = 1e-14  # second moment of a section without rotary inertia / length²
KNOTS = 301  # of a given motion or torque, which flexlink interpolates


def run(case: Case, settings: Settings) -> Answer:
    """Compute a case; settings: lumping `rule` and `hinges` of a link, `tolerance` of a motion, part of the length."""
    rule = str(settings.get("rule", RULES[case.ask] if case.planar else IN_SPACE))
    several = case.ask == "motion" and len(case.links) > 1
    hinges = int(settings.get("hinges", SEVERAL if several else HINGES[case.ask]))
    scene = _scene(case, rule, hinges, float(settings.get("tolerance", TOLERANCE)))
    values = {"statics": _statics, "buckling": _buckling, "frequencies": _frequencies, "motion": _motion}[case.ask]
    return Answer(values(case, scene), f"{rule}, {hinges} hinges a link")


def _statics(case: Case, scene: fl.Scene) -> Array:
    chain = fl.lump(scene)
    load = [*case.force, *case.moment]
    q = fl.solve_static(chain, tip_wrench=load, frame="tip" if case.follows else "world").q
    return np.asarray(fl.tip_position(chain, q) - fl.tip_position(chain, np.zeros(chain.n)))


def _buckling(case: Case, scene: fl.Scene) -> Array:
    return fl.strength.buckling_loads(fl.lump(scene), tip_wrench=[*case.force, *case.moment])[:1]


def _frequencies(case: Case, scene: fl.Scene) -> Array:
    chain = fl.lump(scene)
    spins = any(case.spin)
    q, qd = fl.initial_state(scene, chain)
    found = fl.modes(chain, q, qd, locked=["hub"] if spins else ())
    still = 0 if any(case.gravity) else sum(link.joint == "free" for link in case.links)
    return found.frequencies[still : still + case.modes]


def _motion(case: Case, scene: fl.Scene) -> Array:
    return np.array(fl.simulate(scene).tip[:, :2])


def _scene(case: Case, rule: str, hinges: int, tolerance: float) -> fl.Scene:
    spins = any(case.spin)
    hub = [fl.Link(name="hub", joint=fl.Joint(axis=case.spin))] if spins else []
    links = [_link(case, k, rule, hinges) for k in range(len(case.links))]
    last = case.links[-1]
    arm = fl.Arm(
        links=(*hub, *links),
        materials={link.name: _material(link) for link in case.links},
        sections={link.name: _section(link) for link in case.links},
        tip=fl.RigidBody(mass=last.end_mass, inertia=(last.end_inertia,) * 3),
    )
    rate = [math.degrees(float(np.linalg.norm(case.spin)))] if spins else []
    initial = fl.InitialState(
        joint_deg=(*[0.0] * len(hub), *(math.degrees(link.angle) for link in case.links)),
        rate_deg=(*rate, *[0.0] * len(links)),
    )
    scene = fl.Scene(name=case.name, arm=arm, gravity=case.gravity, initial=initial)
    return _driven(case, scene, tolerance) if case.ask == "motion" else scene


def _driven(case: Case, scene: fl.Scene, tolerance: float) -> fl.Scene:
    run = fl.RunSettings(
        method="auto", duration=case.times[-1], sample=case.times[1],
        tolerance=tolerance * sum(link.length for link in case.links),
    )  # fmt: skip
    change: dict[str, object] = {"run": run}
    if case.motion:
        t = np.linspace(0, case.motion.duration, KNOTS)
        angle, rate, acceleration = (tuple(np.degrees(each).tolist()) for each in case.motion.motion(t))
        change["motion"] = [
            fl.PrescribedMotion(
                link=case.links[0].name, times=tuple(t.tolist()), angle_deg=angle, rate_deg=rate,
                acceleration_deg=acceleration,
            )
        ]  # fmt: skip
    if case.torque:
        t = np.linspace(0, case.torque.duration, KNOTS)
        torques = tuple((each,) for each in case.torque.torque(t).tolist())
        change["drive"] = fl.Drive(kind="table", smooth=True, times=tuple(t.tolist()), torques=torques)
    return scene.varied(change)


def _link(case: Case, number: int, rule: str, hinges: int) -> fl.Link:
    link = case.links[number]
    before = case.links[number - 1] if number else None
    return fl.Link(
        name=link.name, length=link.length, flex="xyz" if link.bends_in_space else "z", segments=hinges + 1,
        lumping=rule, material=link.name, section=link.name,
        joint=fl.Joint(locked=link.joint == "clamped", armature=link.hub_inertia),
        hub=fl.RigidBody(mass=before.end_mass, inertia=(before.end_inertia,) * 3) if before else fl.RigidBody(),
    )  # fmt: skip


def _moduli(link: Link) -> tuple[float, float]:
    """Young's modulus, for an area of 1 m², and the second moment i_z that it belongs to."""
    stiffest = max(k for k in (link.EI, link.EI_y, link.GJ) if math.isfinite(k))
    rotary = link.rotary_inertia / link.mass_per_length
    i_z = rotary or THIN * link.length**2
    return (link.EI if math.isfinite(link.EI) else RIGID * stiffest) / i_z, i_z


def _material(link: Link) -> fl.Material:
    young, _ = _moduli(link)
    return fl.Material(young=young, poisson=0.0, density=link.mass_per_length, loss_time=link.loss_time)


def _section(link: Link) -> fl.Section:
    young, i_z = _moduli(link)
    i_y = link.EI_y / young if math.isfinite(link.EI_y) else i_z
    return fl.Section(
        shape="general", area=1.0, i_y=i_y, i_z=i_z, torsion=2 * link.GJ / young if math.isfinite(link.GJ) else i_z
    )
