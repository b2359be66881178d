"""Tables: rounded on the page, and with all digits in a CSV file next to it."""

import csv
import dataclasses
import io
import itertools
import math
import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Cell = str | float | None


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a page, its conclusion, and its CSV file."""

    name: str  # name of the CSV file of the table, without extension
    title: str  # title; also the text for screen readers
    heads: tuple[str, ...]  # heads of the columns, with units
    # rows of texts and numbers; None for an empty cell. Numbers are rounded on the page but not in the file
    lines: tuple[tuple[Cell, ...], ...]
    sentences: tuple[str, ...] = ()  # conclusions from the numbers, most important first
    to_look_up: bool = False  # whether the page folds the table, which is for reference only
    opened: bool = False  # whether the table stays open on pages that fold tables, since it is the main result
    classes: tuple[str, ...] = ()  # CSS class of each row; none if empty

    @property
    def numeric(self) -> frozenset[str]:
        """Heads of the numeric columns, which are right-aligned."""
        columns = zip(self.heads, zip(*self.lines, strict=True), strict=False)
        found = {head for head, cells in columns if all(map(_is_number, cells)) and set(cells) != {""}}
        return frozenset(found - {self.heads[0]} if any(isinstance(line[0], str) for line in self.lines) else found)

    @property
    def rows(self) -> tuple[tuple[str, tuple[Cell, ...]], ...]:
        """Rows with their CSS classes."""
        return tuple(zip(self.classes or ("",) * len(self.lines), self.lines, strict=True))

    @property
    def csv(self) -> str:
        """Content of the CSV file."""
        return table_csv(self.heads, self.lines)


def _is_number(cell: Cell) -> bool:
    """Whether a cell is empty, a number, or a number with a unit as text, for example "≤ 2 mm"."""
    longest = 24  # characters; a longer text counts as a sentence that begins with a number
    number = r"$|–$|(at most )?[<>≤≥]? ?[−-]?\d"
    return not isinstance(cell, str) or (len(cell) <= longest and re.match(number, cell) is not None)


def table_csv(heads: Sequence[str], lines: Iterable[Sequence[object]]) -> str:
    """CSV text of heads and lines; floats have all their digits, None is an empty field."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(heads)
    writer.writerows(lines)
    return buffer.getvalue()


def columns_csv(columns: Mapping[str, NDArray[np.float64]]) -> str:
    """CSV text of columns, by their heads; short columns end in nan."""
    lines = itertools.zip_longest(*(column.tolist() for column in columns.values()), fillvalue=math.nan)
    return table_csv(list(columns), lines)
