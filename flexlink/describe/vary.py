"""Variation of a description: values are set by their key paths in its TOML file.

A path leads from table to table (`run.step`), to materials and sections by name (`material.steel.young`), to links by
name or number from 1 (`link.upper.length`, `link.2.length`), to motions by link and to sensors by name. It also leads
to items of lists of one number per link (`initial.joint_deg.upper`) and to vector components x, y and z (`gravity.x`).
Put a name with a dot in quotes (`link."a.b".length`). `*` selects all items, but only links on which the key has an
effect. Messages name a value by the path that sets it.
"""

import functools
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, get_origin

import msgspec

from flexlink.common.errors import ArgumentError, SceneError
from flexlink.common.memo import keep_last
from flexlink.common.wording import did_you_mean, truncated
from flexlink.describe.expected import why_not
from flexlink.describe.joint_units import fits_joint
from flexlink.describe.link import RIGID
from flexlink.describe.spec import Spec, Vector3, bare_type, fields_of, is_per_link, is_record, to_builtin, type_below

Keys = tuple[Any, ...]  # keys of tables, and indices of list items from 0


def apply_changes(document: dict[str, Any], kinds: Mapping[str, Any], changes: Mapping[str, object]) -> dict[str, Any]:
    """Insert values into a parsed document, in any order; the result must still be checked.

    First the values that decide which links a `*` selects, then tables before their parts, and `*` before names. A link
    that becomes rigid loses what only bending needs. The document is a complete scene from `to_document`, with the
    arm's keys at the top level, whose types are `kinds`; tables and lists that change are replaced by copies. None
    removes a key, which restores its default.
    """
    if not isinstance(changes, Mapping):
        text = f"changes = {truncated(changes)}: expected a dict such as {{'run.step': 1e-5}}"
        raise ArgumentError(text, id="wrong-type")
    for path in changes:
        if not isinstance(path, str):
            raise ArgumentError(f"changes: {truncated(path)}: expected a path such as 'run.step'", id="path-form")
    for path in sorted(changes, key=_place):
        change = _Change(document, path, changes[path])
        for node, key, route in change.targets(document, kinds):
            if key == "flex" and len(route) == 3 and change.value in (None, RIGID["flex"]):
                node.update(RIGID)
            if change.drops and isinstance(node, dict):
                node.pop(key, None)
            else:
                node[key] = change.value
    return document


def _place(path: str) -> tuple[bool, int, bool]:
    """Place of a change among others, as `apply_changes` orders them."""
    parts = parts_of(path)
    deciding = {(), ("flex",), ("material",), ("joint",), ("joint", "locked"), ("joint", "kind")}
    return parts[:1] != ("link",) or parts[2:] not in deciding, len(parts), "*" not in parts


def top_level_keys(changes: Mapping[str, object]) -> set[str]:
    """Top-level keys of the scene that the changes affect."""
    paths = changes if isinstance(changes, Mapping) else ()
    return {part for path in paths if isinstance(path, str) for part in parts_of(path)[:1]}


@functools.lru_cache(maxsize=256)
def parts_of(path: str) -> tuple[str, ...]:
    """Keys and names of a path; empty if it is not a valid path."""
    part = r"""(?:"[^"]+"|'[^']+'|[^."']+)"""
    if not re.fullmatch(rf"{part}(?:\.{part})*", path):
        return ()
    return tuple(re.findall(r"""(?<=")[^"]+(?=")|(?<=')[^']+(?=')|[^."']+""", path))


def values_at(document: dict[str, Any], kinds: Mapping[str, Any], path: str) -> list[Any]:
    """Values at a path: one, or several with `*`; None if nothing is there. Arguments as in `apply_changes`."""
    targets = _Change(document, path).targets(document, kinds)
    return [node.get(key) if isinstance(node, dict) else node[key] for node, key, _ in targets]


def number_in(values: Sequence[Any]) -> float:
    """Return the number at a path, from the result of `values_at`."""
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        raise SceneError(f"{truncated(values[0])}: not a number in the scene; set it", id="not-a-number")
    if len(set(values)) != 1:
        raise SceneError(f"{truncated(values)}: the values differ; name each path separately", id="paths-differ")
    return float(values[0])


