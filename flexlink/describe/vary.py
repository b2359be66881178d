"""The one way to vary a description: values by path, in the words of its TOML file.

A path leads from table to table (`run.step`), to materials and sections by name (`material.steel.young`), to links by
name or by number from 1 (`link.upper.length`, `link.2.length`), to motions by their link, to sensors by name, and so to
the items of lists of one number per link (`initial.joint_deg.upper`); to the components of vectors by x, y and z
(`gravity.x`). A name with a dot stands in quotes (`link."a.b".length`). `*` stands for all: of links, for those on
which the key has an effect. Messages name a value by the path that sets it.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_origin

import msgspec

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.memo import keep_last
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.own_units import IN_METRES, TWINS
from flexlink.describe.spec import Spec, Vector3, bare_type, fields_of, is_per_link, to_builtin, type_below

Keys = tuple[Any, ...]
"""Of tables, and numbers of items from 0."""


def apply_changes(document: dict[str, Any], kinds: Mapping[str, Any], changes: Mapping[str, object]) -> dict[str, Any]:
    """Put values into a parsed document, one after the other; what comes out is still to be checked as a whole.

    Parameters
    ----------
    document
        What `to_document` returns of a whole scene, its arm's keys beside its own; its tables and lists are copied on
        the way to what changes, and left as they are.
    kinds
        The annotation of each key at its top.
    changes
        Values by path; None leaves the key out, so that its default holds.

    Raises
    ------
    ArgumentError
        `changes` is no dict of values by path.
    SceneError
        A path that leads nowhere; the message names it, its value and what is allowed there.
    """
    if not isinstance(changes, Mapping):
        raise ArgumentError(
            f"changes = {truncated(changes)}: expected a dict such as {{'run.step': 1e-5}}", id="wrong-type"
        )
    for path, value in changes.items():
        if not isinstance(path, str):
            raise ArgumentError(f"changes: {truncated(path)}: expected a path such as 'run.step'", id="path-form")
        change = _Change(document, path, value)
        for node, key, _ in change.places(document, kinds):
            if change.drops and isinstance(node, dict):
                node.pop(key, None)
            else:
                node[key] = change.value
    return document


def top_level_keys(changes: Mapping[str, object]) -> set[str]:
    """Top-level keys of the scene that the changes touch."""
    paths = changes if isinstance(changes, Mapping) else ()
    return {part for path in paths if isinstance(path, str) for part in parts_of(path)[:1]}


@functools.lru_cache(maxsize=256)
def parts_of(path: str) -> tuple[str, ...]:
    """The keys and names of a path, none of what is no path."""
    part = r"""(?:"[^"]+"|'[^']+'|[^."']+)"""
    if not re.fullmatch(rf"{part}(?:\.{part})*", path):
        return ()
    return tuple(re.findall(r"""(?<=")[^"]+(?=")|(?<=')[^']+(?=')|[^."']+""", path))


def values_at(document: dict[str, Any], kinds: Mapping[str, Any], path: str) -> list[Any]:
    """What stands at a path: one value, or, with `*`, several; None where nothing does. Arguments: `apply_changes`.

    Raises
    ------
    SceneError
        The path leads nowhere.
    """
    places = _Change(document, path, None).places(document, kinds)
    return [node.get(key) if isinstance(node, dict) else node[key] for node, key, _ in places]


def number_in(values: Sequence[Any]) -> float:
    """The one number that stands at a path, from what `values_at` returns.

    Raises
    ------
    SceneError
        It is none, or there are several that differ; the message begins with the value, for the path to stand before.
    """
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        raise SceneError(f"{truncated(values[0])}: not a number in the scene; set it", id="not-a-number")
    if len(set(values)) != 1:
        raise SceneError(f"{truncated(values)}: the values differ; name each path by itself", id="paths-differ")
    return float(values[0])


def routes_to(document: dict[str, Any], kinds: Mapping[str, Any], path: str) -> list[tuple[Keys, Any]]:
    """Where a path leads: keys of tables and numbers of items from 0, and the annotation of what stands there.

    Arguments and errors as in `values_at`.
    """
    routes = []
    for _, _, route in _Change(document, path, None).places(document, kinds):
        kind: Any = kinds
        for key in route:
            kind = kind[key] if isinstance(kind, dict) else type_below(kind, str(key))
        routes.append((route, kind))
    return routes


def to_document(value: object) -> Any:
    """A description as a TOML parser returns it: dicts without keys that have no value, and lists."""
    if isinstance(value, Spec):
        return to_document(msgspec.to_builtins(value))
    if isinstance(value, dict):
        return {key: to_document(item) for key, item in value.items() if item is not None}
    return [to_document(item) for item in value] if isinstance(value, list | tuple) else value


def as_document(value: Any) -> Any:
    """A description as a TOML parser returns it, to look at only: variants share all of it but dicts."""
    if isinstance(value, dict):
        return {key: as_document(item) for key, item in value.items()}
    if isinstance(value, Spec | tuple):
        return _kept_document(value)
    return to_document(value)


@keep_last(64)
def _kept_document(part: Spec | tuple[Any, ...]) -> Any:
    """A part of scenes as a TOML parser returns it."""
    return to_document(part)


def parts_by_key(spec: Spec) -> dict[str, Any]:
    """The fields of a description by their keys in a file."""
    return {field.encode_name: getattr(spec, field.name) for field in fields_of(type(spec))}


