"""Random trees of arms, and an independent Newton-Euler implementation: body by body, in frame 0."""

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import flexlink as fl
from flexlink.common.types import Array
from flexlink.describe.arm import Base
from tests.conftest import flexible, make_scene

Numbers = NDArray[np.inexact]


def random_tree(rng: np.random.Generator, links: int = 4, *, free: bool = False) -> fl.Chain:
    """The chain of `random_tree_scene`."""
    return fl.lump(random_tree_scene(rng, links, free=free))


def random_tree_scene(rng: np.random.Generator, links: int = 4, *, free: bool = False) -> fl.Scene:
    """Links of any kind on any earlier link or the base, with revolute or prismatic joints, some with elastic gears."""
    parts = []
    for number in range(links):
        flex = str(rng.choice(["rigid", "z", "xyz"]))
        on = str(rng.choice(["base", *(part.name for part in parts)])) if parts else None
        kind = str(rng.choice(["revolute", "prismatic"]))
        gear = {"gear_stiffness": rng.uniform(50, 100), "gear_damping": rng.uniform()} if rng.uniform() < 0.3 else {}
        joint = fl.Joint(
            kind=kind, axis=three(rng, 1.0), viscous=rng.uniform(), armature=rng.uniform(0.1, 1.0),
            coulomb=rng.uniform(), coulomb_width=1.0, **gear,
        )  # fmt: skip
        hub = fl.RigidBody(mass=rng.uniform(), center=three(rng, 0.1), inertia=(0.01, 0.02, 0.02))
        fields = {"mount": fl.Mount(rpy_deg=three(rng, 180.0), xyz=three(rng, 0.3)), "joint": joint, "hub": hub}
        fields |= {} if on is None else {"on": on}
        if flex == "rigid":
            link = fl.Link(
                name=f"l{number}", length=rng.uniform(0.1, 1.0), material="aluminium", section="square", **fields
            )
        else:
            link = flexible(f"l{number}", flex, int(rng.integers(2, 4)), **fields)
        parts.append(link)
    base = (
        Base(kind="free", mass=rng.uniform(1, 3), center=three(rng, 0.1), inertia=(1.0, 1.1, 1.2)) if free else Base()
    )
    scene = make_scene(
        *parts, tip=fl.RigidBody(mass=rng.uniform(), inertia=(0.01, 0.02, 0.02)), gravity=three(rng, 10.0)
    )
    scene = replace(scene, arm=replace(scene.arm, base=base))
    return replace(scene, wrench=fl.Wrench(on=str(rng.choice(list(fl.lump(scene).tips)))))


def three(rng: np.random.Generator, size: float) -> tuple[float, float, float]:
    """A random vector of three numbers."""
    x, y, z = rng.uniform(-size, size, 3)
    return float(x), float(y), float(z)


def torques(
    chain: fl.Chain, q: Numbers, qd: Numbers, qdd: Numbers, wrench: Array, *, follower: bool = False
) -> Numbers:
    """M q̈ + T_GC for angles, rates and accelerations, which may be complex."""
    frames, loads = [(np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3), -chain.gravity)], []
    axes, places = [], []
    for body in chain.bodies:
        R, p, ω, α, a = frames[body["parent"]]
        r = R @ body["translation"]
        p, a = p + r, a + np.cross(α, r) + np.cross(ω, np.cross(ω, r))
        R = R @ body["rotation"]
        for k in range(body["first"], body["stop"]):
            number, slides = divmod(chain.hinges["axis"][k], 3)[::-1]
            e = R[:, number]
            if slides:
                a = a + np.cross(α, e) * q[k] + np.cross(ω, np.cross(ω, e)) * q[k]
                a = a + 2 * np.cross(ω, e) * qd[k] + e * qdd[k]
                p = p + e * q[k]
            else:
                α = α + e * qdd[k] + np.cross(ω, e) * qd[k]
                ω = ω + e * qd[k]
                R = R @ turned(number, q[k])
            axes.append(e)
            places.append(p)
        c, I = R @ body["center"], R @ body["inertia"] @ R.T
        F = body["mass"] * (a + np.cross(α, c) + np.cross(ω, np.cross(ω, c)))
        N = I @ α + np.cross(ω, I @ ω)
        f, m = (R @ wrench[:3], R @ wrench[3:]) if follower else (wrench[:3], wrench[3:])
        loads.append((F, N, p + c, body["loaded"] * f, body["loaded"] * m, p))
        frames.append((R, p, ω, α, a))
    τ = chain.hinges["armature"] * qdd
    for i in range(len(chain.bodies)):
        F, N, center, f, m, tip = loads[i]
        number = i + 1
        while number:
            body = chain.bodies[number - 1]
            for k in range(body["first"], body["stop"]):
                if chain.slides[k]:
                    τ[k] += axes[k] @ (F - f)
                else:
                    τ[k] += axes[k] @ (N + np.cross(center - places[k], F) - m - np.cross(tip - places[k], f))
            number = body["parent"]
    return τ


