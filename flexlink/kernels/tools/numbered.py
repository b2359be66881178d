"""Names of numbers: where each number of a row stands, or what a code means."""

from collections import namedtuple
from typing import Any, cast


def numbered(*names: str, start: int = 0) -> Any:
    """Names for whole numbers, one after another, and `size` for their end; `name:3` takes three of them.

    Kernels read a record of them as a global: its fields are constants of their machine code.
    """
    fields, size = {}, start
    for each in " ".join(names).split():
        name, _, places = each.partition(":")
        fields[name], size = size, size + int(places or 1)
    record = cast("Any", namedtuple)("Numbers", [*fields, "size"])
    return record(*fields.values(), size)
