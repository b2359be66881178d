"""Arms of the beam benchmarks."""

from typing import Any

from flexlink import Arm, Chain, InitialState, Joint, Link, Material, RigidBody, RunSettings, Scene, Section
from tests.conftest import chain_of

STEEL = Material(young=210e9, density=7850.0)
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


def princeton_beam(rule: str, hinges: int) -> Chain:
    """Return the Princeton beam: 508 × 12.3777 × 3.2024 mm, height along y, aluminium 7075, without gravity."""
    arm = Arm(
        links=(
            Link(
                name="beam", length=0.508, flex="xyz", material="al7075", section="strip", segments=hinges + 1,
                lumping=rule, joint=Joint(locked=True),
            ),
        ),
        materials={"al7075": Material(young=71.7e9, poisson=0.31, density=2700.0)},
        sections={"strip": Section(shape="rectangle", height=12.3777e-3, width=3.2024e-3)},
    )  # fmt: skip
    return chain_of(arm, (0.0, 0.0, 0.0))


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
