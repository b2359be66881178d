"""What a formulation is given: rods in SI units, supports, loads, and the reference motion of the tip.

Arms with drives, friction, rigid links or branches are not rods: only chains describe them, from the scene.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.lumping import lump
from flexlink.chain.rigid import matrix_from_rpy_deg
from flexlink.common.errors import ArgumentError
from flexlink.common.types import Array
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from flexlink.describe.spec import Positive, Spec
from validation.case import scene_file
from validation.physics.formulas import INPUTS, pulse, spin_up_angle
from validation.reference_values import look_up, reference_array
from validation.trade.scenes import scenes as trade_scenes
from validation.trade.scenes import varied_scene

CLOSED_FORM = "roll-up"
OWN_ERRORS = {"single_link_torque_pulse": 4e-12, "spinup_kane_simo": 2e-10}
"""Accuracy of references that do not state it themselves [m]."""


class Reference(NamedTuple):
    """Tip in frame 0, shape (samples, 3) [m], and its own error [m]."""

    tip: Array
    own_error: float


def reference(name: str, axes: Array, length: float, turns: float) -> Reference:
    """The reference of that name; planar ones are in the plane of the first two `axes`.

    `length` and `turns` of the tip are for the roll-up: the rod becomes an arc of a circle. Without a
    name there is none.
    """
    if not name:
        return Reference(np.empty((0, 3)), float("nan"))
    if name == CLOSED_FORM:
        angle = 2 * np.pi * turns
        arc = length / angle * np.array([np.sin(angle), 1 - np.cos(angle)])
        return Reference((arc @ axes[:, :2].T)[None], 0.0)
    if name in OWN_ERRORS:
        plane = reference_array(name, "values")[:, :2]
        return Reference(plane @ axes[:, :2].T, OWN_ERRORS[name])
    return Reference(reference_array(name, "tip"), float(look_up(name, "own_error_m")))


Held = Literal["hinge", "moved", "clamped"]


class Rod(NamedTuple):
    """A uniform straight rod; z is its joint's axis."""

    length: float  # m
    turn: Array  # (3, 3): its axes at rest, in frame 0; x along the rod
    mass: float  # ρA [kg/m]
    bending: tuple[float, float]  # EI about y, z [N m²]
    twist: float  # GJ [N m²]
    rotary: tuple[float, float, float]  # inertia of a section about x, y, z, per length [kg m]
    hinged: bool  # whether a free joint holds its start


class Task(NamedTuple):
    """A motion, or a static load, to be computed."""

    name: str
    scene: Scene  # with its input
    rods: tuple[Rod, ...]  # empty if the arm is not a series of flexible links
    length: float  # of the arm, the unit of errors [m]
    held: Held  # the start of the first rod: by a free joint, by a joint that is moved, clamped
    gravity: Array  # in frame 0 [m/s²]
    rotor: float  # inertia of the first joint [kg m²]
    payload: float  # mass at the tip [kg]
    torque: Callable[[float], float] | None  # of the first joint [N m]
    angle: Callable[[float], tuple[float, float, float]] | None  # of the first joint, with its rates [rad]
    moment: float  # of the tip about z, static [N m]; 0: a motion
    reference: Reference

    @property
    def axes(self) -> Array:
        """Axes of the first rod's joint in frame 0, by columns; planar motions are in its x, y."""
        return self.rods[0].turn

    @property
    def times(self) -> Array:
        """Times of the samples [s]."""
        return self.scene.run.times

    def error(self, tip: Array) -> float:
        """Largest distance of the tip from the reference, relative to the length; nan if a sample is missing."""
        if tip.shape != self.reference.tip.shape:
            return float("nan")
        return float(np.linalg.norm(tip - self.reference.tip, axis=1).max()) / self.length


class Described(Spec, frozen=True):
    """A task in a case file: scene, its changes, input, a static end moment in turns of the tip, reference.

    The scene is a file or one of the trade study. If `rods` is false, only chains run, and the unit of errors is the
    reach of the arm.

    `errors` replace those of the case if the reference is less accurate. `ladder` lists settings by formulation, all
    combinations of which run; `reaches` states the error that a ladder reaches at least, and `cannot` why a formulation
    cannot describe the task.
    """

    scene: str
    reference: str
    change: dict[str, Any] = msgspec.field(default_factory=dict)
    input: Literal["none", "torque_pulse", "spin_up"] = "none"
    turns: float = 0.0
    rods: bool = True
    errors: tuple[Positive, ...] = ()
    ladder: dict[str, dict[str, tuple[Positive, ...]]] = msgspec.field(default_factory=dict)
    reaches: dict[str, Positive] = msgspec.field(default_factory=dict)
    cannot: dict[str, str] = msgspec.field(default_factory=dict)


