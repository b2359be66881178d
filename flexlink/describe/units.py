"""Units of a description's numbers, from the sentences below its fields: the one place where they stand.

A sentence has its unit in brackets, `[N m/rad]`; of a joint's number it has two, of one that turns, then of one that
slides.
"""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import re
import textwrap

from flexlink.describe.arm import Arm
from flexlink.describe.scene import FIELDS, Scene
from flexlink.describe.spec import Spec, bare_type, fields_of, type_below
from flexlink.describe.vary import Keys, routes_to

UNIT = re.compile(r"\[([^\[\],]+)\]")
UNTOLD = re.compile(r"1|.*(;|\bunit\b).*")
"""A pure number's, one of several, and one that a sensor's own key says."""


@functools.cache
def sentences(kind: type[Spec]) -> dict[str, str]:
    """What stands below each field of a description, by its key in a file; nothing where the source is not at hand."""
    told: dict[str, str] = {}
    for each in (part for part in reversed(kind.__mro__) if issubclass(part, Spec)):
        told |= _sentences(each)
    return {field.encode_name: told[field.name] for field in fields_of(kind) if field.name in told}


def _sentences(kind: type[Spec]) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(kind))
    except OSError:
        return {}
    (body,) = (node.body for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    return {
        field.target.id: inspect.cleandoc(str(text.value.value))
        for field, text in itertools.pairwise(body)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant)
    }  # fmt: skip


def units_in(sentence: str) -> tuple[str, ...]:
    """All units of a sentence, each once.

    >>> print(units_in("Spring of the gear [N m/rad]; of a prismatic joint [N/m]."))
    ('N m/rad', 'N/m')
    """
    return tuple(dict.fromkeys(UNIT.findall(re.sub(r"`[^`]*`", "", sentence))))


def unit_of(scene: Scene, path: str) -> str:
    """The unit of the number at a path of `Scene.varied`; "" of a pure number, or where the path alone does not say.

    Raises
    ------
    SceneError
        The path leads nowhere.
    """
    found = set()
    for keys, _ in routes_to(scene.document(), FIELDS, path):
        kind, sentence = FIELDS[keys[0]], (sentences(Scene) | sentences(Arm)).get(keys[0], "")
        for key in keys[1:]:
            if isinstance(bare_type(kind), type):
                sentence = sentences(bare_type(kind)).get(key, "")
            kind = type_below(kind, str(key))
        found.add(_of_joint(scene, keys, units_in(sentence)))
    return found.pop() if len(found) == 1 else ""


def _of_joint(scene: Scene, keys: Keys, units: tuple[str, ...]) -> str:
    """The unit that holds for the joint of a number."""
    if len(units) == 2 and keys[0] == "link" and keys[2] == "joint":
        units = (units[scene.arm.slides[keys[1]]],)
    return units[0] if len(units) == 1 and not UNTOLD.fullmatch(units[0]) else ""
