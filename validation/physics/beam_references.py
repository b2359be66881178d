"""Planar scenes with stored runs of Exudyn's geometrically exact beams.

`python -m validation.physics.exudyn_beams` computes them.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.rigid import matrix_from_rpy_deg
from flexlink.common.errors import ArgumentError, DataFileError
from flexlink.common.types import Array
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.scene_file import load_scene
from validation.case import scene_file
from validation.physics.formulas import INPUTS
from validation.reference_values import look_up

SCENES: dict[str, dict[str, Any]] = {"paper_fig5": {"run.duration": 1.0, "run.sample": 0.05}, "torque_pulse": {}}
"""Name of a scene → its changes before the run."""
SHEAR_FACTOR = 5 / 6
"""Shear correction factor of a rectangle (Reissner)."""


class Beam(NamedTuple):
    """Properties of a link as a planar beam."""

    length: float  # m
    angle: float  # at its start, from the x axis of the plane [rad]
    mass: float  # mass per length [kg/m]
    inertia: float  # rotary inertia of the section, per length [kg m]
    bending: float  # EI [N m²]
    axial: float  # EA [N]
    shear: float  # κ G A [N]


class Plane(NamedTuple):
    """A planar arm: a pendulum of beams; the first joint has a rotor, the last beam a payload."""

    axes: Array  # (3, 3): columns x, y, z of the plane in frame 0
    gravity: Array  # (2,), in the plane [m/s²]
    beams: tuple[Beam, ...]
    rotor: float  # kg m²
    payload: float  # kg

    @property
    def numbers(self) -> list[list[float]]:
        """All numbers, for comparison with another arm."""
        return [*map(list, self.beams), [*self.gravity.tolist(), self.rotor, self.payload]]


def beam_scene(name: str) -> Scene:
    """The scene with its input, sampled at the times of the reference.

    Raises
    ------
    ArgumentError
        No such scene exists.
    """
    change = require_one_of("scene", name, SCENES)
    return INPUTS.get(name, INPUTS["none"])(load_scene(scene_file(name)).varied(change))


def plane_of(scene: Scene) -> Plane:
    """The flexible links of a scene as beams.

    Raises
    ------
    ArgumentError
        The arm cannot be represented as a `Plane`.
    """
    links = scene.arm.links
    base = sum(link.joint.locked and not link.length for link in links)
    beams, turned = links[base:], [link for link in links[base + 1 :] if any(link.mount.rpy_deg)]
    if not beams or turned or any(link.flex != "z" or link.joint.locked for link in beams):
        raise ArgumentError(f"{scene.name}: not a serial arm of flexible links in a plane on a fixed base")
    axes = functools.reduce(np.matmul, (matrix_from_rpy_deg(link.mount.rpy_deg) for link in links))
    angles = np.radians(np.cumsum(scene.initial.joint_deg[base:])).tolist()
    gravity = axes.T @ np.array(scene.gravity)
    shapes = tuple(_beam(scene, link, angle) for link, angle in zip(beams, angles, strict=True))
    return Plane(axes, gravity[:2], shapes, beams[0].joint.armature, scene.arm.tip.mass)


def _beam(scene: Scene, link: Link, angle: float) -> Beam:
    material, section = scene.arm.materials[str(link.material)], scene.arm.sections[str(link.section)].properties
    mass, inertia = material.density * section.area, material.density * section.i_z
    stiffness = (
        material.young * section.i_z,
        material.young * section.area,
        SHEAR_FACTOR * material.shear * section.area,
    )
    return Beam(link.length, angle, mass, inertia, *stiffness)


@functools.cache
def beam_reference(name: str) -> tuple[Array, float]:
    """Tip in frame 0, shape (samples, 3) [m], and its error estimate [m].

    Raises
    ------
    DataFileError
        The reference belongs to another scene.
    """
    stored = look_up(file_name(name), "plane")
    now = plane_of(beam_scene(name)).numbers
    if [len(row) for row in stored] != [len(row) for row in now] or not all(
        np.allclose(a, b, rtol=1e-12, atol=0) for a, b in zip(stored, now, strict=True)
    ):
        raise DataFileError(
            f"reference {file_name(name)}: belongs to another scene; update: python -m validation.physics.exudyn_beams"
        )
    return np.array(look_up(file_name(name), "tip")), float(look_up(file_name(name), "own_error_m"))


def file_name(name: str) -> str:
    """Name of the file of the reference, for `look_up`."""
    return f"exudyn_beams/{name}"
