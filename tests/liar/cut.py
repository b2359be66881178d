"""Cases of the study cut short, and how often each is told a lie: `lies.toml`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import msgspec

from flexlink.describe import data_files
from flexlink.describe.spec import Spec, decode
from validation.case import CASES, Case, load_case
from validation.runner import measure
from validation.store import Row


class Lie(Spec, frozen=True):
    """What is wrong, by which part of itself, in which call, and the quantity that must fail.

    One call alone is wrong, so that a mean, or the best of all, would hide it. Where `size` is above a millionth, `why`
    says which limit is wider.
    """

    of: str
    size: float
    fails: str
    call: Literal["first", "middle", "last", "every"] = "middle"
    why: str = ""

    def at(self, calls: int) -> int | None:
        """The number of the wrong call, of so many; None for every one."""
        return {"first": 0, "middle": calls // 2, "last": calls - 1, "every": None}[self.call]


class Cut(Spec, frozen=True):
    """A case cut short: other settings, fewer scenes, rows of quantities that are then measured less often."""

    kind: str
    case: str
    lie: tuple[Lie, ...] = ()
    settings: dict[str, Any] = msgspec.field(default_factory=dict)
    scenes: tuple[str, ...] = ()
    rows: dict[str, int] = msgspec.field(default_factory=dict)
    only: tuple[str, ...] = ()  # quantities; default: all

    def __str__(self) -> str:
        return self.case

    @property
    def made(self) -> Case:
        """The case."""
        case = next(iter(load_case(CASES / f"{self.case}.toml").divided()))
        kept = {name: each for name, each in case.quantity.items() if not self.only or name in self.only}
        return msgspec.structs.replace(
            case, scenes=self.scenes or case.scenes, settings=case.settings | self.settings,
            quantity={name: msgspec.structs.replace(each, rows=self.rows.get(name, each.rows))
                      for name, each in kept.items()},
        )  # fmt: skip


def load() -> list[Cut]:
    """All of them."""
    raw = data_files.read_toml(Path(__file__).parent / "lies.toml")
    return [decode({"kind": kind} | {"case": kind} | each, Cut, kind) for kind, cuts in raw.items() for each in cuts]


def rows_of(case: Case) -> list[Row]:
    """Judged rows of a case."""
    return [row for row in measure(case, "") if isinstance(row, Row)]
