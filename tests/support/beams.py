"""Arms of the beam benchmarks."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from flexlink import (
    Arm,
    Base,
    Chain,
    InitialState,
    Joint,
    Link,
    Material,
    Mount,
    RigidBody,
    RunSettings,
    Scene,
    Section,
    Wrench,
    details,
)
from tests.conftest import chain_of, flexible, make_scene

STEEL = Material(young=210e9, density=7850.0)
THIN = 1e-16
"""Second moment of area I so small that rotary inertia is negligible against ρ A L²; E = 1/I gives EI = 1."""


def rod(
    K: np.ndarray | Callable[[float], np.ndarray], κ: Callable[[float], Any], force: np.ndarray, length: float = 1.0,
    steps: int = 4,
) -> np.ndarray:  # fmt: skip
    """Tip of a clamped inextensible rod of stiffness K about x, y, z and curvature κ at rest, under a dead tip load."""
    held = K if callable(K) else lambda s: K

    def end(m0: np.ndarray, F: np.ndarray) -> np.ndarray:
        def slope(s: float, y: np.ndarray) -> np.ndarray:
            R, r = y[:9].reshape(3, 3), y[9:]
            bent = κ(s) + np.linalg.solve(held(s), R.T @ (m0 - np.cross(r, F)))
            return np.concatenate([np.cross(R, bent).ravel(), R[:, 0]])

        start = np.concatenate([np.eye(3).ravel(), np.zeros(3)])
        whole = solve_ivp(slope, (0, length), start, method="DOP853", rtol=1e-11, atol=1e-12)
        return whole.y[9:, -1]

    m0 = np.zeros(3)
    for F in np.linspace(1 / steps, 1, steps)[:, None] * force:
        m0 = root(lambda m: m - np.cross(end(m, F), F), m0, tol=1e-11).x  # noqa: B023
    return end(m0, force)


def thin_link(rule: str, hinges: int, name: str = "link", flex: str = "z", free: bool = False, **joint: float) -> Link:
    return Link(
        name=name, length=1.0, flex=flex, material="unit", section="thin", segments=hinges + 1, lumping=rule,
        joint=Joint(locked=not free, **joint),
    )  # fmt: skip


def thin_arm(
    *links: Link,
    tip: RigidBody | None = None,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    locked_deg: tuple[float, ...] | None = None,
) -> Chain:
    """Return Euler-Bernoulli links with EI = GJ = ρA = L = 1 and no rotary inertia."""
    arm = Arm(
        links=links,
        materials={"unit": Material(young=1 / THIN, poisson=-0.5, density=1.0)},
        sections={"thin": Section(shape="general", area=1.0, i_y=THIN, i_z=THIN, torsion=THIN)},
        tip=tip or RigidBody(),
    )
    return chain_of(arm, gravity, locked_deg)


def cantilever(rule: str, hinges: int, **fields: Any) -> Chain:
    """Return a clamped thin beam."""
    return thin_arm(thin_link(rule, hinges), **fields)


def torsion_bar(rule: str, hinges: int, tip_inertia: float = 0.0) -> tuple[Chain, list[int]]:
    """Return a bar with GJ = ρ I_p = L = 1, and its bending coordinates (to be locked)."""
    arm = Arm(
        links=(
            Link(
                name="bar", length=1.0, flex="xyz", material="unit", section="disc", segments=hinges + 1, lumping=rule,
                joint=Joint(locked=True),
            ),
        ),
        materials={"unit": Material(young=2.0, poisson=0.0, density=1.0)},
        sections={"disc": Section(shape="general", area=1e-6, i_y=0.5, i_z=0.5, torsion=1.0)},
        tip=RigidBody(inertia=(tip_inertia, 0.0, 0.0)),
    )  # fmt: skip
    chain = chain_of(arm, (0.0, 0.0, 0.0))
    return chain, [k for k, c in enumerate(chain.coordinates) if c.axis != 1]


def branching(**fields: object) -> Scene:
    """Two flexible arms on the ground, one on an elastic prismatic joint, the other with a prismatic hand."""
    belt = Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), viscous=0.5, armature=0.1, gear_stiffness=300.0)
    out = Joint(kind="prismatic", axis=(0.0, 1.0, 1.0))
    hand = RigidBody(mass=0.3, inertia=(0.01, 0.01, 0.01))
    return make_scene(
        flexible("left", "z", 3, joint=Joint(viscous=0.1), hub=hand),
        flexible("right", "xyz", 3, on="base", joint=belt, mount=Mount(rpy_deg=(20.0, 30.0, 180.0)), hub=hand),
        Link(name="hand", on="left", length=0.2, joint=out, hub=hand),
        gravity=(0.0, 9.81, 1.0),
        **fields,
    )


def steel_bars(thick: float = 0.01, *, links: int = 1, locked: bool = False, **situation: object) -> Scene:
    """Square bars of steel, 1 m each, which by default fall from the horizontal for half a second."""
    bent = {"flex": "z", "segments": 3} if locked else {}  # a scene without motion is refused
    bars = tuple(
        Link(name=f"bar{k}", length=1.0, material="steel", section="square", joint=Joint(locked=locked), **bent)
        for k in range(links)
    )
    square = Section(shape="rectangle", height=thick, width=thick)
    scene = Scene(
        name="bars", gravity=(0.0, -9.81, 0.0), initial=InitialState(joint_deg=(0.0,) * links),
        arm=Arm(links=bars, materials={"steel": STEEL}, sections={"square": square}),
        run=RunSettings(duration=0.5, sample=0.01, step=0.01),
    )  # fmt: skip
    return scene.varied(situation)


def satellite() -> Scene:
    """A free base with an initial rotation, a flexible panel, and a prismatic boom that carries two hands."""
    bar = {"material": "al", "section": "s"}
    links = (
        Link(name="panel", mount=Mount(xyz=(0.5, 0.0, 0.0)), length=2.0, flex="z", segments=3, **bar),
        Link(
            name="boom", on="base", mount=Mount(xyz=(-0.5, 0.0, 0.0), rpy_deg=(0.0, 20.0, 180.0)), length=1.0,
            joint=Joint(kind="prismatic", axis=(1.0, 0.0, 0.0), limits_m=(-1.0, 1.0), armature=2.0,
                           gear_stiffness=5e4, viscous=3.0), flex="xyz", segments=3, **bar,
        ),
        Link(name="left", on="boom", length=0.3, hub=RigidBody(mass=1.0, inertia=(0.01, 0.02, 0.025))),
        Link(name="right", on="boom", length=0.2, joint=Joint(axis=(0.0, 1.0, 0.0)),
                hub=RigidBody(mass=2.0, inertia=(0.03, 0.02, 0.025))),
    )  # fmt: skip
    arm = Arm(
        links=links, materials={"al": Material(young=70e9, density=2700.0)},
        sections={"s": Section(shape="circle", diameter=0.03)},
        base=Base(kind="free", mass=100.0, center=(0.1, 0.0, -0.1), inertia=(10.0, 12.0, 15.0)),
    )  # fmt: skip
    return Scene(
        name="satellite", arm=arm, gravity=(0.0, 0.0, -1.6),
        initial=InitialState(
            joint_deg=(0.0,) * 4, rate_deg=(5.0, 0.0, -20.0, 10.0), joint_m=(0.0, 0.2, 0.0, 0.0),
            base=details.BaseState(xyz=(1.0, 2.0, 3.0), rpy_deg=(20.0, -50.0, 130.0), velocity=(0.1, -0.2, 0.3),
                              spin_deg=(5.0, -3.0, 8.0)),
        ),
        wrench=Wrench(force=(1.0, 2.0, -3.0), moment=(0.5, 0.1, -0.2), on="left"),
        run=RunSettings(method="RK4", step=1e-4, duration=0.05, sample=0.01),
    )  # fmt: skip
