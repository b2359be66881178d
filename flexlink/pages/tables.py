"""Tables: for the page as rows of text and numbers, beside it as CSV with every digit."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Cell = str | float | None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a page, what follows from it, and the CSV file of the same rows.

    Attributes
    ----------
    name
        Name of its CSV file, without ending.
    title
        What it holds; also read out by screen readers.
    heads
        Heads of the columns, with units.
    lines
        Rows of texts and numbers; None where there is nothing. The page rounds numbers, the file does not.
    sentences
        What follows from the numbers, the answer first.
    to_look_up
        The table is to find a number in, not to be read: the page folds it.
    opened
        The table is itself the answer: where tables are folded, this one is not.
    classes
        CSS class of every line; none if empty.
    """

    name: str
    title: str
    heads: tuple[str, ...]
    lines: tuple[tuple[Cell, ...], ...]
    sentences: tuple[str, ...] = ()
    to_look_up: bool = False
    opened: bool = False
    classes: tuple[str, ...] = ()

    @property
    def numeric(self) -> frozenset[str]:
        """Heads of the columns of numbers, which are aligned to the right."""
        columns = zip(self.heads, zip(*self.lines, strict=True), strict=False)
        found = {head for head, cells in columns if all(map(_is_number, cells)) and set(cells) != {""}}
        return frozenset(found - {self.heads[0]} if any(isinstance(line[0], str) for line in self.lines) else found)

    @property
    def rows(self) -> tuple[tuple[str, tuple[Cell, ...]], ...]:
        """The lines, each with its CSS class."""
        return tuple(zip(self.classes or ("",) * len(self.lines), self.lines, strict=True))

    @property
    def csv(self) -> str:
        """The file."""
        return table_csv(self.heads, self.lines)


def _is_number(cell: Cell) -> bool:
    """Whether a cell holds a number, or a text of one with its unit, such as "≤ 2 mm", or nothing."""
    longest = 24  # characters; a longer text is a sentence that begins with a number
    number = r"$|–$|(at most )?[<>≤≥]? ?[−-]?\d"
    return not isinstance(cell, str) or (len(cell) <= longest and re.match(number, cell) is not None)


def table_csv(heads: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """A CSV text of heads and lines; floats are written so that they read back exactly, None as nothing."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(["" if cell is None else cell for cell in line] for line in lines)
    return buffer.getvalue()


def columns_csv(columns: Mapping[str, NDArray[np.float64]]) -> str:
    """A CSV text of columns of equal length, by their heads."""
    return table_csv(list(columns), zip(*(column.tolist() for column in columns.values()), strict=True))
