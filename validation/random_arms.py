"""Random arms of 1 to 6 links, serial or trees, that use every key of a link; the same seed gives the same arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import msgspec
import numpy as np

import flexlink as fl
from flexlink.describe.arm import BASE
from flexlink.describe.spec import Vector3

Convention = Literal["standard", "modified"]
LUMPING_RULES = ("gauss", "paper", "midpoint", "legendre")
FLEX, SHARES = ("rigid", "z", "yz", "xyz"), (0.4, 0.2, 0.2, 0.2)


class Dice:
    """Random numbers as plain Python numbers."""

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)

    def linear(self, low: float, high: float) -> float:
        """A number uniformly distributed between two limits."""
        return float(self.random.uniform(low, high))

    def decades(self, low: float, high: float) -> float:
        """10 to a uniformly distributed power."""
        return float(10.0 ** self.linear(low, high))

    def chance(self, share: float) -> bool:
        """Return True with this probability."""
        return bool(self.random.random() < share)

    def one_of(self, *values: Any, shares: tuple[float, ...] | None = None) -> Any:
        """One of the values, with equal or with given probabilities."""
        return values[int(self.random.choice(len(values), p=shares))]

    def three(self, size: float) -> Vector3:
        """Three uniform numbers from −size to size."""
        return self.linear(-size, size), self.linear(-size, size), self.linear(-size, size)

    def direction(self) -> Vector3:
        """A coordinate axis with either sign, or a random vector."""
        if self.chance(0.5):
            axis = [0.0, 0.0, 0.0]
            axis[self.one_of(0, 1, 2)] = self.one_of(-1.0, 1.0)
            return (axis[0], axis[1], axis[2])
        return self.three(1.0)


def random_arm(seed: int) -> fl.Scene:
    """A serial arm under gravity in a random configuration; one in four is given by Denavit-Hartenberg parameters."""
    dice = Dice(seed)
    table = dice.one_of(None, "standard", "modified", shares=(0.75, 0.15, 0.1))
    links = tuple(_link(dice, f"link{k}", table) for k in range(dice.one_of(1, 2, 3, 4, 5, 6)))
    if all(link.joint.locked and not link.elastic for link in links):
        links = (fl.Link(name="first", hub=_body(dice)), *links[1:])
    links, tables = _real(links, seed)
    return fl.Scene(
        name=f"random arm {seed}",
        arm=fl.Arm(
            links=links, rigidities=tables, sections=_sections(dice),
            tip=_body(dice) if dice.chance(0.5) else fl.RigidBody(),
            materials={"stuff": fl.Material(young=dice.decades(8, 11.5), density=dice.decades(3, 3.9),
                                            poisson=dice.linear(0.0, 0.5), loss_time=dice.one_of(0.0, 1e-4))},
        ),
        gravity=dice.three(9.81),
        initial=fl.InitialState(joint_deg=tuple(dice.linear(-90, 90) for _ in links)),
        run=fl.RunSettings(step=1e-4),
    )  # fmt: skip


def random_tree(seed: int) -> fl.Scene:
    """A branched arm with sliding joints, on the ground or on a floating base, in a random configuration."""
    dice = Dice(seed)
    names = [f"link{k}" for k in range(dice.one_of(2, 3, 4, 5, 6))]
    links: list[fl.Link] = []
    for k, name in enumerate(names):
        link = _link(dice, name, None)
        on = dice.one_of("", BASE, *names[:k])
        links.append(msgspec.structs.replace(link, on=on, joint=_sliding(dice, link.joint)))
    if all(link.joint.locked and not link.elastic for link in links):
        links[0] = msgspec.structs.replace(links[0], joint=fl.Joint())
    parents = {link.on or before for link, before in zip(links, ["", *names], strict=False)}
    free, base = (
        dice.chance(0.5),
        fl.details.BaseState(xyz=dice.three(1.0), quaternion=(dice.linear(-1, 1), *dice.three(1.0))),
    )
    body = _body(dice)
    real, tables = _real(links, seed)
    return fl.Scene(
        name=f"random tree {seed}",
        arm=fl.Arm(
            links=real, rigidities=tables, sections=_sections(dice),
            tip=_body(dice) if dice.chance(0.5) else fl.RigidBody(),
            materials={"stuff": fl.Material(young=dice.decades(8, 11.5), density=dice.decades(3, 3.9),
                                            poisson=dice.linear(0.0, 0.5), loss_time=dice.one_of(0.0, 1e-4))},
            base=fl.Base(kind="free", mass=body.mass, center=body.center, inertia=body.inertia) if free else fl.Base(),
        ),
        gravity=dice.three(9.81),
        initial=fl.InitialState(
            joint_deg=tuple(0.0 if link.joint.slides else dice.linear(-90, 90) for link in links),
            joint_m=tuple(dice.linear(-0.5, 0.5) if link.joint.slides else 0.0 for link in links),
            base=base if free else fl.details.BaseState(),
        ),
        wrench=fl.Wrench(on=dice.one_of(*(name for name in names if name not in parents))),
        run=fl.RunSettings(step=1e-4),
    )  # fmt: skip


def _sliding(dice: Dice, joint: fl.Joint) -> fl.Joint:
    """Turn two in five joints into sliding joints."""
    if not dice.chance(0.4):
        return joint
    limits = (-dice.linear(0.5, 1.0), dice.linear(0.5, 1.0)) if joint.limits_deg else None
    return msgspec.structs.replace(joint, kind="prismatic", limits_deg=None, limits_m=limits)


def _sections(dice: Dice) -> dict[str, fl.Section]:
    """Two sections, each with a scaled version of the same shape for the tip."""
    found = {}
    shapes: dict[str, Literal["rectangle", "tube"]] = {"bar": "rectangle", "pipe": "tube"}
    for name, shape in shapes.items():
        outer = dice.linear(0.02, 0.06)
        sizes = {"height": outer, "width": outer * dice.linear(0.3, 1.0)}
        sizes = sizes if name == "bar" else {"outer": outer, "inner": outer * dice.linear(0.0, 0.9)}
        taper = dice.linear(0.4, 1.0)
        found[name] = fl.Section(shape=shape, **sizes)
        found[f"{name}'s tip"] = fl.Section(shape=shape, **{key: taper * size for key, size in sizes.items()})
    return found


def _link(dice: Dice, name: str, table: Convention | None) -> fl.Link:
    flex = dice.one_of(*FLEX, shares=SHARES)
    beam = _beam(dice, flex) if flex != "rigid" or dice.chance(0.3) else {}
    return fl.Link(
        name=name, joint=_joint(dice, table), mount=fl.Mount() if table else _mount(dice), **beam, **_place(dice, beam),
        hub=_body(dice), end=_body(dice) if dice.chance(0.4) else fl.RigidBody(),
        dh=_row(dice, table) if table else None,
    )  # fmt: skip


def _real(links: Sequence[fl.Link], seed: int) -> tuple[tuple[fl.Link, ...], dict[str, fl.Rigidity]]:
    """Give some links soft roots or rigidity tables; a separate random generator keeps all else unchanged."""
    dice, tables, found = Dice(OF_BEAMS + seed), {}, []
    for link in links:
        own: dict[str, Any] = {}
        if link.material is not None and dice.chance(0.4):  # no link without material: a soft root must move mass
            axes = [axis for axis in "xyz" if dice.chance(0.6)] or ["z"]
            own["root_stiffness"] = fl.details.RootStiffness(**{axis: dice.decades(2, 5) for axis in axes})
            own["root_damping"] = fl.details.RootDamping(**{axes[0]: dice.decades(-1, 1)})
        if link.material is not None and dice.chance(0.25):
            tables[link.name] = _table(dice, link.beam.length)
            own |= {"rigidity": link.name, "material": None, "section": None, "section_tip": None}
        found.append(msgspec.structs.replace(link, **own))
    return tuple(found), tables


OF_BEAMS = 1_000_000
"""Seed offset of the generator for the properties of beams other than their sections."""


def _table(dice: Dice, length: float) -> fl.Rigidity:
    """A rigidity table of four rows with a jump."""
    jump = length * dice.linear(0.2, 0.8)

    def column(low: float, high: float) -> tuple[float, ...]:
        size = dice.decades(low, high)
        return tuple(size * dice.linear(0.7, 1.3) for _ in range(4))

    return fl.Rigidity(
        x=(0.0, jump, jump, length), ei_y=column(1, 4), ei_z=column(1, 4), gj=column(1, 4), rho_a=column(-1, 1),
        rho_i_y=column(-5, -3), rho_i_z=column(-5, -3), loss_time=dice.one_of(0.0, 1e-4),
    )  # fmt: skip


def _beam(dice: Dice, flex: str) -> dict[str, Any]:
    section = dice.one_of("bar", "pipe")
    rigid = flex == "rigid"
    return {
        "flex": flex, "segments": 1 if rigid else dice.one_of(3, 5), "lumping": dice.one_of(*LUMPING_RULES),
        "material": "stuff", "section": section, "section_tip": f"{section}'s tip" if dice.chance(0.4) else None,
        "damping": None if rigid or dice.chance(0.7) else fl.Damping(ratio=0.01, at_hz=dice.decades(0, 2)),
        "friction": None if rigid or dice.chance(0.7) else fl.Friction(coulomb=dice.decades(-2, 0)),
    }  # fmt: skip


def _place(dice: Dice, beam: dict[str, Any]) -> dict[str, Any]:
    """Axis of the link, along X or any line; sometimes with an orientation of the section."""
    up = {"up": dice.three(1.0)} if beam and dice.chance(0.3) else {}
    if beam and dice.chance(0.4):
        return {"length": dice.linear(0.2, 1.0)} | up
    start, way = np.array(dice.three(0.1)), np.array(dice.direction())
    stop = start + dice.linear(0.2, 1.0) * way / np.linalg.norm(way)
    return {"line": (tuple(start), tuple(stop))} | up if beam or dice.chance(0.5) else {}


def _joint(dice: Dice, table: Convention | None) -> fl.Joint:
    locked, elastic = dice.chance(0.1), dice.chance(0.25)
    gear = {"gear_stiffness": dice.decades(2, 5), "gear_damping": dice.one_of(0.0, 0.1)} if elastic else {}
    return fl.Joint(
        axis=(0.0, 0.0, 1.0) if table or dice.chance(0.2) else dice.direction(), locked=locked,
        viscous=dice.one_of(0.0, dice.decades(-2, 1)), coulomb=dice.one_of(0.0, dice.decades(-2, 1)),
        coulomb_width=dice.decades(-2, 0), armature=dice.decades(-3, 0) if elastic else dice.one_of(0.0, 0.05),
        limits_deg=(-dice.linear(90, 180), dice.linear(90, 180)) if dice.chance(0.5) else None, **gear,
    )  # fmt: skip


def _mount(dice: Dice) -> fl.Mount:
    xyz = dice.three(0.3) if dice.chance(0.6) else (0.0, 0.0, 0.0)
    turn = dice.one_of("", "rpy", "quarter", "rpy_deg")
    if turn == "quarter":
        return fl.Mount(xyz=xyz, rpy_deg=tuple(90.0 * dice.one_of(-1, 0, 1, 2) for _ in range(3)))
    angles = dice.three(np.pi)
    if turn == "rpy":
        return fl.Mount(xyz=xyz, rpy=angles)
    return fl.Mount(xyz=xyz, rpy_deg=tuple(map(np.degrees, angles))) if turn else fl.Mount(xyz=xyz)


def _row(dice: Dice, convention: Convention) -> fl.details.DenavitHartenberg:
    return fl.details.DenavitHartenberg(
        convention=convention, a=dice.one_of(0.0, dice.linear(-0.5, 0.5)), d=dice.one_of(0.0, dice.linear(-0.5, 0.5)),
        alpha_deg=dice.one_of(0.0, 90.0, -90.0, dice.linear(-180, 180)),
        theta_deg=dice.one_of(0.0, dice.linear(-180, 180)),
    )  # fmt: skip


def _body(dice: Dice) -> fl.RigidBody:
    """A body with the inertia of random point masses, sometimes all in one plane, or with the inertia of a box."""
    mass, size = dice.decades(-1, 1), dice.linear(0.02, 0.15)
    spread = dice.random.normal(0, size, (3, 3))
    covariance = mass * spread @ spread.T
    if dice.chance(0.2):  # all point masses in one plane
        directions, lengths, _ = np.linalg.svd(spread)
        covariance = mass * (directions[:, :2] * lengths[:2] ** 2) @ directions[:, :2].T
    I = np.trace(covariance) * np.eye(3) - covariance
    products = (I[0, 1], I[0, 2], I[1, 2]) if dice.chance(0.7) else ()
    if not products:
        I = np.diag(np.sort(covariance.diagonal()) + mass * size**2)  # as for a box: the triangle inequality is met
        I[2, 2] = min(I[2, 2], I[0, 0] + I[1, 1])
    center = dice.three(0.1) if dice.chance(0.7) else (0.0, 0.0, 0.0)
    return fl.RigidBody(mass=mass, center=center, inertia=(*I.diagonal(), *products))
