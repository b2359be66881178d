"""What each format cannot hold of a scene: a table, feature by format, and what is there of it in one scene.

What is not in the table is held: bodies, placements, axes, viscous damping, names.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from flexlink.chain.arguments import require_one_of
from flexlink.chain.chain import Chain
from flexlink.describe.scene import Scene

SKIPPED = "in a part that other programs skip"
ALL = ("urdf", "mjcf", "sdf")


class Feature(NamedTuple):
    """Something that a scene may have."""

    there: Callable[[Scene, Chain], bool]
    instead: dict[str, str]  # format: what stands in its file instead; without an entry the format holds it


def _for_all(text: str) -> dict[str, str]:
    return dict.fromkeys(ALL, text)


def _starts_elsewhere(scene: Scene, chain: Chain) -> bool:
    """Whether a run starts with other angles than zero, or moving; locked joints stand in the placements."""
    initial, free = scene.initial, [chain.coordinates[k].link - 1 for k in chain.active]
    angles = [initial.joint_deg[link] for link in free] if initial.q is None else initial.q
    rates = [initial.rates[link] for link in free] if initial.qd is None else initial.qd
    return any(angles) or any(rates) or initial.passive != "zero"


FEATURES = {
    "gravity": Feature(lambda scene, _: any(scene.gravity), {"urdf": SKIPPED}),
    "springs": Feature(lambda _, chain: bool(chain.stiffness.any()), {"urdf": SKIPPED}),
    "rotor inertia": Feature(
        lambda _, chain: bool(chain.hinges["armature"].any()),
        {"urdf": SKIPPED, "sdf": "as drake:rotor_inertia, which only Drake reads"},
    ),
    "dry friction": Feature(
        lambda _, chain: bool(chain.hinges["coulomb"].any()),
        {
            "urdf": f"the torque c as <dynamics friction>; the width w of c tanh(q̇/w) {SKIPPED}",
            "mjcf": "the torque c as frictionloss, which is switched off, the width w of c tanh(q̇/w) as user number",
            "sdf": f"the torque c as <friction>, which Drake ignores; the width w of c tanh(q̇/w) {SKIPPED}",
        },
    ),
    "elastic gear": Feature(
        lambda _, chain: any(c.axis and not c.segment for c in chain.coordinates),
        _for_all("two joints about one line, the motor's and then the gear's, which no format tells apart"),
    ),
    "prescribed motion": Feature(lambda scene, _: bool(scene.motion), _for_all("nothing: the joint is free")),
    "drive torques": Feature(lambda scene, _: scene.drive.kind != "none", _for_all("a motor without a torque")),
    "control law": Feature(
        lambda scene, _: scene.drive.kind in {"pd", "computed_torque"} or scene.drive.rate is not None,
        _for_all("nothing: reference, gains and rate are the scene's"),
    ),
    "torque limits": Feature(lambda scene, _: scene.drive.effort is not None, _for_all("nothing: any torque fits")),
    "tip wrench": Feature(lambda scene, _: scene.wrench.acts, _for_all("nothing")),
    "initial state": Feature(
        _starts_elsewhere,
        {"urdf": "nothing: zero angles", "sdf": "nothing: zero angles"},
    ),
}


def not_held(scene: Scene, chain: Chain, *, format: str) -> dict[str, str]:
    """Features of a scene that a format cannot hold, and what stands in the file instead.

    Parameters
    ----------
    scene, chain
        The scene and its chain, from `lump`.
    format
        Name of a format, "urdf", "mjcf" or "sdf".

    Returns
    -------
    dict
        Feature: what its file holds instead; empty if the file says all that the scene says of the arm's motion.

    Raises
    ------
    ArgumentError
        There is no such format.
    """
    require_one_of("format", format, dict.fromkeys(ALL))
    return {
        name: feature.instead[format]
        for name, feature in FEATURES.items()
        if format in feature.instead and feature.there(scene, chain)
    }
