"""Chapters of the report and its key numbers, read once from sections.toml."""

from __future__ import annotations

import collections
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode

FILE = Path(__file__).parent / "sections.toml"
ANY = "*"  # as one of a chapter's `kinds`, means all kinds that no other chapter names


class Wanted(Spec, frozen=True):
    """Worst value of a quantity over all matching rows of a kind; `pick` states whether the largest or the smallest."""

    kind: str
    quantity: str  # a pattern
    scene: str = ""
    engine: str = ""
    varied: dict[str, str | int | float] = {}  # noqa: RUF012  msgspec copies it
    pick: Literal["largest", "smallest"] = "largest"
    text: str = "{value}"  # a sentence, in which {value}, {quantity} and {where} are replaced
    times: float = 1.0  # factor from the row's unit to `unit`
    unit: str = ""
    beside: bool = False  # search only rows with the scene and settings of the number's first value


class Number(Spec, frozen=True):
    """A key number on the first screen: its label, and one or two values."""

    label: str
    value: tuple[Wanted, ...]


class Section(Spec, frozen=True):
    """A chapter: kinds of its cases, patterns of the figures shown unfolded, and its key numbers in sentences."""

    id: str
    title: str
    short: str
    text: str
    kinds: tuple[str, ...] = ()
    open: tuple[str, ...] = ()
    headline: tuple[Wanted, ...] = ()


class Paper(Spec, frozen=True):
    """The paper whose model is validated."""

    title: str
    source: str
    about: str  # what the paper describes, and what this study does with it


class Contents(Spec, frozen=True):
    """All contents of sections.toml."""

    paper: Paper
    number: tuple[Number, ...]
    section: tuple[Section, ...]


@functools.cache
def contents() -> Contents:
    """Contents of sections.toml."""
    found: Contents = decode(read_toml(FILE), Contents)
    return found


def sections() -> tuple[Section, ...]:
    """Chapters in order."""
    return contents().section


def chapter_of_kinds() -> Mapping[str, str]:
    """Kind → id of its chapter; kinds that no chapter names are in the chapter with `ANY`."""
    rest = next(section.id for section in sections() if ANY in section.kinds)
    return collections.defaultdict(lambda: rest, {kind: s.id for s in sections() for kind in s.kinds})
