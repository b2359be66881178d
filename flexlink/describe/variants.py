"""Many variants of one scene, in which numbers are replaced without decoding the scene again; more hinges.

The resulting scene equals the one from `Scene.varied`, which is used if anything other than numbers changes, and if
replacing numbers fails, because `Scene.varied` explains invalid values in its messages.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, get_args, get_origin

import msgspec
from msgspec.structs import replace

from flexlink.common.errors import FlexlinkError, SceneError
from flexlink.common.wording import truncated
from flexlink.describe.hinges import hinges_of
from flexlink.describe.link import Link
from flexlink.describe.run_settings import implied
from flexlink.describe.scene import FIELDS, OF_ARM, Scene
from flexlink.describe.schemes.lumping_rules import lumping_rule
from flexlink.describe.spec import Spec, bare_type, build_validated, decode, fields_of, to_builtin
from flexlink.describe.vary import Keys, parts_by_key, parts_of, routes_to, to_document

Tree = dict[Any, Any]
Base = tuple[Scene, Mapping[str, Any], Tree]
"""A scene, the type annotation at each path, and a tree of field names whose leaves are the paths of the numbers to
insert."""


class Variants:
    """Variants of a scene by values at fixed paths, most of them numbers."""

    def __init__(self, scene: Scene, paths: Sequence[str]) -> None:
        # tables with paths that mean the same for all links
        independent = {"tip", "material", "section", "rigidity", "gravity", "run"}
        self.scene = scene
        elsewhere = {"run.tolerance", "run.relative_tolerance"}  # setting these also removes other settings
        numbers = [path for path in paths if path not in elsewhere and _is_number(scene, path)]
        tops = {parts_of(path)[:1] for path in paths if path not in numbers}
        if ("link",) in tops or ("motion",) in tops:
            numbers = [path for path in numbers if parts_of(path)[0] in independent]
            tops = {parts_of(path)[:1] for path in paths if path not in numbers}
        self.numbers = tuple(path for path in numbers if parts_of(path)[:1] not in tops)
        self._base: tuple[list[object], Base | None] | None = None  # scene for the last values that are not numbers

    def varied(self, changes: Mapping[str, object]) -> Scene:
        """Return the same scene, and raise the same errors, as `Scene.varied`; `changes` has a value for every path."""
        numbers = {path: value for path, value in changes.items() if path in self.numbers}
        if numbers:
            base = self._base_of({path: value for path, value in changes.items() if path not in numbers})
            variant = _variant(*base, numbers) if base is not None else None
            if variant is not None:
                return variant
        return self.scene.varied(changes) if changes else self.scene

    def _base_of(self, others: Mapping[str, object]) -> Base | None:
        values = list(others.values())
        if self._base is None or any(a is not b for a, b in zip(self._base[0], values, strict=True)):
            try:
                self._base = values, _base(self.scene.varied(others) if others else self.scene, self.numbers)
            except FlexlinkError:
                self._base = values, None
        return self._base[1]


def _variant(base: Scene, kinds: Mapping[str, Any], tree: Tree, numbers: Mapping[str, object]) -> Scene | None:
    """Return the scene with these numbers; None if `Scene.varied` must handle them."""
    if any(value is None for value in numbers.values()):
        return None
    try:
        read = {path: _read(value, kinds[path], path) for path, value in numbers.items()}
        scene: Scene = build_validated(_with, base, tree, read)
        if scene.arm.links is not base.arm.links:
            hinges_of(scene.arm)
    except (FlexlinkError, msgspec.ValidationError):
        return None
    return scene


def _base(scene: Scene, paths: Sequence[str]) -> Base | None:
    """Return the scene with a tree of the paths; None if its numbers cannot be replaced without decoding."""
    if not _reads_back(scene, paths):
        return None
    tree: Tree = {}
    kinds = {}
    for path in paths:
        for keys, kind in routes_to(scene.document(), FIELDS, path):
            kinds[path] = kind
            if not _plant(tree, scene, (("arm", *keys) if keys[0] in OF_ARM else keys), path):
                return None
    return scene, MappingProxyType(kinds), tree


def _reads_back(scene: Scene, paths: Sequence[str]) -> bool:
    """Whether `Scene.varied` would decode the changed parts to the same values, and would remove nothing else."""
    gone = implied(scene.run, dict.fromkeys(paths, 0.0))
    if gone and scene.varied(gone) != scene:
        return False
    tops = {parts_of(path)[0] for path in paths}
    document, parts = scene.document(tops), {**parts_by_key(scene), **parts_by_key(scene.arm)}
    return all(top in document and decode(document[top], FIELDS[top], top) == parts[top] for top in tops)


def _plant(tree: Tree, part: Any, keys: Keys, path: str) -> bool:
    """Insert a path into the tree at its keys; return False if that fails, or if another path leads there or beyond."""
    for k, given in enumerate(keys):
        key = given
        if isinstance(part, Spec):
            fields = fields_of(type(part))
            key = next((field.name for field in fields if given in {field.encode_name, field.name}), given)
            part = getattr(part, key)
        elif isinstance(part, dict | tuple):
            part = part[key]
        else:
            return False
        if k == len(keys) - 1:
            planted: bool = tree.get(key, path) == path
            tree[key] = path
            return planted
        tree = tree.setdefault(key, {})
        if not isinstance(tree, dict):
            return False
    return False


def _with(part: Any, tree: Tree | str, numbers: Mapping[str, Any]) -> Any:
    """Return a part of a scene with numbers inserted at the leaves of the tree."""
    if isinstance(tree, str):
        return numbers[tree]
    if isinstance(part, Spec):
        return replace(part, **{name: _with(getattr(part, name), below, numbers) for name, below in tree.items()})
    if isinstance(part, dict):
        return {**part, **{name: _with(part[name], below, numbers) for name, below in tree.items()}}
    return tuple(_with(item, tree[k], numbers) if k in tree else item for k, item in enumerate(part))


def _read(value: object, kind: Any, path: str) -> Any:
    if type(value) is float and math.isfinite(value):
        return msgspec.convert(value, kind)
    return decode(to_document(to_builtin(value)), kind, path)


def _is_number(scene: Scene, path: str) -> bool:
    """Whether a path leads to numbers or lists of numbers."""
    try:
        routes = routes_to(scene.document(), FIELDS, path)
    except FlexlinkError:
        return False
    return bool(routes) and all(map(_numeric, {kind for _, kind in routes}))


def _numeric(kind: Any) -> bool:
    bare = bare_type(kind)
    if get_origin(bare) is tuple:
        return all(_numeric(item) for item in get_args(bare) if item is not Ellipsis)
    return bare in {float, int}


def refined(scene: Scene, factor: float) -> Scene:
    """Return the scene with `factor` times the hinges in every link that bends, rounded up as the link's rule allows.

    They move one by one: a link with strain modes loses them, so the difference includes what its shapes leave out.
    """
    for name in ("q", "qd"):
        value = getattr(scene.initial, name)
        if value is not None:
            text = f"initial.{name} = {truncated(value)}: fits only one number of hinges"
            raise SceneError(f"{text}; use initial.joint_deg, rate_deg and passive", id="hinge-state-with-advice")
    return replace(scene, arm=replace(scene.arm, links=tuple(_refined(link, factor) for link in scene.arm.links)))


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
