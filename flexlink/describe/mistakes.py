"""All mistakes of a parsed file, one message each: looked for where reading it has failed; none hides another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, get_args, get_origin

import msgspec

from flexlink.common.errors import ALSO, SceneError
from flexlink.common.wording import Diagnostic
from flexlink.describe.spec import bare_type, decode, fields_of, key_mistakes, path_to, type_below


def mistakes(raw: Any, kind: Any, path: str = "") -> list[Diagnostic]:
    """What `decode` finds wrong with a value and with all below it; arguments as there."""
    try:
        decode(raw, kind, path)
    except SceneError as error:
        deep = error.id == "nested-too-deeply"
        return [error.diagnostic] if deep else list(_below(raw, kind, path)) or [error.diagnostic]
    return []


def _below(raw: Any, kind: Any, path: str) -> Iterator[Diagnostic]:
    """Mistakes of a table's keys and of the tables in a list; none where the value as a whole is wrong."""
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


def raise_together(found: Iterable[str]) -> None:
    """Raise one error that tells all mistakes, if there are any.

    Raises
    ------
    SceneError
        The first one, and after "; also " each other one.
    """
    # how many mistakes are told; a file with more is of another kind
    most = 20
    told = list(dict.fromkeys(found))
    if told:
        more = [f"{len(told) - most} more"] if len(told) > most else []
        raise SceneError(ALSO.join([*told[:most], *more]), id=getattr(told[0], "id", "inconsistent"))


def check_all(checks: Sequence[Callable[[], object]]) -> None:
    """Make all checks, and raise what they find together; errors as in `raise_together`."""
    found = []
    for check in checks:
        try:
            check()
        except SceneError as error:
            found.append(error.diagnostic)
    raise_together(found)
