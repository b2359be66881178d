"""Random arms that move, by family of what makes a tolerance hard to keep; the same seed gives the same scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

import flexlink as fl
from flexlink.chain.lumping import lump
from flexlink.dynamics.vibration.extremes import fastest_frequency
from flexlink.motion.inputs.initial_state import initial_state
from validation.random_arms import Dice

Family = Literal["undamped", "free", "switched", "saturated", "driven", "sampled", "python law", "damped"]
FAMILIES: tuple[Family, ...] = get_args(Family)
MOST = 4e4  # largest fastest frequency times duration [rad]
MATERIALS = {"steel": (210e9, 7850.0), "aluminium": (70e9, 2700.0), "carbon": (120e9, 1600.0)}


class Moving(NamedTuple):
    """A scene, and arguments of `simulate` that a scene cannot hold: a law in Python."""

    scene: fl.Scene
    arguments: Mapping[str, Any] = MappingProxyType({})
    same_drive: Mapping[str, Any] = MappingProxyType({})  # changes that give the scene the law in Python as a drive


def moving(family: Family, seed: int) -> Moving:
    """A random arm of a family, with gains that follow from its rigid inertias.

    It is drawn again until its vibrations can be followed by a reference, and a sampled loop is stable.
    """
    dice, drawn = Dice(10_000 * FAMILIES.index(family) + seed), None
    while drawn is None or not (_can_be_followed(drawn.scene) and _is_stable(drawn)):
        drawn = _drawn(dice, family, seed)
    return drawn


def _can_be_followed(scene: fl.Scene) -> bool:
    chain = lump(scene)
    return fastest_frequency(chain, initial_state(scene, chain)[0]) * scene.run.duration < MOST


def _is_stable(drawn: Moving) -> bool:
    scene = drawn.scene.varied(drawn.same_drive) if drawn.same_drive else drawn.scene
    return scene.drive.rate is None or fl.loop(scene).growth <= 1.0


def _drawn(dice: Dice, family: Family, seed: int) -> Moving:
    number = dice.one_of(1, 2, 2, 3, 3, 4)
    damped = family == "damped" or (family not in {"undamped", "free"} and dice.chance(0.5))
    planar, tree = dice.chance(0.4), number > 2 and dice.chance(0.25)
    links = tuple(_link(dice, k, planar, damped, tree and k == number - 1) for k in range(number))
    materials = {
        name: fl.Material(young=E, density=ρ, poisson=0.3, loss_time=dice.decades(-5, -3.5) if damped else 0.0)
        for name, (E, ρ) in MATERIALS.items()
    }
    free = fl.Base(kind="free", mass=20.0, inertia=(1.0, 1.0, 1.0)) if family == "free" else fl.Base()
    start = tuple(dice.linear(-90, 90) for _ in links)
    arm = fl.Arm(
        links=links, materials=materials, sections={f"s{k}": _section(dice) for k in range(number)}, base=free,
        tip=fl.RigidBody(mass=dice.decades(-1, 0.7), inertia=(1e-3, 1e-3, 1e-3)),
    )  # fmt: skip
    duration = dice.one_of(2.0, 2.0, 2.0, 10.0)
    scene = fl.Scene(
        name=f"{family} {seed}", arm=arm, gravity=(0.0,) * 3 if family == "free" else (0.0, -9.81, 0.0),
        initial=fl.InitialState(joint_deg=start, rate_deg=_rates(dice, family, number)),
        run=fl.RunSettings(duration=duration, sample=0.02),
    )  # fmt: skip
    chain = lump(scene.varied({"link.*.joint.gear_stiffness": None}))
    J = np.diag(fl.mass_matrix(chain, chain.rest))[chain.active]
    return _driven(dice, family, scene, J)


def _link(dice: Dice, k: int, planar: bool, damped: bool, branch: bool) -> fl.Link:
    flex, modes = dice.one_of("rigid", "z", "z", "yz", "xyz") if not planar else dice.one_of("rigid", "z", "z"), None
    segments = 1 if flex == "rigid" else dice.one_of(3, 3, 3, 5)
    if flex in {"z", "yz"} and dice.chance(0.2):
        modes = 2
    axis = (0.0, 0.0, 1.0) if planar else dice.one_of((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    gear = dice.decades(2.5, 5) if dice.chance(0.3) else None
    joint = fl.Joint(
        axis=axis, armature=dice.decades(-2.5, -1) if gear or dice.chance(0.5) else 0.0,
        viscous=dice.decades(-2, 0) if damped else 0.0, gear_stiffness=gear,
    )  # fmt: skip
    return fl.Link(
        name=f"l{k}", length=dice.linear(0.3, 1.0), flex=flex, segments=segments, joint=joint, modes=modes,
        material=dice.one_of(*MATERIALS), section=f"s{k}", on="l0" if branch else "",
        damping=fl.Damping(ratio=dice.linear(0.002, 0.03), at_hz=20.0) if damped and flex != "rigid" else None,
    )  # fmt: skip


def _section(dice: Dice) -> fl.Section:
    size = dice.linear(0.01, 0.04)
    if dice.chance(0.4):
        return fl.Section(shape="rectangle", height=size, width=dice.linear(0.05, 0.5) * size)
    return fl.Section(shape="tube", outer=size, inner=dice.linear(0.5, 0.9) * size)


def _rates(dice: Dice, family: Family, number: int) -> tuple[float, ...]:
    size = 120.0 if family in {"undamped", "free", "damped"} else 0.0
    return tuple(dice.linear(-size, size) for _ in range(number))


def _driven(dice: Dice, family: Family, scene: fl.Scene, J: np.ndarray) -> Moving:
    if family in {"undamped", "damped"} or (family == "free" and dice.chance(0.3)):
        return Moving(scene)
    if family in {"switched", "free"}:
        return Moving(scene.varied({"drive": _table(dice, J)}))
    kind: Any = dice.one_of("pd", "computed_torque") if family == "driven" else "pd"
    kind = dice.one_of("pd", "pd", "cascade", "computed_torque") if family == "sampled" else kind
    ω, ζ = dice.linear(3.0, 12.0), dice.linear(0.5, 1.2)
    rate = 50.0 * round(dice.decades(0.0, math.log10(40))) if family in {"sampled", "python law"} else None
    late = dice.linear(0, 1) / rate if rate and dice.chance(0.3) else 0.0
    unit = {"pd": (ω * J, J), "cascade": (J**0, J), "computed_torque": (ω * J**0, J**0)}[kind]
    kp, kd = (tuple((gain * each).tolist()) for gain, each in zip((ω, 2 * ζ * ω), unit, strict=True))
    start = scene.initial.joint_deg
    assert not isinstance(start, float)
    to = tuple(angle + dice.one_of(-1, 1) * dice.linear(20, 90) for angle in start)
    if family == "python law":
        law = _law(lump(scene).active, *map(np.array, (kp, kd, np.radians(to))))
        same = {"drive": fl.Drive(kind="pd", kp=kp, kd=kd, target_deg=to, rate=rate, delay=late)}
        return Moving(scene, {"control": law, "rate": rate, "delay": late}, same)
    move = fl.Reference(
        profile=dice.one_of("s_curve", "quintic", "trapezoidal"), to_deg=to, duration=dice.linear(0.5, 1.5)
    )
    towards: dict[str, Any] = {"reference": move} if dice.chance(0.5) and family != "saturated" else {"target_deg": to}
    more: dict[str, Any] = {"ki": tuple((0.1 * ω**2 * J).tolist())} if kind == "cascade" else {}
    if family == "saturated":
        more = {"effort": tuple((dice.linear(1.0, 8.0) * J + dice.decades(-1, 0.5)).tolist())}
        rate = dice.one_of(None, 200.0)
    drive = fl.Drive(kind=kind, kp=kp, kd=kd, rate=rate, delay=late, **towards, **more)
    return Moving(scene.varied({"drive": drive}))


def _table(dice: Dice, J: np.ndarray) -> fl.Drive:
    times = tuple(np.linspace(0.0, 1.2, dice.one_of(4, 7, 13)).tolist())
    rows = tuple(tuple((dice.linear(-6, 6) * J).tolist()) for _ in times[:-1])
    how = dice.one_of("hold", "hold", "smooth")
    return fl.Drive(
        kind="table", times=times, torques=(*rows, (0.0,) * len(J)), hold=how == "hold", smooth=how == "smooth"
    )


def _law(active: np.ndarray, kp: np.ndarray, kd: np.ndarray, to: np.ndarray) -> Any:
    def law(_: float, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        return np.asarray(kp * (to - q[active]) - kd * qd[active])

    return law
