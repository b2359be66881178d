"""What each format cannot represent: a table of features by format, and those that a scene has.

All formats represent what is not in the table: bodies, placements, axes, viscous damping, names.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.describe.initial import BaseState
from flexlink.describe.scene import Scene

Feature = tuple[Callable[[Scene, Chain], bool], dict[str, str]]
"""Whether a scene has it; by format what its file has instead: without an entry the format represents it."""


def _starts_elsewhere(scene: Scene, chain: Chain) -> bool:
    """Whether a run starts with angles or rates other than zero; locked joints are part of the placements."""
    initial, free = scene.initial, [chain.coordinates[k].link - 1 for k in chain.active]
    places = scene.joint_positions[free] if initial.q is None else np.array(initial.q)
    rates = scene.joint_rates[free] if initial.qd is None else np.array(initial.qd)
    elsewhere = places.any() or rates.any() or initial.base != BaseState()
    return bool(elsewhere) or initial.passive != "zero"


def _features() -> dict[str, Feature]:
    ignored = "written in elements that other programs ignore"

    def feature(there: Callable[[Scene, Chain], bool], everywhere: str = "", **instead: str) -> Feature:
        return there, (dict.fromkeys(("urdf", "mjcf", "sdf"), everywhere) if everywhere else instead)

    return {
        "gravity": feature(lambda scene, _: any(scene.gravity), urdf=ignored),
        "free base": feature(
            lambda _, chain: chain.has_free_base,
            urdf=f"a root link without a joint; that it floats, and its attitude, is {ignored}",
        ),
        "springs": feature(lambda _, chain: bool(chain.stiffness.any()), urdf=ignored),
        "springs between hinges": feature(lambda _, chain: len(chain.couplings) > 0, urdf=ignored, sdf=ignored),
        "springs of rotation vectors": feature(
            lambda _, chain: chain.has_rotation_springs,
            f"springs of the angles; which of them hold rotation vectors is {ignored}",
        ),
        "rotor inertia": feature(
            lambda _, chain: bool(chain.hinges["armature"].any()),
            urdf=ignored, sdf="in drake:rotor_inertia, which only Drake reads",
        ),
        "dry friction": feature(
            lambda _, chain: bool(chain.hinges["coulomb"].any()),
            urdf=f"the torque c in <dynamics friction>; the width w of c tanh(q̇/w) {ignored}",
            mjcf="the torque c in frictionloss, which is disabled; the width w of c tanh(q̇/w) in user",
            sdf=f"the torque c in <friction>, which Drake ignores; the width w of c tanh(q̇/w) {ignored}",
        ),
        "drag": feature(
            lambda _, chain: len(chain.drag) > 0,
            "none: links meet no air; the fluid of MuJoCo's own, by boxes or ellipsoids, has another law",
        ),
        "quadratic dampers": feature(lambda _, chain: "dampers" in chain.forces, "none: the joint turns without them"),
        "lagging friction": feature(lambda _, chain: len(chain.internal) > 0, "none: such a scene is refused"),
        "elastic gear": feature(
            lambda scene, _: any(link.joint.gear_stiffness is not None for link in scene.arm.links),
            "two joints of one axis, first the motor, then the gear",
        ),
        "prescribed motion": feature(lambda scene, _: bool(scene.motion), "no motion: the joint moves freely"),
        "drive torques": feature(lambda scene, _: scene.drive.kind != "none", "a motor without a torque"),
        "control law": feature(
            lambda scene, _: scene.drive.kind in {"pd", "computed_torque"} or scene.drive.rate is not None,
            "none: reference, gains and rate are left out",
        ),
        "torque limits": feature(lambda scene, _: scene.drive.effort is not None, "none: torques are unlimited"),
        "tip wrench": feature(lambda scene, _: scene.wrench.acts, "none"),
        "initial state": feature(_starts_elsewhere, urdf="all zero", sdf="all zero"),
    }  # fmt: skip


FEATURES = _features()


def not_held(scene: Scene, chain: Chain, *, format: str) -> dict[str, str]:
    """Features of a scene that a format cannot represent, and what its file has instead.

    Parameters
    ----------
    scene, chain
        The scene and its chain, from `lump`.
    format
        Name of a format, "urdf", "mjcf" or "sdf".

    Returns
    -------
    dict
        Feature: what the file has instead; empty if the file represents the whole scene.

    Raises
    ------
    ArgumentError
        The format is unknown.
    """
    require_one_of("format", format, dict.fromkeys(("urdf", "mjcf", "sdf")))
    return {
        name: instead[format]
        for name, (there, instead) in FEATURES.items()
        if format in instead and there(scene, chain)
    }
