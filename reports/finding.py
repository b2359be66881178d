"""A finding: what follows from the stored numbers, in sentences computed from them."""

from __future__ import annotations

import dataclasses

SHORT = 24  # characters; what is no longer may be a number with its unit


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
    opened
        The table is the answer itself: it stands unfolded.
    to_look_up
        The table is to find a number in, not to be read: it stands after the chapter's figures, in a box of its own.
    """

    name: str
    title: str
    sentences: tuple[str, ...]
    heads: tuple[str, ...]
    lines: tuple[tuple[str | float | None, ...], ...]
    opened: bool = False
    to_look_up: bool = False

    @property
    def numeric(self) -> frozenset[str]:
        """Heads of the columns of numbers."""
        return frozenset(head for k, head in enumerate(self.heads) if k not in self.words)

    @property
    def rows(self) -> tuple[tuple[str, tuple[str | float | None, ...]], ...]:
        """The lines, each with the class that it has on the page: none."""
        return tuple(("", line) for line in self.lines)

    @property
    def words(self) -> frozenset[int]:
        """Columns of words, by number, which are set to the left and wrapped; numbers stand to the right."""
        return frozenset(k for line in self.lines for k, cell in enumerate(line) if _is_words(cell, k))


def _is_words(cell: str | float | None, column: int) -> bool:
    return isinstance(cell, str) and (column == 0 or len(cell) > SHORT)
