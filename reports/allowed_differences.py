"""Numbers that may differ by more than rounding between two machines or installations, each with its reason."""

from __future__ import annotations

from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import Annotated

import msgspec

from flexlink.data.documents import read_toml
from flexlink.describe.spec import NonNegative, Spec, decode

FILE = Path(__file__).with_suffix(".toml")


class Allowed(Spec, frozen=True):
    """How far numbers whose case, engine and quantity match (globs) may differ, if by more than rounding.

    Either may be `factor` times the other, or they may differ by `absolute`. Numbers that depend on the machine, on its
    speed or its rounding (`by_machine`), are not compared; only whether they pass.
    """

    cases: tuple[str, ...]
    why: str
    engines: tuple[str, ...] = ("*",)
    quantities: tuple[str, ...] = ("*",)
    factor: Annotated[float, msgspec.Meta(ge=1)] = 1.0
    absolute: NonNegative = 0.0
    by_machine: bool = False

    def matches(self, case: str, engine: str, quantity: str) -> bool:
        """Whether the entry is about this number."""
        looked_for = ((case, self.cases), (engine, self.engines), (quantity, self.quantities))
        return all(any(fnmatchcase(text, pattern) for pattern in patterns) for text, patterns in looked_for)


class AllAllowed(Spec, frozen=True):
    """All entries of allowed_differences.toml."""

    allowed: tuple[Allowed, ...]


@cache
def exceptions() -> tuple[Allowed, ...]:
    """Entries of allowed_differences.toml."""
    found: AllAllowed = decode(read_toml(FILE), AllAllowed)
    return found.allowed


def exception_of(case: str, engine: str, quantity: str) -> Allowed:
    """The first entry that matches a number, or one that allows rounding only."""
    return next((one for one in exceptions() if one.matches(case, engine, quantity)), Allowed((case,), "rounding"))
