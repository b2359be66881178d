"""Arm → Chain: where the hinges sit, their stiffness and damping, and the inertia of the segments."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Sequence

import numpy as np
from numpy.typing import NDArray

from flexlink.arm import AXES, Arm, Link, Material
from flexlink.chain import BODY, HINGE, Chain, Coordinate
from flexlink.errors import ArgumentError, SceneError
from flexlink.rotation import cos_sin_deg, matrix_from_rpy_deg
from flexlink.rules import lumping_rule
from flexlink.sections import SectionProperties

Array = NDArray[np.float64]


def lump(
    arm: Arm,
    gravity: Sequence[float],
    locked_deg: Sequence[float] | None = None,
    name: str = "arm",
    prescribed: Collection[str] = (),
) -> Chain:
    """Cut an arm into rigid segments joined by hinges.

    Parameters
    ----------
    arm
        The arm.
    gravity
        Acceleration of gravity in frame 0 [m/s²], shape (3,).
    locked_deg
        One angle per link [deg], used where the joint is locked; 0 by default.
    name
        Name of the chain.
    prescribed
        Names of the links whose joint moves as given in time.

    Returns
    -------
    Chain
        With n = Σ over links of (1 if the joint is free) + axes · (segments − 1) degrees of freedom; for one
        rigid link and equal flexible ones this is ngl = n [tip (nseg − 1) + 1] − tip (nseg − 1), paper eq. 1.

    Raises
    ------
    SceneError
        Nothing in the arm can move.
    ArgumentError
        `locked_deg` does not have one angle per link, or `gravity` is not three finite numbers.
    """
    angles = [0.0] * len(arm.links) if locked_deg is None else list(locked_deg)
    if len(angles) != len(arm.links):
        raise ArgumentError(f"locked_deg has {len(angles)} values; expected one per link, {len(arm.links)}")
    g = np.array(gravity, float)
    if g.shape != (3,) or not np.isfinite(g).all():
        raise ArgumentError(f"gravity = {gravity!r}: expected three finite numbers")
    builder = _Builder()
    for number, link in enumerate(arm.links, start=1):
        _add_link(builder, arm, link, number, angles[number - 1], link.name in prescribed)
    builder.add_inertia(arm.tip.mass, np.zeros(3), np.diag(arm.tip.inertia))
    builder.start_body()
    if not builder.hinges:
        raise SceneError("link: every joint is locked and every link rigid; at least one must move")
    bodies = np.array([body.record() for body in builder.bodies[1:]], dtype=BODY)  # bodies[0] is the fixed base
    return Chain(
        name=name,
        bodies=bodies,
        hinges=np.array(builder.hinges, dtype=HINGE),
        gravity=g,
        coordinates=tuple(builder.coordinates),
        link_names=tuple(link.name for link in arm.links),
    )


def _add_link(
    builder: _Builder, arm: Arm, link: Link, number: int, locked_deg: float, prescribed: bool
) -> None:
    builder.move(np.array(link.mount.xyz), matrix_from_rpy_deg(link.mount.rpy_deg))
    if link.joint.locked:
        c, s = cos_sin_deg(locked_deg)
        builder.move(np.zeros(3), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    else:
        joint = link.joint
        builder.start_body()
        builder.add_hinge(
            Coordinate(number, 0, 0), 2, 0.0, joint.viscous, joint.coulomb, joint.coulomb_width, joint.armature,
            prescribed,
        )  # fmt: skip
    if link.material is None or link.section is None:
        builder.move(np.array([link.length, 0, 0]))
        return
    material, section = arm.materials[link.material], arm.sections[link.section].properties
    nodes, weights = _hinges(link)
    rigidity = {1: material.shear * section.torsion, 2: material.young * section.i_y, 3: material.young * section.i_z}
    rule = lumping_rule(link.lumping)
    twisting = material.density * (section.i_y + section.i_z) * link.length  # ρ I_p L
    rotor = {1: twisting * rule.twist_inertias(nodes, weights)}
    cuts = [0.0, *nodes, 1.0]
    for segment, (start, stop) in enumerate(itertools.pairwise(cuts)):
        if segment:
            builder.start_body()
            backward = rule.alternate_axes and segment % 2 == 0
            for axis in AXES[link.flex][:: -1 if backward else 1]:
                k = float(rigidity[axis] / (weights[segment - 1] * link.length))
                inertia = float(rotor[axis][segment - 1]) if axis in rotor else 0.0
                builder.add_hinge(
                    Coordinate(number, segment, axis), axis - 1, k, material.loss_time * k, armature=inertia
                )
        builder.add_prism(material, section, (stop - start) * link.length)


def _hinges(link: Link) -> tuple[Array, Array]:
    if link.flex == "rigid":
        return np.empty(0), np.empty(0)
    return lumping_rule(link.lumping).hinges(link.segments - 1)


@dataclasses.dataclass
class _Body:
    """A rigid body while it grows: placement on its parent, mass, first moment and inertia about its centre."""

    rotation: Array
    translation: Array
    first: int
    stop: int
    mass: float = 0.0
    center: Array = dataclasses.field(default_factory=lambda: np.zeros(3))
    inertia: Array = dataclasses.field(default_factory=lambda: np.zeros((3, 3)))

    def add(self, mass: float, center: Array, inertia: Array) -> None:
        """Join another rigid body; both inertias are moved to the common centre (parallel axes)."""
        if mass > 0:
            d = center - self.center
            reduced = self.mass * mass / (self.mass + mass)
            self.inertia = self.inertia + reduced * (d @ d * np.eye(3) - np.outer(d, d))
            self.center = self.center + d * (mass / (self.mass + mass))
            self.mass += mass
        self.inertia = self.inertia + inertia

    def record(self) -> tuple[object, ...]:
        turned = int(not np.array_equal(self.rotation, np.eye(3)))
        return (
            self.first, self.stop, turned, self.rotation, self.translation, self.mass, self.center, self.inertia
        )  # fmt: skip


class _Builder:
    """Walks along the arm: `rotation`, `translation` place the running frame in the frame of the current body."""

    def __init__(self) -> None:
        self.hinges: list[tuple[float, ...]] = []
        self.coordinates: list[Coordinate] = []
        self.bodies = [_Body(np.eye(3), np.zeros(3), 0, 0)]
        self.rotation, self.translation = np.eye(3), np.zeros(3)

    def move(self, translation: Array, rotation: Array | None = None) -> None:
        self.translation = self.translation + self.rotation @ translation
        if rotation is not None:
            self.rotation = self.rotation @ rotation

    def start_body(self) -> None:
        n = len(self.hinges)
        self.bodies.append(_Body(self.rotation, self.translation, n, n))
        self.rotation, self.translation = np.eye(3), np.zeros(3)

    def add_hinge(
        self,
        coordinate: Coordinate,
        axis: int,
        stiffness: float,
        damping: float,
        coulomb: float = 0.0,
        coulomb_width: float = 1.0,
        armature: float = 0.0,
        prescribed: bool = False,
    ) -> None:
        rest = 0.0
        self.hinges.append((axis, stiffness, rest, damping, coulomb, coulomb_width, armature, prescribed))
        self.coordinates.append(coordinate)
        self.bodies[-1].stop += 1

    def add_inertia(self, mass: float, center: Array, inertia: Array) -> None:
        R = self.rotation
        self.bodies[-1].add(mass, self.translation + R @ center, R @ inertia @ R.T)

    def add_prism(self, material: Material, section: SectionProperties, length: float) -> None:
        """Add a prism along local X: exact inertia, I_xx = ρl (I_y + I_z), I_yy = ρl I_y + m l²/12, …"""
        line = material.density * length
        mass = line * section.area
        bending = mass * length**2 / 12
        inertia = np.diag(
            [line * (section.i_y + section.i_z), line * section.i_y + bending, line * section.i_z + bending]
        )
        self.add_inertia(mass, np.array([length / 2, 0, 0]), inertia)
        self.move(np.array([length, 0, 0]))
