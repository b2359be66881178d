"""Compare the numbers of a study with published ones: equal to the bit, within rounding, or different.

If the sources are the same, all numbers must be equal, and none may be missing or new. If sources or a case were
edited, checks of both studies must agree within their limit, and no published check may be missing. Other numbers that
differ, are new or are missing are listed as moved. No limit may be wider than the published one, unless the case gives
a reason (`widened`).

Times, and counts of runs with a time budget, are listed separately, because they depend on the machine. Numbers that
may differ by more than rounding are listed in allowed_differences.toml. Numbers of programs that are not installed are
not compared, and counted.
"""

from __future__ import annotations

import csv
import dataclasses
import gzip
import io
from collections.abc import Iterable, Iterator
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from statistics import median
from typing import Annotated, Literal, NamedTuple

import msgspec

from flexlink.common.errors import FlexlinkError
from flexlink.common.wording import plural
from flexlink.data.documents import read_toml
from flexlink.describe.spec import NonNegative, Spec, decode
from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from reports.stored_full import COMMAND, read
from validation.facts import column_head
from validation.store import Row

ALLOWED = Path(__file__).parent / "allowed_differences.toml"


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
    found: AllAllowed = decode(read_toml(ALLOWED), AllAllowed)
    return found.allowed


def exception_of(case: str, engine: str, quantity: str) -> Allowed:
    """The first entry that matches a number, or one that allows rounding only."""
    return next((one for one in exceptions() if one.matches(case, engine, quantity)), Allowed((case,), "rounding"))


FILE = "all_checks.csv"
OF_LIMIT = 0.1  # fraction of a check's limit below which a difference is insignificant
RELATIVE, LEFT = 1e-6, 1e-12  # allowed rounding: relative to the larger number, and absolute [SI unit]
INFORMING, SMALL = 1e-3, 1e-9  # the same without a limit, or with a limit of zero: rounding errors may have grown
ROUNDING = "relative to the rounding bound"
"""If a metric contains these words, its number is relative to the rounding bound, and its natural limit is 1."""
PACKAGES = {"exudyn": "exudyn", "drake": "drake", "elastica": "pyelastica", "cvode": "scikit-sundae"}
"""Program, as in the column "engine" → its package, which is not part of the study's installation."""
FIXED = ("case", "scene", "engine", "quantity", "value", "tolerance", "bound", "timed", "state")
OF_SCALE = 1e-3  # allowed relative increase of a limit that is computed from a run, and so affected by rounding
Kind = Literal["equal", "rounding", "different", "moved", "timed"]
Key = tuple[str, str, str, str, frozenset[tuple[str, str]]]
"""Key of a number: case, scene, engine, quantity and settings."""


class Published(NamedTuple):
    """A published number; fields are None if it was not finite or had no limit."""

    value: float | None
    tolerance: float | None
    bound: str
    timed: bool


