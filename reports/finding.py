"""A finding: what follows from the stored numbers, in sentences computed from them."""

from __future__ import annotations

import dataclasses


@dataclasses.dataclass(frozen=True)
class Finding:
    """Sentences, and the table that they stand on.

    Attributes
    ----------
    name
        Name of its CSV file, without ending.
    title
        What it is about.
    sentences
        The answer first.
    heads, lines
        The table: texts of the heads, and per line a label and numbers (None where there is nothing).
    """

    name: str
    title: str
    sentences: tuple[str, ...]
    heads: tuple[str, ...]
    lines: tuple[tuple[str | float | None, ...], ...]
