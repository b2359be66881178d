"""The chapters of the report, and the numbers that it says in words: data of sections.toml, read once."""

from __future__ import annotations

import collections
import functools
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode

FILE = Path(__file__).parent / "sections.toml"
ANY = "*"  # the chapter that takes the kinds which no other names


class Wanted(Spec, frozen=True):
    """The worst value of a quantity, over all rows of a kind that fit the rest; `pick` says which end is worse."""

    kind: str
    quantity: str  # a pattern
    scene: str = ""
    engine: str = ""
    varied: dict[str, str | int | float] = {}  # noqa: RUF012  msgspec copies it
    pick: Literal["largest", "smallest"] = "largest"
    text: str = "{value}"  # {value}, {quantity}, {where}
    times: float = 1.0  # the value is shown times this, in `unit`
    unit: str = ""
    beside: bool = False  # of the scene and the settings that the first value of its number was found at


class Number(Spec, frozen=True):
    """One of the numbers of the first screen: what it says, and one or two values."""

    label: str
    value: tuple[Wanted, ...]


class Section(Spec, frozen=True):
    """A chapter: the kinds of its cases, sentences with numbers, and the figures (patterns) that stand unfolded."""

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
    about: str  # what it describes, and what is done with it here


class Contents(Spec, frozen=True):
    """The whole file."""

    paper: Paper
    number: tuple[Number, ...]
    section: tuple[Section, ...]


@functools.cache
def contents() -> Contents:
    """The file."""
    found: Contents = decode(read_toml(FILE), Contents)
    return found


def sections() -> tuple[Section, ...]:
    """The chapters, in order."""
    return contents().section


def chapter_of_kinds() -> Mapping[str, str]:
    """Kind → id of its chapter; a kind that none names goes to the one that takes the rest."""
    rest = next(section.id for section in sections() if ANY in section.kinds)
    return collections.defaultdict(lambda: rest, {kind: s.id for s in sections() for kind in s.kinds})
