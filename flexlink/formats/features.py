"""Features that a format cannot represent, and a check of a scene for them; all formats represent the others."""

import functools
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.common.errors import Diagnostic
from flexlink.data.documents import read_toml, shown_path
from flexlink.describe.initial import BaseState
from flexlink.describe.scene import Scene


@functools.cache
def texts() -> dict[str, dict[str, str]]:
    """Feature → format that cannot represent it → what happens instead."""
    return read_toml(Path(__file__).with_suffix(".toml"))


def _starts_elsewhere(scene: Scene, chain: Chain) -> bool:
    """Whether a run starts with angles or rates other than zero; angles of locked joints do not count."""
    initial, free = scene.initial, [chain.coordinates[k].link - 1 for k in chain.active]
    places = scene.joint_positions[free] if initial.q is None else np.array(initial.q)
    rates = scene.joint_rates[free] if initial.qd is None else np.array(initial.qd)
    return bool(places.any() or rates.any() or initial.base != BaseState()) or initial.passive != "zero"


PRESENT: dict[str, Callable[[Scene, Chain], bool]] = {
    "gravity": lambda scene, _: any(scene.gravity),
    "free base": lambda _, chain: chain.has_free_base,
    "springs": lambda _, chain: bool(chain.stiffness.any()),
    "springs between hinges": lambda _, chain: len(chain.couplings) > 0,
    "springs of rotation vectors": lambda _, chain: chain.has_rotation_springs,
    "rotor inertia": lambda _, chain: bool(chain.hinges["armature"].any()),
    "dry friction": lambda _, chain: bool(chain.hinges["coulomb"].any()),
    "drag": lambda _, chain: len(chain.drag) > 0,
    "quadratic dampers": lambda _, chain: "dampers" in chain.forces,
    "hardening springs": lambda _, chain: "hardening" in chain.forces,
    "lagging friction": lambda _, chain: len(chain.internal) > 0,
    "elastic gear": lambda scene, _: any(link.joint.gear_stiffness is not None for link in scene.arm.links),
    "prescribed motion": lambda scene, _: bool(scene.motion),
    "ties": lambda scene, _: bool(scene.ties),
    "lengths of ties that move": lambda scene, _: any(tie.times for tie in scene.ties),
    "dissipation of ties": lambda scene, _: any(tie.dissipation for tie in scene.ties),
    "drive torques": lambda scene, _: scene.drive.kind != "none",
    "control law": lambda scene, _: scene.drive.controls or scene.drive.rate is not None,
    "torque limits": lambda scene, _: scene.drive.effort is not None,
    "tip wrench": lambda scene, _: scene.wrench.acts,
    "initial state": _starts_elsewhere,
}
"""Whether a scene has a feature, in the order of `texts`."""


def unsupported(scene: Scene, chain: Chain, *, format: str) -> dict[str, str]:
    """Return the features of a scene, and of its chain, that a format cannot represent, and what happens instead."""
    require_one_of("format", format, dict.fromkeys(("urdf", "mjcf", "sdf")))
    known = {name: instead[format] for name, instead in texts().items() if format in instead}
    return {name: instead for name, instead in known.items() if PRESENT[name](scene, chain)}


def storage_note(target: Path, missing: Mapping[str, str], *, format: str) -> Diagnostic:
    """Return a note on the features of file `target` that `unsupported` lists, and what happens instead."""
    groups: dict[str, list[str]] = {}
    for name, instead in missing.items():
        if name != "drive torques" or "control law" not in missing:
            groups.setdefault(instead, []).append(name)
    listed = [f"{' and '.join(', '.join(names).rsplit(', ', 1))}: {instead}" for instead, names in groups.items()]
    text = f"{shown_path(target)}: {format.upper()} cannot store the {'. It cannot store the '.join(listed)}"
    return Diagnostic(text, "format-cannot-store")
