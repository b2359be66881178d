"""Features that a format cannot represent, and a check of a scene for them; all formats represent the others."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.common.errors import Diagnostic
from flexlink.data.documents import shown_path
from flexlink.describe.initial import BaseState
from flexlink.describe.scene import Scene

Feature = tuple[Callable[[Scene, Chain], bool], dict[str, str]]
"""A test for the feature in a scene, and, for each format that cannot represent it, what happens instead."""


def _starts_elsewhere(scene: Scene, chain: Chain) -> bool:
    """Whether a run starts with angles or rates other than zero; angles of locked joints do not count."""
    initial, free = scene.initial, [chain.coordinates[k].link - 1 for k in chain.active]
    places = scene.joint_positions[free] if initial.q is None else np.array(initial.q)
    rates = scene.joint_rates[free] if initial.qd is None else np.array(initial.qd)
    return bool(places.any() or rates.any() or initial.base != BaseState()) or initial.passive != "zero"


def _features() -> dict[str, Feature]:
    custom = "in custom elements that other programs ignore"
    ignored = "flexlink writes custom elements that other programs ignore"
    at_zero = "all coordinates start at zero"
    width = "the width w of c tanh(q̇/w)"

    def feature(there: Callable[[Scene, Chain], bool], everywhere: str = "", **instead: str) -> Feature:
        return there, (dict.fromkeys(("urdf", "mjcf", "sdf"), everywhere) if everywhere else instead)

    return {
        "gravity": feature(lambda scene, _: any(scene.gravity), urdf=ignored),
        "free base": feature(
            lambda _, chain: chain.has_free_base,
            urdf=f"the root link has no joint; its attitude, and a mark that it floats, are {custom}",
        ),
        "springs": feature(lambda _, chain: bool(chain.stiffness.any()), urdf=ignored),
        "springs between hinges": feature(lambda _, chain: len(chain.couplings) > 0, urdf=ignored, sdf=ignored),
        "springs of rotation vectors": feature(
            lambda _, chain: chain.has_rotation_springs,
            f"they become springs of angles; which of them are rotation-vector springs is {custom}",
        ),
        "rotor inertia": feature(
            lambda _, chain: bool(chain.hinges["armature"].any()),
            urdf=ignored, sdf="flexlink writes drake:rotor_inertia, which only Drake reads",
        ),
        "dry friction": feature(
            lambda _, chain: bool(chain.hinges["coulomb"].any()),
            urdf=f"the torque c is in <dynamics friction>; {width} is {custom}",
            mjcf=f"the torque c is in frictionloss, which is disabled; {width} is in user",
            sdf=f"the torque c is in <friction>, which Drake ignores; {width} is {custom}",
        ),
        "drag": feature(
            lambda _, chain: len(chain.drag) > 0,
            "links have no drag; MuJoCo's fluid model for boxes or ellipsoids follows a different law",
        ),
        "quadratic dampers": feature(lambda _, chain: "dampers" in chain.forces, "joints are exported without them"),
        "hardening springs": feature(lambda _, chain: "hardening" in chain.forces, "joints are exported without them"),
        "lagging friction": feature(lambda _, chain: len(chain.internal) > 0, "such a scene is refused"),
        "elastic gear": feature(
            lambda scene, _: any(link.joint.gear_stiffness is not None for link in scene.arm.links),
            "it becomes two joints about one axis, first the motor, then the gear",
        ),
        "prescribed motion": feature(lambda scene, _: bool(scene.motion), "the joint moves freely"),
        "ties": feature(lambda scene, _: bool(scene.ties), **dict.fromkeys(("urdf", "sdf"), "the arm is open")),
        "lengths of ties that move": feature(
            lambda scene, _: any(tie.times for tie in scene.ties), mjcf="they stay as they are at the start"
        ),
        "dissipation of ties": feature(
            lambda scene, _: any(tie.dissipation for tie in scene.ties), mjcf="ties press without losses"
        ),
        "drive torques": feature(lambda scene, _: scene.drive.kind != "none", "motors are exported without commands"),
        "control law": feature(
            lambda scene, _: scene.drive.controls or scene.drive.rate is not None,
            "motors are exported without gains or reference",
        ),
        "torque limits": feature(lambda scene, _: scene.drive.effort is not None, "torques are unlimited"),
        "tip wrench": feature(lambda scene, _: scene.wrench.acts, "no wrench acts"),
        "initial state": feature(_starts_elsewhere, urdf=at_zero, sdf=at_zero),
    }  # fmt: skip


FEATURES = _features()


def unsupported(scene: Scene, chain: Chain, *, format: str) -> dict[str, str]:
    """Return the features of a scene, and of its chain, that a format cannot represent, and what happens instead."""
    require_one_of("format", format, dict.fromkeys(("urdf", "mjcf", "sdf")))
    known = ((name, there, instead[format]) for name, (there, instead) in FEATURES.items() if format in instead)
    return {name: instead for name, there, instead in known if there(scene, chain)}


def storage_note(target: Path, missing: Mapping[str, str], *, format: str) -> Diagnostic:
    """Return a note on the features of file `target` that `unsupported` lists, and what happens instead."""
    groups: dict[str, list[str]] = {}
    for name, instead in missing.items():
        if name != "drive torques" or "control law" not in missing:
            groups.setdefault(instead, []).append(name)
    sentences = ". It cannot store the ".join([f"{_and(features)}: {instead}" for instead, features in groups.items()])
    return Diagnostic(f"{shown_path(target)}: {format.upper()} cannot store the {sentences}", "format-cannot-store")


def _and(items: list[str]) -> str:
    return " and ".join([", ".join(items[:-1]), items[-1]] if len(items) > 1 else items)
