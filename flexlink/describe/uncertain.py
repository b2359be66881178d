"""Uncertain inputs of a scene: values by path that follow one standard normal number z each.

    relative            x = x₀ exp(u z)
    absolute            x = x₀ + u z, for x₀ = 0; u |z| if the value cannot be negative
    clamp of a beam     k = EI / (u |z| L), springs at its root

A clamp without springs has a default uncertainty, that of a measured wing spar (`validation/measured`): its clamp has
401 N m/rad, which lowers its first frequency by 4 %.
"""

import contextlib
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flexlink.common.errors import SceneError, errors_at
from flexlink.common.types import Array
from flexlink.describe.arm import Arm
from flexlink.describe.link import ROOT_AXES, Link
from flexlink.describe.vary import number_in, values_at

Scene: TypeAlias = Any  # that of `scene`, which imports this module

CLAMP = 0.02
"""Default standard uncertainty of EI / (k L): 4.426 N m² / (401 N m/rad · 0.55 m) of the spar."""


class Input(NamedTuple):
    """An uncertain input: its path, its changes of the scene at z, and whether z and −z are the same."""

    path: str
    changes: Callable[[float], dict[str, Any]]
    one_sided: bool


def inputs_of(scene: Scene, fields: Mapping[str, Any]) -> list[Input]:
    """The inputs that `uncertain` lists, and the clamps of beams; errors name the path. `fields`: type of each key."""
    clamps = {scene.arm.path(k, "link") + ".root_stiffness": link for k, link in enumerate(scene.arm.links, 1)}
    found = []
    for path, u in scene.uncertain.items():
        clamp = clamps.get(path)
        if clamp is not None and not clamp.root_springs:
            if clamp.flex == "rigid":
                raise SceneError(f"uncertain.{path}: the link is rigid; set flex, or leave it out", id="no-effect")
            found.append(_clamp(scene.arm, path, clamp, u))
        else:
            found.append(_value(scene, fields, path, u))
    for path, link in clamps.items():
        if link.flex != "rigid" and not link.root_springs and not any(p.startswith(path) for p in scene.uncertain):
            by_default = _clamp(scene.arm, path, link, CLAMP)
            with contextlib.suppress(SceneError):  # no inertia between joint and springs, or a complete state
                scene.varied(by_default.changes(1.0))
                found.append(by_default)
    return [each for each in found if scene.uncertain.get(each.path) != 0.0]


def _value(scene: Scene, fields: Mapping[str, Any], path: str, u: float) -> Input:
    with errors_at("uncertain."):
        values = values_at(scene.document(), fields, path)
    with errors_at(f"uncertain.{path} = "):
        value = number_in(values)
    if value:
        return Input(path, lambda z: {path: value * np.exp(u * z)}, one_sided=False)
    try:
        scene.varied({path: -u})
    except SceneError:
        return Input(path, lambda z: {path: u * z}, one_sided=True)
    return Input(path, lambda z: {path: u * z}, one_sided=False)


def _clamp(arm: Arm, path: str, link: Link, u: float) -> Input:
    EI: Array = np.array(arm.bending_stiffness(link) or (0.0, 0.0))
    if link.rigidity is not None:
        table = arm.rigidities[link.rigidity]
        EI = table.rows.rigidities[1:, 0]
    bends = {"z": (2,), "yz": (1, 2), "xyz": (1, 2)}[link.flex]
    axes = {k: ROOT_AXES[int(np.abs(link.beam.frame[:, k]).argmax())] for k in bends}
    # EI / L [N m/rad] at the root of the beam, by the axes of the link's frame that are nearest to those of bending
    per_angle = {axis: float(EI[k - 1] / link.beam.length) for k, axis in axes.items()}

    def changes(z: float) -> dict[str, Any]:
        return {path: {axis: one / (u * z) for axis, one in per_angle.items()} if u * z > 0 else None}

    return Input(path, changes, one_sided=True)
