"""Chapters of the report and its key numbers, read once from sections.toml."""

from __future__ import annotations

import collections
import functools
import importlib
import pkgutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from flexlink.data.documents import read_toml
from flexlink.describe.spec import Spec, decode

FILE = Path(__file__).parent / "sections.toml"
ANY = "*"  # as one of a chapter's `kinds`, means all kinds that no other chapter names


class Maker(NamedTuple):
    """A generator of figures or findings: id of its chapter, the stored series that it shows, the function."""

    section: str
    takes: tuple[str, ...]
    make: Callable[[Any], Iterator[Any]]


class Makers(dict[str, Maker]):
    """Makers by name, which is their order; as a decorator, given chapter and series, it adds a function.

    A series that no maker takes is drawn as plain curves.
    """

    def __call__(self, section: str, *takes: str) -> Callable[[Any], Any]:
        """Add a function."""

        def add(make: Any) -> Any:
            self[make.__name__] = Maker(section, takes, make)
            return make

        return add

    def load(self, folder: Iterable[str], package: str) -> None:
        """Import all files of a package."""
        for info in pkgutil.iter_modules(folder):
            importlib.import_module(f"{package}.{info.name}")

    @property
    def taken(self) -> set[str]:
        """All series that are taken."""
        return {what for maker in self.values() for what in maker.takes}

    def made(self, results: Any) -> Iterator[tuple[str, Any]]:
        """Yield (chapter id, figure or finding)."""
        for _, maker in sorted(self.items()):
            yield from ((maker.section, one) for one in maker.make(results))


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
    """A key number on the first screen: its label, and its values."""

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
