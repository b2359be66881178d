"""Data sheets of the beam benchmarks, in the form of the IFToMM library of computational benchmarks.

Each sheet has a description, the definition of the error and the accepted error. It lists accuracy and CPU time
(including building and loading the model) with few, more and many hinges, for flexlink and, if possible, for MuJoCo.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

from flexlink.common.errors import FlexlinkError
from flexlink.describe.spec import decode
from validation import kinds
from validation.case import Case, Measured, load_cases
from validation.facts import Facts
from validation.kinds import kind
from validation.physics.variant import Rule
from validation.store import Series, table

ENGINES = {"native": "flexlink", "mujoco": "MuJoCo"}
HEADS = ("program", "rule", "hinges a link", "error", "accepted", "CPU time [s]")
WORTH_TWICE = 0.03  # s: shorter measurements are repeated, and the faster one counts


@kind(timed=True, beside=True, long=True)
def run(case: Case, benchmarks: tuple[str, ...] = ()) -> Iterator[Measured | Series]:
    """Yield a data sheet for each named benchmark, by default for all benchmarks that have one."""
    for sheet in (each for each in load_cases() if each.sheet and each.name in (benchmarks or (each.name,))):
        yield from _sheet(sheet)


def _sheet(case: Case) -> Iterator[Measured | Series]:
    assert case.sheet is not None
    measured = kinds.KINDS[case.kind]
    settings: Any = decode(case.settings, measured.settings, "settings")
    rows, best = [], float("inf")
    for engine, measure in measured.sheet.items():
        for at in _settings(settings):
            try:
                error, seconds = _timed(measure, case, settings, at)
            except FlexlinkError:  # the engine does not support this benchmark
                break
            facts: Facts = {"job": case.name, **at.facts}
            yield Measured("error", error, case.scenes[0], engine, facts)
            yield Measured("CPU time", seconds, case.scenes[0], engine, facts, timed=True)
            rows.append((ENGINES[engine], at.rule, at.hinges, error, case.sheet.accepted, seconds))
            best = min(best, error) if engine == "native" else best
    yield Measured("best error / accepted", best / case.sheet.accepted, case.scenes[0], varied={"job": case.name})
    about = f"{case.about} Error: {case.sheet.error}. Errors up to {case.sheet.accepted:g} are accepted."
    yield Series(
        "data sheet", f"{case.title}. {about}", table(HEADS, rows), "hinges a link", "", "error", part=case.name
    )


def _settings(settings: Any) -> list[Rule]:
    """The case's rule with three hinge counts: the least with all modes, the case's own or a middle one, the most."""
    rule, own = str(settings.best.rule), int(settings.best.hinges)
    counts = [n for n in sorted(settings.rules.get(rule, (own,))) if n >= getattr(settings, "modes", 1)]
    between = own if own in counts[1:-1] else counts[len(counts) // 2]
    return [Rule(rule=rule, hinges=n) for n in sorted({counts[0], between, counts[-1]})]


def _timed(measure: Callable[..., float], case: Case, settings: Any, at: Rule) -> tuple[float, float]:
    """The error and the CPU time [s] without compilation."""
    seconds = float("inf")
    for _ in range(2):
        start = time.process_time()
        error = measure(case, settings, at)
        seconds = min(seconds, time.process_time() - start)
        if seconds > WORTH_TWICE:
            break
    return error, seconds
