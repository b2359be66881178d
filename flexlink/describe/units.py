"""Units of a scene's numbers, from the annotations of its fields."""

from __future__ import annotations

from flexlink.describe.scene import FIELDS, Scene
from flexlink.describe.spec import bare_type, type_below, units_of
from flexlink.describe.vary import Keys, routes_to


def unit_of(scene: Scene, path: str) -> str:
    """Return the unit of the number at a path of `Scene.varied`; "" if it has no unit, or if the unit is ambiguous.

    Raises
    ------
    SceneError
        The path does not exist.
    """
    found = set()
    for keys, _ in routes_to(scene.document(), FIELDS, path):
        kind = FIELDS[keys[0]]
        units = units_of(kind)
        for key in keys[1:]:
            below = type_below(kind, str(key))
            units = units_of(below) if isinstance(bare_type(kind), type) else units
            kind = below
        found.add(_of_joint(scene, keys, units))
    return found.pop() if len(found) == 1 else ""


def _of_joint(scene: Scene, keys: Keys, units: tuple[str, ...]) -> str:
    """Choose the unit of a joint's number, for a revolute or a prismatic joint."""
    if len(units) == 2 and keys[0] == "link" and keys[2] == "joint":
        units = (units[scene.arm.slides[keys[1]]],)
    return units[0] if len(units) == 1 else ""
