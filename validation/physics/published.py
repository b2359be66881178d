"""Published numbers beside ours: what the report prints as a table."""

from __future__ import annotations

from collections.abc import Sequence

from validation.store import Series, table


def published(pairs: Sequence[tuple[str, float, float]], title: str) -> Series:
    """The series `published`, a table rather than a curve: what it is, its published number and ours, in one unit."""
    columns = table(("what", "published", "ours"), pairs)
    return Series("published", title, columns, "published", "published", "ours", group="what")
