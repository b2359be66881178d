"""What the first screen says: what was compared, when and on what, two verdicts, and the numbers that matter."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from flexlink.pages.numbers import amount, plural
from reports.chapters import Number, Wanted
from reports.results import Results, used
from reports.tables import FAIL, share, state
from validation.judgement import correctness, speed
from validation.store import Row

PASS, INCOMPLETE = "PASS", "INCOMPLETE"
NAMES = {"pin": "Pinocchio", "mujoco": "MuJoCo", "mpmath": "mpmath"}  # package → what was compared with


@dataclasses.dataclass(frozen=True)
class Verdict:
    """A verdict of the first screen: one word, and a sentence or two."""

    state: str
    text: str


@dataclasses.dataclass(frozen=True)
class Fact:
    """A number of the first screen: its values, each with what must be said beside it."""

    label: str
    values: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class CaseVerdict:
    """A case in a line: how many checks of correctness pass, what its limits of time came to, the closest check."""

    judged: int
    failed: int
    informing: int
    speed: str
    worst: Row | None  # the check of correctness that uses most of its limit

    @property
    def state(self) -> str:
        """'FAIL' or 'pass'; of a case without a check of correctness 'timed' or 'info'."""
        return FAIL if self.failed else "pass" if self.judged else "timed" if self.speed else "info"

    @property
    def text(self) -> str:
        """The line."""
        parts = []
        if self.judged:
            parts.append(f"{self.judged - self.failed} of {self.judged} pass")
        if self.worst and not self.failed:
            parts.append(f"at most {share(used(self.worst))} of a limit used")
        if self.speed:
            parts.append(f"speed: {self.speed}")
        if not parts:
            parts.append(f"{plural(self.informing, 'number')} without a limit")
        return "; ".join(parts)


def case_verdict(rows: Sequence[Row], results: Results) -> CaseVerdict:
    """The line of a case."""
    right, fast = correctness(rows), speed(rows, results.finished)
    judged = [row for row in rows if row.passed is not None and not row.timed]
    worst = max(judged, key=lambda row: used(row) or 0.0, default=None)
    informing = sum(row.passed is None for row in rows)
    return CaseVerdict(right.judged, len(right.failed), informing, fast.brief(), worst)


def compared(results: Results) -> str:
    """What was compared with what, in a sentence."""
    versions = results.environment.versions
    ours = f"flexlink {versions.get('flexlink', '')}".strip()
    engines = [f"{NAMES[name]} {versions[name]}" for name in ("pin", "mujoco") if versions.get(name)]
    exact = [f"50-digit arithmetic (mpmath {versions['mpmath']})"] if versions.get("mpmath") else []
    others = ", ".join([*engines, *exact, "published and exact solutions of beams"])
    return f"{ours} against {others}: {plural(len(results.cases), 'case')}, {plural(len(results.rows), 'number')}."


def measured(results: Results) -> str:
    """When, on which machine, with what."""
    environment = results.environment
    machines = "; ".join(dict.fromkeys(done.machine for done in results.finished.values())) or environment.processor
    cores = plural(environment.cores, "core") if environment.cores else ""
    named = {"Python": environment.python} | {n: environment.versions.get(n, "") for n in ("numpy", "numba")}
    libraries = [f"{name} {version}" for name, version in named.items() if version]
    commit = f"commit {environment.commit}" if environment.commit else ""
    parts = [_when(results), machines, cores, environment.system, *libraries, commit]
    return " · ".join(part for part in parts if part)


def _when(results: Results) -> str:
    dates = [done.date for done in results.finished.values()]
    if not dates:
        return f"begun {results.environment.date:%Y-%m-%d %H:%M} UTC" if results.environment.date else ""
    first, last = min(dates), max(dates)
    end = f"{last:%H:%M}" if first.date() == last.date() else f"{last:%Y-%m-%d %H:%M}"
    return f"{first:%Y-%m-%d, %H:%M} to {end} UTC"


def correct(results: Results) -> Verdict:
    """Whether everything is right; what is missing is never passed over."""
    judged, failed = correctness(results.rows)
    checks = plural(judged, "check")
    if failed:
        text = f"{len(failed)} of {checks} FAIL; they stand right below."
    elif not judged:
        text = f"Nothing was judged: {plural(len(results.rows), 'number')}, none with a limit."
    elif results.missing:
        text = f"No failure in {checks}, but {_missing(results)}."
    else:
        text = f"{judged} of {checks} pass ({plural(len(results.cases), 'case')})."
    if results.missing and (failed or not judged):
        text += f" Besides, {_missing(results)}."
    given_up = {(row.case, row.quantity) for row in results.rows if row.given_up}
    if given_up:
        text += f" {plural(len(given_up), 'limit')} of earlier versions given up: see “Limits given up”, with reasons."
    return Verdict(FAIL if failed else INCOMPLETE if results.missing or not judged else PASS, text)


def _missing(results: Results) -> str:
    return f"{len(results.missing)} of {plural(len(results.plan), 'case')} are missing"


def fast(results: Results) -> Verdict:
    """Whether the limits of time are met; a busy machine says nothing about them."""
    found = speed(results.rows, results.finished)
    word = "missed" if found.missed else "not measured" if found.unmeasured or not found.met else "met"
    return Verdict(word, f"{found.said()[0].upper()}{found.said()[1:]}.")


def numbers_that_matter(results: Results, wanted: Iterable[Number]) -> list[Fact]:
    """Those that the study holds."""
    found = []
    for each in wanted:
        rows = [(want, worst(results, want)) for want in each.value]
        values = tuple((_said(want, row), _remark(row, results)) for want, row in rows if row)
        if values:
            found.append(Fact(each.label, values))
    return found


def headlines(results: Results, wanted: Iterable[Wanted]) -> list[str]:
    """A sentence for each wanted quantity that the study holds; one that misses its limit says so."""
    found = []
    for want in wanted:
        row = worst(results, want)
        if row is None:
            continue
        remark = _remark(row, results)
        found.append(f"{_said(want, row)} ({remark})" if remark else _said(want, row))
    return found


def _said(want: Wanted, row: Row) -> str:
    return want.text.format(value=amount(row.value, row.unit), quantity=row.quantity, where=row.where)


def _remark(row: Row, results: Results) -> str:
    """What must be said beside a number: that it breaks its limit, or was timed on a busy machine."""
    if row.timed and results.finished[row.case].busy:
        return "machine busy"
    return {FAIL: "fails its limit", "missed": "misses its limit"}.get(state(row, results.finished), "")


def worst(results: Results, want: Wanted) -> Row | None:
    """The row of the worst value that fits, if any does."""
    rows = [
        row
        for row in results.rows
        if row.kind == want.kind
        and fnmatchcase(row.quantity, want.quantity)
        and row.scene == (want.scene or row.scene)
        and row.engine == (want.engine or row.engine)
        and all(row.varied.get(name) == value for name, value in want.varied.items())
        and row.value is not None
    ]
    pick = min if want.pick == "smallest" else max
    return pick(rows, key=lambda row: row.value or 0.0) if rows else None