def routes_to(document: dict[str, Any], kinds: Mapping[str, Any], path: str) -> list[tuple[Keys, Any]]:
    """Routes of a path, keys of tables and indices from 0, each with the type at its end; errors as in `values_at`."""
    routes = []
    for _, _, route in _Change(document, path).targets(document, kinds):
        kind: Any = kinds
        for key in route:
            kind = kind[key] if isinstance(kind, dict) else type_below(kind, str(key))
        routes.append((route, kind))
    return routes


def to_document(value: object) -> Any:
    """Return a description as parsed TOML, made of lists and of dicts without keys whose value is None."""
    if isinstance(value, Spec):
        return to_document(msgspec.to_builtins(value))
    if isinstance(value, dict):
        return {key: to_document(item) for key, item in value.items() if item is not None}
    return [to_document(item) for item in value] if isinstance(value, list | tuple) else value


def as_document(value: Any) -> Any:
    """Return a description as parsed TOML for reading only: variants share its parts, except dicts."""
    if isinstance(value, dict):
        return {key: as_document(item) for key, item in value.items()}
    return _kept_document(value) if isinstance(value, Spec | tuple) else to_document(value)


_kept_document = keep_last(64)(to_document)  # a part of a scene as parsed TOML, cached


def parts_by_key(spec: Spec) -> dict[str, Any]:
    """Fields of a description by their keys in a file."""
    return {field.encode_name: getattr(spec, field.name) for field in fields_of(type(spec))}


