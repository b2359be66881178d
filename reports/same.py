"""Whether the numbers of a study are those of one that is checked in: equal to the bit, within rounding, different.

What was timed stands apart: it depends on the machine, as do counts of runs that had a budget of time.
"""

from __future__ import annotations

import csv
import dataclasses
import gzip
import io
from collections.abc import Iterable, Iterator
from pathlib import Path
from statistics import median
from typing import Literal, NamedTuple

from flexlink.common.errors import FlexlinkError
from flexlink.pages.numbers import number, plural
from flexlink.pages.tables import Table
from reports.results import Results
from reports.stored_full import COMMAND
from validation.facts import column_head
from validation.store import Row

FILE = "all_checks.csv"
OF_LIMIT = 0.1  # of a check's limit: what moves a check by less decides nothing
RELATIVE, LEFT = 1e-6, 1e-12  # of the larger number, and in its SI unit: what rounding leaves of any number
INFORMING, SMALL = 1e-3, 1e-9  # the same of a number without a limit, which may be rounding that has grown
ROUNDING = "what rounding explains"
"""In the words of a number without a limit: it is in parts of the rounding bound, whose limit is 1."""
BY_TIME = ("extremes",)  # kinds whose counts without a limit tell how many runs a budget of time let end
FIXED = ("case", "scene", "engine", "quantity", "value", "timed", "state")
Kind = Literal["equal", "rounding", "different", "timed"]
Asked = tuple[str, str, str, str, frozenset[tuple[str, str]]]
"""Case, scene, engine, quantity and what was varied: what a number answers."""


class Pair(NamedTuple):
    """A number of the study, and the published one; None where there is none."""

    row: Row
    published: float | None
    kind: Kind


@dataclasses.dataclass(frozen=True)
class Comparison:
    """All numbers that both have; `missing` are published, and not in the study's cases, and the other way round."""

    pairs: tuple[Pair, ...]
    missing: tuple[str, ...]
    cases: int  # that both have
    published: int  # cases of the published study

    def of(self, kind: Kind) -> list[Pair]:
        """The pairs of a kind."""
        return [pair for pair in self.pairs if pair.kind == kind]

    @property
    def same(self) -> bool:
        """Whether no number differs or is missing."""
        return not (self.of("different") or self.missing)

    def sentences(self) -> list[str]:
        """What came out, the answer first."""
        so_far = "" if self.cases == self.published else ", as far as they go"
        answer = f"These are{'' if self.same else ' not'} the published numbers{so_far}."
        equal, rounding, different, timed = (self.of(kind) for kind in ("equal", "rounding", "different", "timed"))
        counts = (
            f"{self.cases} of {plural(self.published, 'published case')} compared: {plural(len(equal), 'number')} "
            f"equal to the bit, {len(rounding)} within rounding, {len(different)} different."
        )
        found = [answer, counts]
        if self.missing:
            found.append(f"Only in one of both: {plural(len(self.missing), 'number')} ({self.missing[0]}, …).")
        ratios = [pair.row.value / pair.published for pair in timed if pair.row.value and pair.published]
        if timed:
            middle = f", in the middle {number(median(ratios), 2)} times the published value" if ratios else ""
            found.append(f"Apart, since the machine decides them: {plural(len(timed), 'number')}{middle}.")
        return found

    def table(self) -> Table:
        """A line a case, those that differ first, and what differs most in it."""
        by_case: dict[str, list[Pair]] = {}
        for pair in self.pairs:
            by_case.setdefault(pair.row.case, []).append(pair)
        cases = sorted(by_case.items(), key=lambda item: -_count(item[1], "different"))
        heads = ("case", "verdict", "equal to the bit", "within rounding", "different", "timed", "differs most")
        lines = tuple(
            (case, "DIFFERENT" if _count(pairs, "different") else "same", *map(float, _counts(pairs)), _worst(pairs))
            for case, pairs in cases
        )
        classes = tuple("FAIL" if line[1] == "DIFFERENT" else "pass" for line in lines)
        return Table(
            "same", "Your numbers and the published ones", heads, lines, tuple(self.sentences()), classes=classes
        )


def compare(results: Results, folder: Path) -> Comparison:
    """The numbers of a study beside those in a folder such as reports/full.

    Raises
    ------
    FlexlinkError
        The folder holds no `FILE`, or one that cannot be understood.
    """
    published, timed = _published(folder)
    known = {asked[0] for asked in published}
    own = {_asked(row): row for row in results.rows if row.case in known}
    here = {asked[0] for asked in own}
    pairs = tuple(
        Pair(row, published[asked], _kind(row, published[asked])) for asked, row in own.items() if asked in published
    )
    missing = [asked for asked, row in own.items() if asked not in published and not row.timed]
    missing += [asked for asked in published if asked[0] in here and asked not in own and asked not in timed]
    return Comparison(pairs, tuple(map(_in_words, missing)), len(here), len(known))


