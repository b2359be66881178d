"""First screen of the report: what was compared, when and on which machine, the verdicts, and the key numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from flexlink.common.wording import plural
from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import amount
from flexlink.pages.verdict import State, Verdict
from reports.chapters import Number, Wanted
from reports.claims import CONFIRMED, judging, standing
from reports.measurements import Lines, by_case, expectation, groups, lines_of
from reports.results import Results, used
from reports.tables import share
from reports.wording import displayed
from validation.judgement import JudgedRow, correctness, passing, speed
from validation.store import Row

PASS = "PASS"
VERIFICATION, VALIDATION = "Verification", "Validation"
NAMES = {package: engine_name(package) for package in ("pin", "mujoco", "drake", "exudyn")}
"""Engine names by package."""


@dataclasses.dataclass(frozen=True)
class Fact:
    """A key number: its label, and its values with remarks."""

    label: str
    values: tuple[tuple[str, str], ...]


@dataclasses.dataclass(frozen=True)
class CaseVerdict:
    """Summary of a case: checks, the check closest to its limit, time limits, and verdicts on claims or the model."""

    judged: int
    failed: int
    informing: int
    speed: str
    worst: Row | None  # check with the largest share of its limit
    claims: tuple[str, ...] = ()  # verdicts on published claims
    validated: str = ""  # result of the comparison with measurements; empty for other cases
    all_validated: bool = False

    @property
    def word(self) -> str:
        """The state; if all checks pass, the verdicts on claims or the result of the validation."""
        return (self.validated or "; ".join(self.claims) or self.state) if self.state == "pass" else self.state

    @property
    def look(self) -> str:
        """CSS class of the word; green only if every claim is confirmed and every measured quantity is validated."""
        doubted = (self.claims and set(self.claims) != {CONFIRMED.word}) or (self.validated and not self.all_validated)
        return "doubt" if doubted and self.state == "pass" else self.state.lower()

    @property
    def state(self) -> str:
        """'FAIL' or 'pass'; 'timed' or 'info' if there are no checks."""
        return "FAIL" if self.failed else "pass" if self.judged else "timed" if self.speed else "info"

    @property
    def text(self) -> str:
        """Summary in one line."""
        parts = []
        if self.judged:
            parts.append(f"{self.judged - self.failed} of {plural(self.judged, 'check')} pass")
        if self.worst and not self.failed:
            parts.append(f"the closest one uses {share(used(self.worst))} of its limit")
        if self.speed:
            parts.append(f"time limits: {self.speed}")
        if not parts:
            parts.append(f"{plural(self.informing, 'number')} without a limit")
        return "; ".join(parts)


def case_verdict(rows: Sequence[JudgedRow], validated: Lines | None = None) -> CaseVerdict:
    """Summary of a case; `validated` counts its measured quantities."""
    right, fast = correctness(rows), speed(rows)
    judged = [row for row in rows if row.passed is not None and not row.timed]
    worst = max(judged, key=lambda row: used(row) or 0.0, default=None)
    informing = sum(row.passed is None for row in rows)
    claims = tuple(dict.fromkeys(standing(row).word for row in judging(rows)))
    outcome = validated.brief if validated else ""
    all_validated = validated is not None and validated.all_agree
    return CaseVerdict(right.judged, len(right.failed), informing, fast.brief(), worst, claims, outcome, all_validated)


def case_verdicts(results: Results) -> dict[str, CaseVerdict]:
    """Summary of every case."""
    counts = by_case(results)
    return {case: case_verdict(rows, counts.get(case)) for case, rows in results.cases.items()}


def compared(results: Results) -> str:
    """Sentence that lists what is compared with what."""
    versions = results.environment.versions
    ours = f"flexlink {versions.get('flexlink', '')}".strip()
    engines = [f"{name} {versions[package]}" for package, name in NAMES.items() if versions.get(package)]
    exact = ["50-digit arithmetic"] if versions.get("mpmath") else []
    others = ", ".join([*engines, *exact]) + ", and with " if engines or exact else ""
    size = f"{plural(len(results.rows), 'number')} in {plural(len(results.cases), 'case')}"
    return f"The study compares {ours} with {others}published and exact solutions of beams. It measures {size}."


def measured(results: Results) -> str:
    """Date, machine, versions and commit."""
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


def verification(results: Results) -> Verdict:
    """Verdict on whether the equations are solved correctly: checks except time limits pass, and no case is missing."""
    judged, failed = correctness(results.rows)
    checks = plural(judged, "check")
    if failed:
        text = f"{len(failed)} of {checks} {'fails' if len(failed) == 1 else 'fail'}; see below."
    elif not judged:
        text = f"There are no checks: the study has {plural(len(results.rows), 'number')}, none with a limit."
    elif results.missing:
        text = f"No failure in {checks}, but {_missing(results)}."
    else:
        text = f"{passing(judged, judged)} in {plural(len(results.cases), 'case')}: the equations are solved correctly."
    if results.missing and (failed or not judged):
        text += f" {_missing(results)}."
    given_up = {(row.case, row.quantity) for row in results.rows if row.given_up}
    if given_up:
        were = "was" if len(given_up) == 1 else "were"
        text += f" {plural(len(given_up), 'limit')} {were} withdrawn; “Withdrawn limits” gives the reasons."
    state: State = "fail" if failed else "incomplete" if results.missing or not judged else "pass"
    return Verdict(VERIFICATION, state, state.upper(), text)


def _missing(results: Results) -> str:
    verb = "is" if len(results.missing) == 1 else "are"
    return f"{len(results.missing)} of {plural(len(results.plan), 'case')} {verb} missing"


def validation(results: Results) -> Verdict | None:
    """Verdict on how well the model predicts measurements, green only if all agree; None if there are none."""
    every = list(groups(results))
    if not every:
        return None
    lines = lines_of(every)
    state: State = "pass" if lines.all_agree else "doubt"
    return Verdict(VALIDATION, state, lines.brief, expectation(every))


def fast(results: Results) -> Verdict:
    """Verdict on whether the time limits are met; they are not checked on a busy machine."""
    found = speed(results.rows)
    state: State = "missed" if found.missed else "not-measured" if found.unmeasured or not found.met else "met"
    text = found.sentence()
    return Verdict("Speed", state, state.replace("-", " "), f"{text[0].upper()}{text[1:]}.")


def numbers_that_matter(results: Results, wanted: Iterable[Number]) -> list[Fact]:
    """Key numbers that the study contains."""
    found = []
    for each in wanted:
        first = worst(results, each.value[0])
        rows = [(want, worst(results, want, first if want.beside else None)) for want in each.value]
        values = tuple((_sentence(want, row), _remark(row)) for want, row in rows if row)
        if values:
            found.append(Fact(each.label, values))
    return found


def headlines(results: Results, wanted: Iterable[Wanted]) -> list[str]:
    """A sentence for each wanted quantity of the study, with a remark if it misses its limit."""
    found = []
    for want in wanted:
        row = worst(results, want)
        if row is None:
            continue
        remark, sentence = _remark(row), _sentence(want, row)
        found.append(f"{sentence.removesuffix('.')} ({remark})." if remark else sentence)
    return found


def _sentence(want: Wanted, row: Row) -> str:
    value = amount(want.times * (row.value or 0.0), want.unit or row.unit)
    return want.text.format(value=value, quantity=displayed(row.quantity), where=row.where)


def _remark(row: JudgedRow) -> str:
    """Remark that a number misses its limit or was timed on a busy machine; empty otherwise."""
    if row.busy:
        return "machine busy"
    return {"FAIL": "fails its limit", "missed": "misses its limit"}.get(row.state, "")


def worst(results: Results, want: Wanted, beside: Row | None = None) -> JudgedRow | None:
    """The row with the worst value among the matching ones; with `beside`, only of its scene and settings."""
    rows = [
        row
        for row in results.rows
        if row.kind == want.kind
        and fnmatchcase(row.quantity, want.quantity)
        and row.scene == (want.scene or row.scene)
        and row.engine == (want.engine or row.engine)
        and all(row.varied.get(name) == value for name, value in want.varied.items())
        and (beside is None or (row.scene, row.varied) == (beside.scene, beside.varied))
        and row.value is not None
    ]
    pick = min if want.pick == "smallest" else max
    return pick(rows, key=lambda row: row.value or 0.0) if rows else None