@functools.lru_cache(maxsize=8)
def _scene(name: str, change: bytes) -> Scene:
    scene = varied_scene(trade_scenes()[name], name) if name in trade_scenes() else load_scene(scene_file(name))
    return scene.varied(msgspec.json.decode(change))


def task_of(name: str, described: Described) -> Task:
    """Make a task from its description.

    Raises
    ------
    ArgumentError
        The arm is not a series of flexible links on a fixed base.
    """
    plain = _scene(described.scene, msgspec.json.encode(described.change))
    scene = require_one_of("input", described.input, INPUTS)(plain)
    if not described.rods:
        return _of_chains(name, plain, described)
    rods, links = rods_of(plain)
    moved = described.input == "spin_up"
    turn = 2 * np.pi * described.turns
    return Task(
        name=name, scene=scene, rods=rods, length=sum(rod.length for rod in rods),
        held="moved" if moved else "clamped" if links[0].joint.locked else "hinge",
        gravity=np.array(scene.gravity), rotor=links[0].joint.armature, payload=scene.arm.tip.mass,
        torque=_pulse if described.input == "torque_pulse" else None, angle=_spin_up if moved else None,
        moment=turn * rods[0].bending[1] / rods[0].length,
        reference=reference(described.reference, rods[0].turn, rods[0].length, described.turns),
    )  # fmt: skip


def _of_chains(name: str, scene: Scene, described: Described) -> Task:
    """A task that only chains run."""
    return Task(
        name=name, scene=scene, rods=(), length=lump(scene).reach, held="hinge", gravity=np.array(scene.gravity),
        rotor=0.0, payload=0.0, torque=None, angle=None, moment=0.0,
        reference=reference(described.reference, np.eye(3), 1.0, 0.0),
    )  # fmt: skip


def rods_of(scene: Scene) -> tuple[tuple[Rod, ...], list[Link]]:
    """The flexible links of a scene at its start as rods, and these links."""
    links = scene.arm.links
    base = sum(link.joint.locked and not link.length for link in links)
    turns = [
        matrix_from_rpy_deg(link.mount.rpy_deg) @ matrix_from_rpy_deg((0.0, 0.0, angle))
        for link, angle in zip(links, scene.initial.joint_deg, strict=True)
    ]
    if not links[base:] or any(link.strain_modes or link.flex == "rigid" for link in links[base:]):
        raise ArgumentError(f"{scene.name}: not a series of flexible links on a fixed base")
    rods = []
    for k in range(base, len(links)):
        turn = functools.reduce(np.matmul, turns[: k + 1])
        rods.append(_rod(scene, links[k], turn, first=k == base))
    return tuple(rods), list(links[base:])


def _rod(scene: Scene, link: Link, turn: Array, first: bool) -> Rod:
    material, section = scene.arm.materials[str(link.material)], scene.arm.sections[str(link.section)].properties
    ρ, E = material.density, material.young
    return Rod(
        link.length, turn, ρ * section.area, (E * section.i_y, E * section.i_z), material.shear * section.torsion,
        (ρ * (section.i_y + section.i_z), ρ * section.i_y, ρ * section.i_z), not first and not link.joint.locked,
    )  # fmt: skip


def _pulse(t: float) -> float:
    return float(pulse(t))


def _spin_up(t: float) -> tuple[float, float, float]:
    angle, rate, acceleration = spin_up_angle(t)
    return float(angle), float(rate), float(acceleration)


Setting = Mapping[str, float]
"""Name of a numerical setting → its value."""


class Outcome(NamedTuple):
    """Tip at the samples in frame 0, shape (samples, 3) [m]; CPU seconds of the call; number of coordinates.

    `counted`: the seconds follow from a number of evaluations, so repeating the call is useless. `note`: a remark.
    """

    tip: Array
    seconds: float
    coordinates: int
    counted: bool = False
    note: str = ""


Run = Callable[[Task, str, Setting], Outcome]
"""Computes a task with one kind of element and its settings."""
