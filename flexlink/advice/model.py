"""A model of an arm: the axes about which each link bends, and its hinges; families of the rules for them."""

from collections.abc import Sequence
from typing import NamedTuple

from msgspec.structs import replace

from flexlink.common.errors import SceneError
from flexlink.common.wording import truncated
from flexlink.describe.arm import Arm
from flexlink.describe.link import AXES, RIGID, Link, StrainModes
from flexlink.describe.scene import Scene
from flexlink.describe.sensor import Sensor


class Family(NamedTuple):
    """Lumping rules of one kind, for all numbers of hinges that the family offers."""

    order: float  # order of the errors of the tip's path
    order_in_space: float  # the same, in large bending in space
    asymptotic: int  # smallest number of hinges from which on errors fall with this order
    safe: float  # lower bound of the change of the extrapolated limit, relative to the error of the limit
    step: int  # numbers of hinges above two are multiples of this

    def rounded_up(self, hinges: int) -> int:
        """Smallest number of hinges that the family offers and that is at least `hinges`."""
        return hinges if hinges <= FEW else -(-hinges // self.step) * self.step

    def fewer(self, hinges: int) -> set[int]:
        """Smaller numbers of hinges to try; 0 makes the link rigid."""
        tried = (hinges - 1, hinges - 2, 0) if self.step == 1 else (0, 1, FEW, hinges - self.step)
        return {count for count in tried if 0 <= count < hinges}


FEW = 2  # in every family, all numbers of hinges up to this one are tried

GAUSS = "gauss"  # the family that every study starts with

FAMILIES = {
    # `safe` was measured on 22 scenes; cells use the value of gauss, which tests of advice check with finer models
    GAUSS: Family(order=2.0, order_in_space=2.0, asymptotic=6, safe=1.5, step=1),
    "legendre": Family(order=2.0, order_in_space=2.0, asymptotic=6, safe=1.2, step=1),
    "lobatto": Family(order=4.0, order_in_space=2.0, asymptotic=12, safe=1.5, step=4),
}


def rule_of(family: str, hinges: int) -> str:
    """The lumping rule of a family for this number of hinges; a single hinge is at the middle of the link."""
    if hinges == 1:
        return "midpoint"
    if family == "lobatto":
        return "lobatto2" if hinges % 4 else "lobatto4"
    return "legendre" if hinges % 2 else family


FLEX = ("rigid", "z", "yz", "xyz")
"""Choices of the bending axes of a link; each choice includes the axes of the previous one."""


class Bend(NamedTuple):
    """How a link bends."""

    flex: str  # z, yz or xyz
    rule: str  # lumping rule
    hinges: int
    modes: StrainModes | None = None

    def __str__(self) -> str:
        text = f"flex {self.flex}, {self.hinges} hinge{'s' * (self.hinges > 1)}, {self.rule}"
        if self.modes is None:
            return text
        counts = ", ".join(f"{'xyz'[axis - 1]} {self.modes.of_axis(axis)}" for axis in AXES[self.flex])
        return f"{text}; strain modes {counts}"


Model = tuple[Bend | None, ...]  # one entry for each link; None for a rigid link
Axes = tuple[str, ...]  # one of `FLEX` for each link


def by_rule(flex: str, hinges: int, family: str = GAUSS) -> Bend | None:
    """Bending of a link with this number of hinges, by a rule of a family; None if it does not bend."""
    return None if flex == "rigid" or not hinges else Bend(flex, rule_of(family, hinges), hinges)


def uniform(axes: Axes, hinges: int, family: str = GAUSS) -> Model:
    """Model with the same number of hinges in every link that bends."""
    return tuple(by_rule(flex, hinges, family) for flex in axes)


def all_axes(scene: Scene) -> Axes:
    """All possible bending axes: all three for a link with a section, the table's axes for a link with a table."""
    return tuple(_axes_of(scene.arm, link) if is_beam(link) else "rigid" for link in scene.arm.links)


def _axes_of(arm: Arm, link: Link) -> str:
    if link.rigidity is None:
        return "xyz"
    return next((flex for flex in reversed(FLEX) if not any(arm.rigidities[link.rigidity].lacks(flex))), "rigid")


def is_beam(link: Link) -> bool:
    """Whether a link can bend: it has a length, and a material and a section or a table of rigidities."""
    return (link.material is not None or link.rigidity is not None) and link.beam.length > 0


def checked_scene(scene: Scene) -> Scene:
    """Return the scene if it can be run with any model."""
    for name in ("q", "qd"):
        if (value := getattr(scene.initial, name)) is not None:
            why = f"initial.{name} = {truncated(value)}: fits only one number of hinges, but advice varies it"
            raise SceneError(f"{why}; use initial.joint_deg, rate_deg and passive", id="hinge-state-with-advice")
    if scene.run.duration == 0:
        why = f"run.duration = {scene.run.duration!r}: advice needs a motion; use a duration > 0"
        raise SceneError(why, id="no-motion")
    if not any(map(is_beam, scene.arm.links)):
        why = "link: no link can bend, so there is nothing to choose; give a link a material and a section"
        raise SceneError(why, id="no-flexible-link")
    return scene


def can_move(scene: Scene, model: Model) -> bool:
    """Whether anything can move in the scene with this model."""
    links = zip(scene.arm.links, model, strict=True)
    return any(bend or not link.joint.locked or link.turns_rigidly for link, bend in links)


def with_model(scene: Scene, model: Model) -> Scene:
    """The scene with its links divided as in the model, without strain gauges on links that do not bend."""
    links = tuple(_divided(link, bend) for link, bend in zip(scene.arm.links, model, strict=True))
    gone = gauges_lost(scene, model)
    sensors = tuple(sensor for sensor in scene.sensor if sensor not in gone)
    return replace(scene, arm=replace(scene.arm, links=links), sensor=sensors)


def gauges_lost(scene: Scene, model: Model) -> list[Sensor]:
    """Strain gauges of the scene on links that do not bend in the model."""
    return [one for one in scene.sensor if one.kind == "strain" and model[scene.arm.number(one.link) - 1] is None]


def _divided(link: Link, bend: Bend | None) -> Link:
    if bend is None:
        return replace(link, lumping="gauss", **RIGID) if link.flex != "rigid" else link
    return replace(link, flex=bend.flex, segments=bend.hinges + 1, modes=bend.modes, lumping=bend.rule)


def limited_axes(axes: Sequence[str], top: str) -> Axes:
    """The axes of every link, limited to the axes in `top`."""
    return tuple(FLEX[min(FLEX.index(flex), FLEX.index(top))] for flex in axes)