class _Change:
    """A path and the value that is inserted there; without a value, the path is only followed."""

    def __init__(self, document: dict[str, Any], path: str, value: object = ...) -> None:
        self.path, self.value, self.parts, self.drops = path, value, parts_of(path), value is None
        if not self.parts:
            raise self.error("not a path; expected keys and names separated by dots, such as run.step")
        if type(value) is not float:
            try:
                self.value = to_document(to_builtin(value))
            except RecursionError:
                raise SceneError(f"{path}: nested too deeply", id="nested-too-deeply") from None
        links = document.get("link")
        self.links = links if isinstance(links, list) else []

    def error(self, reason: str) -> SceneError:
        value = "" if self.value in (None, ...) else f" = {truncated(self.value)}"
        return SceneError(f"{truncated(self.path)[1:-1]}{value}: {reason}", id="cannot-set")

    def targets(self, node: Any, kind: Any, above: Keys = ()) -> Iterator[tuple[Any, Any, Keys]]:
        """Follow the path from a table or list of this kind; yield tables or lists at its end, keys, and routes."""
        depth = len(above)
        for key in self._keys(node, kind, depth):
            if depth < len(self.parts) - 1:
                below = kind[key] if isinstance(kind, dict) else type_below(kind, str(key))
                if isinstance(node, dict) and key not in node:
                    node[key] = [0.0] * len(self.links) if is_per_link(below) else {}
                elif isinstance(node[key], dict | list):
                    node[key] = node[key].copy()
                yield from self.targets(node[key], below, (*above, key))
            else:
                yield node, key, (*above, key)

    def _keys(self, node: Any, kind: Any, depth: int) -> Sequence[Any]:
        """Keys of the table, or indices of list items, selected by this part of the path."""
        axes = ("x", "y", "z")  # names of the components of a vector
        # lists of tables other than links, with the key that names their items
        named = {"motion": "link", "sensor": "name", "tie": "name"}
        part = self.parts[depth]
        if isinstance(kind, dict):
            inside = [f"{key}.{self.path}" for key in node if part not in kind and part in names_of(node[key])]
            return [self._one_of(part, kind, keys=True, meant=" or ".join(inside))]
        above, per_link, kind = ".".join(self.parts[:depth]), is_per_link(kind), bare_type(kind)
        if isinstance(node, dict) and is_record(kind):
            return [self._one_of(part, [field.encode_name for field in fields_of(kind)], keys=True)]
        if isinstance(node, dict) and get_origin(kind) is dict:
            new = depth == len(self.parts) - 1  # a complete material or section
            return list(node) if part == "*" else [part if new else self._one_of(part, node)]
        if isinstance(node, list) and (above in named or (above != "link" and any(isinstance(i, dict) for i in node))):
            names = [str(get_in(item, named[above]) if above in named else k) for k, item in enumerate(node, 1)]
            return self._numbers(part, names, [True] * len(node))
        if isinstance(node, list) and len(node) == len(self.links) and (above == "link" or per_link):
            names, concerned = [str(get_in(link, "name")) for link in self.links], self._concerned(above, depth)
            idle, below = part == "*" and above == "link" and not any(concerned), self.parts[depth + 1 :]
            # links that the same call makes rigid have one segment already
            there = idle and all(get_in(link, *below) == self.value for link in self.links)
            return [] if there else self._numbers(part, names, concerned)
        if isinstance(node, list) and kind == Vector3 and len(node) == len(axes):
            return [axes.index(self._one_of(part, axes))]
        kind_of = above.rpartition(".")[2]
        if isinstance(node, str) and kind_of in {"material", "section"}:
            raise self.error(f"{above} is the name {node!r}; write {kind_of}.{node}.{part}")
        raise self.error(f"{above} is one value; set it as a whole")

    def _one_of(self, part: str, names: Collection[str], *, keys: bool = False, meant: str = "") -> str:
        """Return `part`, which must be one of the names; a message on one of the `keys` suggests others, or `meant`."""
        if part not in names:
            item = "; an item of a list has its name or number as a part, such as link.1" * ("[" in part)
            above, _, below = part.partition("_")
            near = f"; did you mean '{above}.{below}'?" if above in names else did_you_mean(part, names)
            listed = f"; write {meant}" if meant else item or f"; allowed are {', '.join(names) or 'none'}{near}"
            raise self.error(f"{part!r} is unknown here{(keys and why_not(part, None, near)) or listed}")
        return part

    def _numbers(self, part: str, names: list[str], concerned: list[bool]) -> list[int]:
        """Indices of the items selected by `part`, for links with these names."""
        if part == "*" and any(concerned):
            return [k for k, counts in enumerate(concerned) if counts]
        if part in names:
            return [names.index(part)]
        if part.isdecimal() and 1 <= int(part) <= len(names):
            return [int(part) - 1]
        if not any(concerned):
            raise self.error(f"{part!r}: there is no {self.parts[0]} on which this has an effect")
        allowed = f"{', '.join(names)}, a number from 1 to {len(names)} or *"
        dotted = next((f'; quote a name with dots: link."{name}"' for name in names if name.startswith(f"{part}.")), "")
        listed = f"; allowed are {allowed}{dotted or did_you_mean(part, names)}"
        raise self.error(f"{part!r} is unknown here{why_not(part, None) or listed}")

    def _concerned(self, above: str, depth: int) -> list[bool]:
        """Whether the key has an effect on each link."""
        below = self.parts[depth + 1 :]
        free = [not get_in(link, "joint", "locked") for link in self.links]
        if above != "link":
            where, _, key = above.rpartition(".")
            every = [True] * len(free) if where == "initial" and key in {"joint_deg", "joint_m"} else free
            kinds = [get_in(link, "joint", "kind") for link in self.links]
            return [each and fits_joint(key, kind) for each, kind in zip(every, kinds, strict=True)]
        if below and below[0] in {"flex", "segments", "lumping", "modes", "shear", "stretch", "damping", "friction"}:
            return [(get_in(link, "flex") or "rigid") != "rigid" for link in self.links]
        if below and below[0] in {"material", "section", "section_tip", "up"}:
            return [get_in(link, "material") is not None for link in self.links]
        with_locked_joint = {"", "axis", "locked", "gear_stiffness", "gear_damping", "limits_deg", "limits_m", "kind"}
        return free if below[:1] == ("joint",) and ".".join(below[1:]) not in with_locked_joint else [True] * len(free)


def names_of(items: Any) -> Collection[Any]:
    """Keys of a table, or names of the tables in a list; none of anything else."""
    named = [get_in(item, "name") or get_in(item, "link") for item in items] if isinstance(items, list) else ()
    return items if isinstance(items, dict) else named


def get_in(table: Any, *keys: str) -> Any:
    """Value in nested tables at these keys; None if it does not exist, or an earlier change replaced a table."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table
