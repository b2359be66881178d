"""Names for integers: indices of the numbers in a row, or codes."""

from collections import namedtuple
from typing import Any, cast


def numbered(*names: str, start: int = 0) -> Any:
    """Return a record of consecutive integers by name, with `size` for their end; `name:3` takes three of them.

    Kernels use the record as a global: its fields become constants of the machine code.
    """
    fields, size = {}, start
    for each in " ".join(names).split():
        name, _, places = each.partition(":")
        fields[name], size = size, size + int(places or 1)
    record = cast("Any", namedtuple)("Numbers", [*fields, "size"])
    return record(*fields.values(), size)
