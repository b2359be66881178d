"""Tables: for the page as rows of text and numbers, beside it as CSV with every digit."""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Sequence

Cell = str | float | None


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A table of a page, and the CSV file of the same rows.

    Attributes
    ----------
    name
        Name of its CSV file, without ending.
    title
        What it holds; also what those are told who cannot see it.
    heads
        Heads of the columns, with units.
    lines
        Rows of texts and numbers; None where there is nothing. The page rounds numbers, the file does not.
    to_look_up
        The table is to find a number in, not to be read: it is folded.
    """

    name: str
    title: str
    heads: tuple[str, ...]
    lines: tuple[tuple[Cell, ...], ...]
    to_look_up: bool = False

    @property
    def numeric(self) -> frozenset[str]:
        """Heads of the columns that hold nothing but numbers."""
        columns = zip(self.heads, zip(*self.lines, strict=True), strict=False)
        return frozenset(head for head, cells in columns if not any(isinstance(cell, str) for cell in cells))

    @property
    def rows(self) -> tuple[tuple[str, tuple[Cell, ...]], ...]:
        """The lines, each with the class that it has on the page: none."""
        return tuple(("", line) for line in self.lines)

    @property
    def csv(self) -> str:
        """The file."""
        return table_csv(self.heads, self.lines)


def table_csv(heads: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A CSV text of heads and lines; floats are written so that they read back exactly, None as nothing."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(["" if cell is None else cell for cell in line] for line in lines)
    return buffer.getvalue()