class Pair(NamedTuple):
    """A number of the study, and the published number, which is None if it was not finite."""

    row: Row
    published: float | None
    kind: Kind


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Numbers of both studies, those of only one study, and limits wider than the published ones."""

    pairs: tuple[Pair, ...]
    missing: tuple[str, ...]  # numbers in only one of the studies, although both must have them
    wider: tuple[str, ...]
    moved: tuple[str, ...]  # numbers in only one of the studies, because sources were edited
    unpublished: tuple[str, ...]  # cases of this study that have no published numbers
    cases: int  # number of cases in both studies
    published: int  # number of cases in the published study
    absent: tuple[str, ...] = ()  # programs of published numbers that are not installed here, once for each number

    def of(self, kind: Kind) -> list[Pair]:
        """Pairs whose comparison has this result."""
        return [pair for pair in self.pairs if pair.kind == kind]

    @property
    def same(self) -> bool:
        """Whether no number differs or is missing, and no limit is wider."""
        return not (self.of("different") or self.missing or self.wider)

    def sentences(self) -> list[str]:
        """The result in sentences, the verdict first."""
        partly = "" if self.cases == self.published else ", as far as compared"
        answer = f"These are{'' if self.same else ' not'} the published numbers{partly}."
        equal, rounding, different, timed = (self.of(kind) for kind in ("equal", "rounding", "different", "timed"))
        counts = (
            f"Compared: {self.cases} of {plural(self.published, 'published case')}. Of their numbers, {len(equal)} are "
            f"equal to the bit, {len(rounding)} differ by no more than rounding or their allowed difference, and "
            f"{len(different)} differ by more."
        )
        found = [answer, counts]
        if self.missing:
            found.append(f"Numbers in only one of the two studies: {len(self.missing)} ({self.missing[0]}, …).")
        if self.wider:
            found.append(f"Limits wider than the published ones: {len(self.wider)} ({self.wider[0]}, …).")
        if moved := [*self.moved, *(f"{pair.row.case}: {pair.row.quantity}" for pair in self.of("moved"))]:
            edited = len({words.partition(":")[0] for words in moved})
            listed = f"{plural(len(moved), 'number')} of {plural(edited, 'case')} ({moved[0]}, …)"
            found.append(f"Changed, new or missing, because sources were edited since: {listed}.")
        if self.unpublished:
            found.append(f"Not yet published: {plural(len(self.unpublished), 'case')} ({', '.join(self.unpublished)}).")
        ratios = [pair.row.value / pair.published for pair in timed if pair.row.value and pair.published]
        if timed:
            middle = f"; the median ratio to the published value is {number(median(ratios), 2)}" if ratios else ""
            found.append(f"Not compared, because they depend on the machine: {plural(len(timed), 'number')}{middle}.")
        if self.absent:
            names = ", ".join(sorted(set(map(engine_name, self.absent))))
            numbers = f"{plural(len(self.absent), 'number')} of {names}"
            found.append(f"Not compared, because the program is not installed here: {numbers}.")
        return found

    def table(self) -> Table:
        """A line per case with its largest difference; cases that differ come first."""
        by_case: dict[str, list[Pair]] = {}
        for pair in self.pairs:
            by_case.setdefault(pair.row.case, []).append(pair)
        cases = sorted(by_case.items(), key=lambda item: -_count(item[1], "different"))
        heads = ("case", "verdict", "equal to the bit", "within rounding", "different", "timed", "largest difference")
        lines = tuple(
            (case, "DIFFERENT" if _count(pairs, "different") else "same", *map(float, _counts(pairs)), _worst(pairs))
            for case, pairs in cases
        )
        classes = tuple("FAIL" if line[1] == "DIFFERENT" else "pass" for line in lines)
        return Table(
            "same", "Comparison with the published numbers", heads, lines, tuple(self.sentences()), classes=classes
        )


def compare(results: Results, folder: Path) -> Comparison:
    """Compare the numbers of a study with those in a folder, for example reports/full.

    Raises
    ------
    FlexlinkError
        The folder contains no `FILE`, or an invalid one.
    """
    every, absent = published_numbers(folder), _absent(results)
    published = {key: there for key, there in every.items() if key[2].lower() not in absent}
    known = {key[0] for key in every}
    edited = _edited(results, folder, known)
    own = {_key(row): row for row in results.rows if row.engine.lower() not in absent}
    here = known & {row.case for row in results.rows}
    both = [(row, published[key]) for key, row in own.items() if key in published]
    pairs = tuple(Pair(row, there.value, _kind(row, there, row.case in edited)) for row, there in both)
    new = [key for key, row in own.items() if key[0] in here and key not in published and not row.timed]
    gone = {key: there for key, there in published.items() if key[0] in here and key not in own}
    moved = [key for key in new if key[0] in edited]
    moved += [key for key, there in gone.items() if key[0] in edited and there.tolerance is None]
    gone_untimed = [key for key, there in gone.items() if not there.timed]
    missing = [key for key in (*new, *gone_untimed) if key not in moved and not _of_machine(key)]
    wider = tuple(_in_words(_key(row)) for row, there in both if _is_wider(row, there) and not row.widened)
    unpublished = tuple(dict.fromkeys(key[0] for key in own if key[0] not in known))
    lost, gained = (tuple(map(_in_words, some)) for some in (missing, moved))
    left_out = tuple(key[2] for key in every if key[0] in here and key not in published)
    return Comparison(pairs, lost, wider, gained, unpublished, len(here), len(known), left_out)


def _absent(results: Results) -> set[str]:
    """Programs that were not installed when this study ran."""
    versions = results.environment.versions
    return {program for program, package in PACKAGES.items() if versions.get(package) == ""}


def _edited(results: Results, folder: Path, known: set[str]) -> set[str]:
    """Published cases of which something that they depend on has changed, or may have."""
    published = read(folder)
    keys = published.study.keys if published else {}
    return {
        name for name in known if not keys.get(name) or name not in results.plan or results.plan[name].key != keys[name]
    }


def _is_wider(row: Row, there: Published) -> bool:
    """Whether the limit of a check is wider than the published one."""
    if there.tolerance is None or row.timed:
        return False
    if row.tolerance is None:
        return not row.given_up
    more = row.tolerance - there.tolerance if row.bound == "at most" else there.tolerance - row.tolerance
    return row.bound != there.bound or more > OF_SCALE * abs(there.tolerance)


def _key(row: Row) -> Key:
    facts = frozenset((column_head(name), str(value)) for name, value in row.varied.items())
    return row.case, row.scene, row.engine, row.quantity, facts


def _of_machine(key: Key) -> bool:
    """Whether the machine decides if a number exists."""
    case, _, engine, quantity, _ = key
    return exception_of(case, engine, quantity).by_machine


def _in_words(key: Key) -> str:
    case, scene, engine, quantity, facts = key
    return ", ".join(part for part in (f"{case}: {quantity}", scene, engine, *sorted(v for _, v in facts)) if part)


def published_numbers(folder: Path) -> dict[Key, Published]:
    """Published numbers by key."""
    lines = csv.DictReader(io.StringIO(_text(folder), newline=""))
    heads = lines.fieldnames or ()
    if lacking := [head for head in FIXED if head not in heads]:
        raise FlexlinkError(f"{folder / FILE}: column {lacking[0]!r} is missing; make the file with: {COMMAND}")
    varied = heads[list(heads).index("seconds") + 1 : list(heads).index("state")] if "seconds" in heads else ()
    found = dict[Key, Published]()
    try:
        for line in lines:
            facts = frozenset((head, line[head]) for head in varied if line[head])
            key = line["case"], line["scene"], line["engine"], line["quantity"], facts
            value, tolerance = (float(line[head]) if line[head] else None for head in ("value", "tolerance"))
            found[key] = Published(value, tolerance, line["bound"], line["timed"] == "True")
    except ValueError as error:
        raise FlexlinkError(f"{folder / FILE}, line {lines.line_num}: {error}") from None
    return found


def _text(folder: Path) -> str:
    plain, packed = folder / FILE, folder / f"{FILE}.gz"
    try:
        content = gzip.decompress(packed.read_bytes()) if packed.is_file() else plain.read_bytes()
        return content.decode()
    except (OSError, EOFError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise FlexlinkError(f"{plain}[.gz]: no published numbers ({why}); specify a folder like reports/full") from None


def _kind(row: Row, there: Published, edited: bool) -> Kind:
    if row.timed:
        return "timed"
    if row.value == there.value:
        return "equal"
    apart: Kind = "moved" if edited and row.tolerance is None else "different"
    exception = exception_of(row.case, row.engine, row.quantity)
    if _passes(row, row.value) is not _passes(row, there.value):
        return apart
    if exception.by_machine:
        return "timed"
    if row.value is None or there.value is None:
        return apart
    least, size = sorted((abs(row.value), abs(there.value)))
    most = max(allowed(row, size), exception.absolute, (exception.factor - 1) * least)
    if edited and row.tolerance is not None:
        most = max(most, abs(row.tolerance))
    return "rounding" if abs(row.value - there.value) <= most else apart


def _passes(row: Row, value: float | None) -> bool | None:
    if row.tolerance is None:
        return None
    if value is None:
        return False
    return value >= row.tolerance if row.bound == "at least" else value <= row.tolerance


def allowed(row: Row, size: float) -> float:
    """Allowed difference of two numbers of that size: a share of the check's limit, or the effect of rounding.

    A limit of zero has no scale: what is measured is a difference, whose rounding errors may have grown.
    """
    if row.tolerance:
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
    """Describe the number whose difference is the largest in units of the allowed difference; empty if none differs."""
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
    return abs(pair.row.value - pair.published) / (allowed(pair.row, size) or 1e-300)


def differences(comparison: Comparison) -> Iterator[str]:
    """A line for every number that differs."""
    for pair in comparison.of("different"):
        row = pair.row
        yield f"{row.case}: {row.quantity} ({row.where}) = {row.value} {row.unit}, published {pair.published}"
    yield from (f"in only one of the studies: {words}" for words in comparison.missing)
    yield from (f"limit wider than the published one: {words}" for words in comparison.wider)
