"""What a report says first: a verdict on each thing that can be judged."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

State = Literal["pass", "fail", "doubt", "info"]


@dataclasses.dataclass(frozen=True)
class Verdict:
    """A word on something, coloured by `state`, and a sentence."""

    about: str
    state: State
    word: str
    text: str


@dataclasses.dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes
    ----------
    page
        index.html in its folder.
    verdicts
        What its first screen says.
    failures
        Chapters that could not be computed, each with the reason.
    """

    page: Path
    verdicts: tuple[Verdict, ...]
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Nothing is known to be wrong."""
        return all(verdict.state != "fail" for verdict in self.verdicts)
