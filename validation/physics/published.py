"""Published numbers beside ours: what the report prints as a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from validation.store import Series, table


class Pair(NamedTuple):
    """A published number and ours, in the same unit."""

    what: str
    published: float
    ours: float


def published(pairs: Sequence[Pair], title: str) -> Series:
    """The series `published`, which is a table rather than a curve."""
    columns = table(("what", "published", "ours"), pairs)
    return Series("published", title, columns, "published", "published", "ours", group="what")
