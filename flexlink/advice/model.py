"""A model of an arm: what of each link bends, and where its hinges are."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from flexlink.common.errors import SceneError
from flexlink.describe.arm import Link
from flexlink.describe.scene import Scene
from flexlink.describe.spec import truncated

FLEX = ("rigid", "z", "yz", "xyz")
"""What may bend, each with all of the one before it."""


class Bend(NamedTuple):
    """How a link bends."""

    flex: str  # z, yz, xyz
    rule: str  # lumping rule
    hinges: int

    def __str__(self) -> str:
        return f"flex {self.flex}, {self.hinges} hinge{'s' * (self.hinges > 1)}, {self.rule}"


Model = tuple[Bend | None, ...]
"""One entry a link, None of a rigid one."""
Axes = tuple[str, ...]
"""Of every link one of `FLEX`."""


def by_rule(flex: str, hinges: int, family: str = "gauss") -> Bend | None:
    """A link of this flex with hinges at Gauss points: `gauss` takes even numbers, one hinge sits in the middle."""
    if flex == "rigid":
        return None
    return Bend(flex, "midpoint" if hinges == 1 else "legendre" if hinges % 2 else family, hinges)


def uniform(axes: Axes, hinges: int, family: str = "gauss") -> Model:
    """The same number of hinges in every link that bends."""
    return tuple(by_rule(flex, hinges, family) for flex in axes)


def flexes(model: Model) -> Axes:
    """What bends of every link."""
    return tuple(bend.flex if bend else "rigid" for bend in model)


def most_axes(scene: Scene) -> Axes:
    """All that physics lets bend: every link with a section, about all three axes."""
    return tuple("xyz" if is_beam(link) else "rigid" for link in scene.arm.links)


def is_beam(link: Link) -> bool:
    """Whether a link has all that it takes to bend."""
    return link.material is not None and link.section is not None and link.beam.length > 0


def judged(scene: Scene) -> Scene:
    """The scene, if it says nothing that holds for one model only.

    Raises
    ------
    SceneError
        It starts from the joints of one model, or nothing happens in it, or no link has a section.
    """
    for name in ("q", "qd"):
        value = getattr(scene.initial, name)
        if value is not None:
            raise SceneError(
                f"initial.{name} = {truncated(value)}: are the joints of one model; advice compares models, and needs "
                "initial.joint_deg, rate_deg and passive"
            )
    if scene.run.duration == 0:
        raise SceneError(f"run.duration = {scene.run.duration!r}: nothing happens; advice needs a motion")
    if not any(map(is_beam, scene.arm.links)):
        raise SceneError("link: none has a material and a section, so that none can bend; advice has nothing to choose")
    return scene


def is_scene(scene: Scene, model: Model) -> bool:
    """Whether anything at all moves in the scene with this model."""
    links = zip(scene.arm.links, model, strict=True)
    return any(bend or not link.joint.locked or link.joint.gear_stiffness for link, bend in links)


def with_model(scene: Scene, model: Model) -> Scene:
    """The scene with its links cut as the model says."""
    links = tuple(_cut(link, bend) for link, bend in zip(scene.arm.links, model, strict=True))
    return replace(scene, arm=replace(scene.arm, links=links))


def _cut(link: Link, bend: Bend | None) -> Link:
    if bend is None:
        return replace(link, flex="rigid", segments=1, lumping="gauss") if link.flex != "rigid" else link
    return replace(link, flex=bend.flex, segments=bend.hinges + 1, lumping=bend.rule)


@functools.cache
def lesser(flex: str) -> tuple[str, ...]:
    """What bends less than this, and bends: z of yz, z and yz of xyz."""
    return FLEX[1 : FLEX.index(flex)]


def capped(axes: Sequence[str], top: str) -> Axes:
    """The same with no link bending more than `top`."""
    return tuple(FLEX[min(FLEX.index(flex), FLEX.index(top))] for flex in axes)
