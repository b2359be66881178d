"""Arms of the beam benchmarks."""

from typing import Any

from flexlink import Arm, Chain, Joint, Link, Material, Mount, RigidBody, Scene, Section
from tests.conftest import chain_of, flexible, make_scene

THIN = 1e-16
"""Second moment of area I so small that rotary inertia is negligible against ρ A L²; E = 1/I gives EI = 1."""


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
