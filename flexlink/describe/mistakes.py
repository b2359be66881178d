"""Collect all mistakes of a parsed file, one message each, after decoding has failed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, get_args, get_origin

import msgspec

from flexlink.common.errors import ALSO, Diagnostic, SceneError
from flexlink.describe.spec import bare_type, decode, fields_of, key_mistakes, path_to, type_below


def mistakes(raw: Any, kind: Any, path: str = "") -> list[Diagnostic]:
    """Return all mistakes that `decode`, with the same arguments, would find in a value and its nested values."""
    try:
        decode(raw, kind, path)
    except SceneError as error:
        deep = error.id == "nested-too-deeply"
        return [error.diagnostic] if deep else list(_below(raw, kind, path)) or [error.diagnostic]
    return []


def _below(raw: Any, kind: Any, path: str) -> Iterator[Diagnostic]:
    """Mistakes in a table's keys and in lists of tables; none if the value itself has the wrong type."""
    bare = bare_type(kind)
    if get_origin(bare) is dict and isinstance(raw, dict):
        for key, item in raw.items():
            yield from mistakes(item, get_args(bare)[1], f"{path}.{key}")
    elif isinstance(bare, type) and issubclass(bare, msgspec.Struct) and isinstance(raw, dict):
        fields = fields_of(bare)
        names = [field.encode_name for field in fields]
        yield from key_mistakes(raw, names, (f.encode_name for f in fields if f.required), path)
        for key in raw.keys() & set(names):
            yield from mistakes(raw[key], type_below(bare, key), f"{path}.{key}".lstrip("."))
    elif get_origin(bare) is tuple and isinstance(raw, list) and Ellipsis in get_args(bare):
        for k, item in enumerate(raw):
            if isinstance(item, dict):
                yield from mistakes(item, get_args(bare)[0], path_to([k], raw, kind, path))


def raise_together(found: Iterable[Diagnostic]) -> None:
    """Raise one error that lists all mistakes, if there are any, with the id of the first mistake.

    Raises
    ------
    SceneError
        The mistakes, separated by "; also ".
    """
    # largest number of mistakes listed; a file with more is probably not a scene
    most = 20
    texts = list(dict.fromkeys(found))
    if texts:
        more = [f"{len(texts) - most} more"] if len(texts) > most else []
        raise SceneError(ALSO.join([*texts[:most], *more]), id=texts[0].id)


def check_all(checks: Sequence[Callable[[], object]]) -> None:
    """Run all checks, and raise all mistakes together as in `raise_together`."""
    found = []
    for check in checks:
        try:
            check()
        except SceneError as error:
            found.append(error.diagnostic)
    raise_together(found)
