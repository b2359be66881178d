"""Cells of a parameter map: scenes, axes that each vary one key, and plans that combine axes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np

from flexlink.chain.lumping import lump
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Spec
from flexlink.describe.vary import get_in, to_document
from flexlink.dynamics.vibration.extremes import fastest_frequency
from flexlink.motion.inputs.initial_state import initial_state
from validation.case import Case
from validation.trade.scenes import Varied, varied_scene

OF_STATE = "state."
"""Prefix of paths that belong to the initial state, not to the scene."""


class Axis(Spec, frozen=True):
    """One key of a scene, or several keys varied together, and the values.

    Attributes
    ----------
    values
        Each value is multiplied by the number or list that `paths` gives for a path.
    paths
        Paths as in `Scene.varied`; those that begin with "state." are handled by the kind.
    given
        Changes that are applied first, such as adding the table that contains the key.
    unit
        "times": values multiply the scene's value.  "fastest mode": values are damping ratios of the fastest mode and
        become loss times η = 2 ζ / ω.  "links": the number of copies of the last link; no paths.
    few
        Values used when the axis is combined with others; default: the first, the middle and the last.
    """

    values: tuple[float, ...]
    paths: dict[str, Any] = msgspec.field(default_factory=dict)
    given: dict[str, Any] = msgspec.field(default_factory=dict)
    unit: Literal["one", "times", "fastest mode", "links"] = "one"
    few: tuple[float, ...] = ()

    def of_a_few(self) -> tuple[float, ...]:
        """Values used when the axis is combined with others."""
        return self.few or tuple(dict.fromkeys(self.values[k] for k in (0, len(self.values) // 2, -1)))

    def changes(self, scene: Scene, value: float) -> dict[str, Any]:
        """Changes of the scene for one value, after `given` has been applied."""
        if self.unit == "links":
            return _with_links(scene, int(value))
        if self.unit == "times":
            arm = to_document(scene.arm)
            return {path: value * factor * get_in(arm, *path.split(".")) for path, factor in self.paths.items()}
        if self.unit == "fastest mode":
            chain = lump(scene)
            value *= 2.0 / fastest_frequency(chain, initial_state(scene, chain)[0])
        return {path: _times(value, weight) for path, weight in self.paths.items()}


class Plan(Spec, frozen=True):
    """Scenes, and axes of which `together` are varied at once (0: all axes); `steps` are settings of the kind.

    If axes are varied one at a time or all at once, they take all their values, otherwise only a few.
    """

    scenes: tuple[str, ...]
    axes: tuple[str, ...]
    steps: tuple[str, ...] = ()
    together: Annotated[int, msgspec.Meta(ge=0)] = 0

    def choices(self, axis: dict[str, Axis]) -> Iterator[dict[str, float]]:
        """Combinations of values, by name of the axis."""
        for names in itertools.combinations(self.axes, self.together or len(self.axes)):
            few = 1 < self.together < len(self.axes)
            values = (axis[name].of_a_few() if few else axis[name].values for name in names)
            yield from (dict(zip(names, chosen, strict=True)) for chosen in itertools.product(*values))


class Cell(NamedTuple):
    """A scene and the values of its axes."""

    scene: str
    values: dict[str, float]
    plan: Plan


class Map(Spec, frozen=True, kw_only=True):
    """Scenes, axes and their combinations; `change` applies to all scenes."""

    scene: dict[str, Varied]
    axis: dict[str, Axis]
    plan: tuple[Plan, ...]
    change: dict[str, Any] = msgspec.field(default_factory=dict)

    def cells(self) -> Iterator[Cell]:
        """All cells, in the order of the plans."""
        for plan in self.plan:
            for name in plan.scenes:
                yield from (Cell(name, values, plan) for values in plan.choices(self.axis))

    def situation(self, cell: Cell) -> tuple[Scene, dict[str, Any]]:
        """The scene of a cell, and the changes of its state.

        Raises
        ------
        FlexlinkError
            No such scene exists; the message names the value and the allowed values.
        """
        scene, state = varied_scene(self.scene[cell.scene], cell.scene).varied(self.change), dict[str, Any]()
        for name, value in cell.values.items():
            axis = self.axis[name]
            scene = scene.varied(axis.given) if axis.given else scene
            changes = axis.changes(scene, value)
            state |= {
                path.removeprefix(OF_STATE): changes.pop(path) for path in list(changes) if path.startswith(OF_STATE)
            }
            scene = scene.varied(changes) if changes else scene
        return scene, state


def recipe(case: Case, number: int) -> str:
    """The command that repeats one cell."""
    return f"python -m validation.cell {case.name} {number}"


def _times(value: float, weight: Any) -> Any:
    """Multiply `weight`, a number or a list, by the axis' value; round the product if the weight is an integer."""
    product = np.multiply(value, weight)
    return round(float(product)) if isinstance(weight, int) else product.tolist()


def _with_links(scene: Scene, number: int) -> dict[str, Any]:
    """Repeat the last link `number` times, each with the angle and rate of the last."""
    *before, last = to_document(scene.arm)["link"]
    links = [*before, *({**last, "name": f"{last['name']}{k + 1}"} for k in range(number))]
    state = {key: value for key in ("joint_deg", "rate_deg") if (value := getattr(scene.initial, key))}
    return {"link": links} | {f"initial.{key}": x[: len(before)] + x[-1:] * number for key, x in state.items()}