def _asked(row: Row) -> Asked:
    facts = frozenset((column_head(name), str(value)) for name, value in row.varied.items())
    return row.case, row.scene, row.engine, row.quantity, facts


def _in_words(asked: Asked) -> str:
    case, scene, engine, quantity, facts = asked
    return ", ".join(part for part in (f"{case}: {quantity}", scene, engine, *sorted(v for _, v in facts)) if part)


def _published(folder: Path) -> tuple[dict[Asked, float | None], set[Asked]]:
    """Published numbers by what they answer, and which of them were timed."""
    lines = csv.DictReader(io.StringIO(_text(folder), newline=""))
    heads = lines.fieldnames or ()
    if lacking := [head for head in FIXED if head not in heads]:
        raise FlexlinkError(f"{folder / FILE}: column {lacking[0]!r} is missing; make the file with: {COMMAND}")
    varied = heads[list(heads).index("seconds") + 1 : list(heads).index("state")] if "seconds" in heads else ()
    values, timed = dict[Asked, float | None](), set[Asked]()
    try:
        for line in lines:
            facts = frozenset((head, line[head]) for head in varied if line[head])
            asked = line["case"], line["scene"], line["engine"], line["quantity"], facts
            values[asked] = float(line["value"]) if line["value"] else None
            if line["timed"] == "True":
                timed.add(asked)
    except ValueError as error:
        raise FlexlinkError(f"{folder / FILE}, line {lines.line_num}: {error}") from None
    return values, timed


def _text(folder: Path) -> str:
    plain, packed = folder / FILE, folder / f"{FILE}.gz"
    try:
        content = gzip.decompress(packed.read_bytes()) if packed.is_file() else plain.read_bytes()
        return content.decode()
    except (OSError, EOFError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise FlexlinkError(f"{plain}[.gz]: no published numbers ({why}); such as reports/full hold them") from None


def _kind(row: Row, published: float | None) -> Kind:
    if row.timed or (row.tolerance is None and row.kind in BY_TIME):
        return "timed"
    if row.value == published:
        return "equal"
    if row.value is None or published is None or _passes(row, row.value) is not _passes(row, published):
        return "different"
    return (
        "rounding" if abs(row.value - published) <= _allowed(row, max(abs(row.value), abs(published))) else "different"
    )


def _passes(row: Row, value: float) -> bool | None:
    if row.tolerance is None:
        return None
    return value >= row.tolerance if row.bound == "at least" else value <= row.tolerance


def _allowed(row: Row, size: float) -> float:
    """How far two numbers of that size may be apart: a part of the check's own limit, or what rounding leaves."""
    if row.tolerance is not None:
        return max(OF_LIMIT * abs(row.tolerance), RELATIVE * size)
    if ROUNDING in row.metric:
        return max(OF_LIMIT, INFORMING * size)
    return max(INFORMING * size, SMALL if size < SMALL else LEFT)


def _counts(pairs: Iterable[Pair]) -> tuple[int, ...]:
    pairs = list(pairs)
    return tuple(_count(pairs, kind) for kind in ("equal", "rounding", "different", "timed"))


def _count(pairs: Iterable[Pair], kind: Kind) -> int:
    return sum(pair.kind == kind for pair in pairs)


def _worst(pairs: Iterable[Pair]) -> str:
    """The number that differs by most times what is allowed."""
    apart = [pair for pair in pairs if pair.kind == "different"]
    if not apart:
        return ""
    worst = max(apart, key=_times)
    return (
        f"{worst.row.quantity}, {worst.row.where}: {number(worst.row.value, 6)}, published {number(worst.published, 6)}"
    )


def _times(pair: Pair) -> float:
    if pair.row.value is None or pair.published is None:
        return float("inf")
    size = max(abs(pair.row.value), abs(pair.published))
    return abs(pair.row.value - pair.published) / (_allowed(pair.row, size) or 1e-300)


def differences(comparison: Comparison) -> Iterator[str]:
    """A line for every number that differs."""
    for pair in comparison.of("different"):
        row = pair.row
        yield f"{row.case}: {row.quantity} ({row.where}) = {row.value} {row.unit}, published {pair.published}"
    yield from (f"only in one of both: {words}" for words in comparison.missing)
