"""Names for integers: indices of the numbers in a row, or codes."""

from collections import namedtuple
from typing import Any, cast


def numbered(*names: str, start: int = 0) -> Any:
    """Return a record of named consecutive integers; `size` is the next one after them, and `name:3` takes three.

    Kernels use the record as a global: its fields become constants of the machine code.
    """
    fields, size = {}, start
    for each in " ".join(names).split():
        name, _, places = each.partition(":")
        fields[name], size = size, size + int(places or 1)
    record = cast("Any", namedtuple)("Numbers", [*fields, "size"])
    return record(*fields.values(), size)
