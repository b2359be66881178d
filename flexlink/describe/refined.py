"""The same arm with more hinges in every link that bends."""

from __future__ import annotations

import itertools
import math

from msgspec.structs import replace

from flexlink.common.errors import SceneError
from flexlink.common.wording import truncated
from flexlink.describe.link import Link
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule


def refined(scene: Scene, factor: float) -> Scene:
    """Return the scene with `factor` times the hinges in every link that bends, rounded up as the link's rule allows.

    They move one by one: a link with strain modes loses them, so the difference includes what its shapes leave out.

    Raises
    ------
    SceneError
        The scene starts from coordinates of its hinges, which fit only one number of hinges.
    """
    for name in ("q", "qd"):
        value = getattr(scene.initial, name)
        if value is not None:
            raise SceneError(
                f"initial.{name} = {truncated(value)}: fits only one number of hinges; use initial.joint_deg, rate_deg "
                "and passive",
                id="hinge-state-with-advice",
            )
    links = tuple(_refined(link, factor) for link in scene.arm.links)
    return replace(scene, arm=replace(scene.arm, links=links))


def _refined(link: Link, factor: float) -> Link:
    if link.flex == "rigid":
        return link
    rule, least = lumping_rule(link.lumping), max(math.ceil(factor * (link.segments - 1) - 1e-9), 1)
    return replace(link, modes=None, segments=1 + next(filter(rule.takes, itertools.count(least))))


def segments_in_words(scene: Scene) -> str:
    """Numbers of segments of the links that bend, such as "5 segments (boom), 3 (fore)"."""
    bent = [(link.segments, link.name) for link in scene.arm.links if link.flex != "rigid"]
    if len({count for count, _ in bent}) == 1:
        return f"{bent[0][0]} segments" + (" per link" if len(bent) > 1 else "")
    return ", ".join(f"{count}{' segments' * (k == 0)} ({name})" for k, (count, name) in enumerate(bent))