def turned(axis: int, angle: complex) -> Numbers:
    """Rotation about a coordinate axis."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3, dtype=type(c))
    R[x, x], R[x, y], R[y, x], R[y, y] = c, -s, s, c
    return R


def slopes(chain: fl.Chain, q: Array, qd: Array, qdd: Array, wrench: Array, *, follower: bool = False) -> Array:
    """∂τ/∂q, ∂τ/∂q̇ and M by complex steps."""
    found, ε = np.zeros((3, chain.n, chain.n)), 1e-30
    for variable in range(3):
        for j in range(chain.n):
            state = np.array([q, qd, qdd], dtype=complex)
            state[variable, j] += 1j * ε
            found[variable, :, j] = torques(chain, *state, wrench, follower=follower).imag / ε
    return found


def satellite() -> fl.Scene:
    """A free base with an initial rotation, a flexible panel, and a prismatic boom that carries two hands."""
    bar = {"material": "al", "section": "s"}
    links = (
        fl.Link(name="panel", mount=fl.Mount(xyz=(0.5, 0.0, 0.0)), length=2.0, flex="z", segments=3, **bar),
        fl.Link(
            name="boom", on="base", mount=fl.Mount(xyz=(-0.5, 0.0, 0.0), rpy_deg=(0.0, 20.0, 180.0)), length=1.0,
            joint=fl.Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), limits_m=(-1.0, 1.0), armature=2.0,
                           gear_stiffness=5e4, viscous=3.0), flex="xyz", segments=3, **bar,
        ),
        fl.Link(name="left", on="boom", length=0.3, hub=fl.RigidBody(mass=1.0, inertia=(0.01, 0.02, 0.025))),
        fl.Link(name="right", on="boom", length=0.2, joint=fl.Joint(axis=(0.0, 1.0, 0.0)),
                hub=fl.RigidBody(mass=2.0, inertia=(0.03, 0.02, 0.025))),
    )  # fmt: skip
    arm = fl.Arm(
        links=links, materials={"al": fl.Material(young=70e9, density=2700.0)},
        sections={"s": fl.Section(shape="circle", diameter=0.03)},
        base=fl.Base(kind="free", mass=100.0, center=(0.1, 0.0, -0.1), inertia=(10.0, 12.0, 15.0)),
    )  # fmt: skip
    return fl.Scene(
        name="satellite", arm=arm, gravity=(0.0, 0.0, -1.6),
        initial=fl.InitialState(
            joint_deg=(0.0,) * 4, rate_deg=(5.0, 0.0, -20.0, 10.0), joint_m=(0.0, 0.2, 0.0, 0.0),
            base=fl.details.BaseState(xyz=(1.0, 2.0, 3.0), rpy_deg=(20.0, -50.0, 130.0), velocity=(0.1, -0.2, 0.3),
                              spin_deg=(5.0, -3.0, 8.0)),
        ),
        wrench=fl.Wrench(force=(1.0, 2.0, -3.0), moment=(0.5, 0.1, -0.2), on="left"),
        run=fl.RunSettings(method="RK4", step=1e-4, duration=0.05, sample=0.01),
    )  # fmt: skip