@functools.cache
def _keys_of(kind: type[msgspec.Struct]) -> tuple[str, ...]:
    return tuple(field.encode_name for field in fields_of(kind))


class _Change:
    """One value, on the way to its place."""

    def __init__(self, document: dict[str, Any], path: str, value: object) -> None:
        self.path, self.value, self.parts, self.drops = path, value, parts_of(path), value is None
        if not self.parts:
            raise self.error("not a path; expected keys and names with dots between, such as run.step")
        if type(value) is not float:
            try:
                self.value = to_document(to_builtin(value))
            except RecursionError:
                raise SceneError(f"{path}: nested too deeply", id="nested-too-deeply") from None
        links = document.get("link")
        self.links = links if isinstance(links, list) else []

    def error(self, reason: str) -> SceneError:
        return SceneError(f"{truncated(self.path)[1:-1]} = {truncated(self.value)}: {reason}", id="cannot-set")

    def places(self, node: Any, kind: Any, above: Keys = ()) -> Iterator[tuple[Any, Any, Keys]]:
        """From a table or list of this kind follow the rest of the path.

        Yields tables or lists at its end, their keys, and all keys on the way there.
        """
        depth = len(above)
        for key in self._keys(node, kind, depth):
            if depth < len(self.parts) - 1:
                below = kind[key] if isinstance(kind, dict) else type_below(kind, str(key))
                if isinstance(node, dict) and key not in node:
                    node[key] = [0.0] * len(self.links) if is_per_link(below) else {}
                elif isinstance(node[key], dict | list):
                    node[key] = node[key].copy()
                yield from self.places(node[key], below, (*above, key))
            else:
                yield node, key, (*above, key)

    def _above(self, depth: int) -> str:
        return ".".join(self.parts[:depth])

    def _keys(self, node: Any, kind: Any, depth: int) -> Sequence[Any]:
        """Keys of the table, or numbers of the list's items from 0, that this part of the path stands for."""
        # what the components of a vector are called
        axes = ("x", "y", "z")
        # lists of tables other than links, and the key that names each
        named = {"motion": "link", "sensor": "name"}
        part = self.parts[depth]
        if isinstance(kind, dict):
            return [self._one_of(part, kind)]
        above, per_link, kind = self._above(depth), is_per_link(kind), bare_type(kind)
        if isinstance(node, dict) and isinstance(kind, type) and issubclass(kind, msgspec.Struct):
            return [self._one_of(part, _keys_of(kind))]
        if isinstance(node, dict) and get_origin(kind) is dict:
            new = depth == len(self.parts) - 1  # a material or section as a whole
            return list(node) if part == "*" else [part if new else self._one_of(part, node)]
        if isinstance(node, list) and above in named:
            return self._numbers(part, [str(get_in(item, named[above])) for item in node], [True] * len(node))
        if isinstance(node, list) and (above == "link" or per_link):
            return self._numbers(
                part, [str(get_in(link, "name")) for link in self.links], self._concerned(above, depth)
            )
        if isinstance(node, list) and kind == Vector3 and len(node) == len(axes):
            return [axes.index(self._one_of(part, axes))]
        raise self.error(f"{above} is one value; set it as a whole")

    def _one_of(self, part: str, names: Mapping[str, Any] | Sequence[str]) -> str:
        if part not in names:
            raise self.error(
                f"{part!r} is unknown here; allowed are {', '.join(names) or 'none'}{did_you_mean(part, names)}"
            )
        return part

    def _numbers(self, part: str, names: list[str], concerned: list[bool]) -> list[int]:
        """Which of the items that belong to the links of these names."""
        if part == "*" and any(concerned):
            return [k for k, counts in enumerate(concerned) if counts]
        if part in names:
            return [names.index(part)]
        if part.isdecimal() and 1 <= int(part) <= len(names):
            return [int(part) - 1]
        if not any(concerned):
            raise self.error(f"{part!r}: there is no {self.parts[0]} on which this has an effect")
        allowed = f"{', '.join(names)}, a number from 1 to {len(names)} or *"
        raise self.error(f"{part!r} is unknown here; allowed are {allowed}{did_you_mean(part, names)}")

    def _concerned(self, above: str, depth: int) -> list[bool]:
        """The links on which the key has an effect."""
        below = self.parts[depth + 1 :]
        free = [not get_in(link, "joint", "locked") for link in self.links]
        if above != "link":
            where, _, key = above.rpartition(".")
            every = [True] * len(free) if where == "initial" and key in {"joint_deg", "joint_m"} else free
            slides = [get_in(link, "joint", "kind") == "prismatic" for link in self.links]
            return [e and (key not in TWINS or s != (key in IN_METRES)) for e, s in zip(every, slides, strict=True)]
        if below and below[0] in {"flex", "segments", "lumping", "damping", "friction"}:
            return [(get_in(link, "flex") or "rigid") != "rigid" for link in self.links]
        if below and below[0] in {"material", "section", "section_tip", "up"}:
            return [get_in(link, "material") is not None for link in self.links]
        with_locked_joint = {"", "axis", "locked", "gear_stiffness", "gear_damping", "limits_deg", "limits_m", "kind"}
        return free if below[:1] == ("joint",) and ".".join(below[1:]) not in with_locked_joint else [True] * len(free)


def get_in(table: Any, *keys: str) -> Any:
    """What stands below the keys; None if nothing does, also where an earlier change put something else."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table
