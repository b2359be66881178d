"""Formulations of bending links at equal error: chains, strain modes, finite elements, discrete rods.

Every formulation runs a ladder of settings, listed in the case; its best run counts for each error. The error is the
largest distance of the tip from a reference at any sample, relative to the length of the arm. References share no code
with a formulation, or are confirmed by two of them. CPU times are those of the thread: for flexlink a complete call of
a problem that has run before, for other programs only the call of their solver.

Other programs also compute the chain that flexlink exports. For `advise`, the picked run counts for the error that was
asked for, and is compared with the front: the cheapest run of all contestants with this error.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import msgspec

from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.formulations.ladder import ADVISE, FORMULATIONS, Rung, cheapest, climb, most_accurate, smallest
from validation.formulations.task import Described, Task, task_of
from validation.kinds import kind
from validation.store import Series, table

OURS = "native"
RUNS, STATED = "runs", "least error / stated"
PICK_ERROR, ASKED = "error of advise's pick / asked", "tip"
COLUMNS = "formulation", "settings", "coordinates", "error", "CPU time [s]"


class Settings(Spec, frozen=True):
    """Tasks to run, errors to reach, relative to the length, and all tasks by name."""

    scenes: tuple[str, ...]
    errors: tuple[Positive, ...]
    task: dict[str, Described]


class Climbed(NamedTuple):
    """A formulation with its runs."""

    name: str
    program: str
    rungs: list[Rung]


def _first_settings(task: dict[str, Described]) -> dict[str, Described]:
    """Tasks with the first setting of every ladder."""
    return {
        name: msgspec.structs.replace(
            each, ladder={key: {k: v[:1] for k, v in ladder.items()} for key, ladder in each.ladder.items()}
        )
        for name, each in task.items()
    }


@kind(timed=True, rehearsal={"task": _first_settings})
def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield for each task and formulation the cheapest and smallest runs, the least error, and the series of runs."""
    for name in settings.scenes:
        described = settings.task[name]
        errors = described.errors or settings.errors
        task, found = task_of(name, described), list[Climbed]()
        of_reference = task.reference.own_error / task.length / min(errors)
        yield Measured("reference's own error / least error asked", of_reference, name)
        for each, why in described.cannot.items():
            yield _not_run(name, each, why)
        for each, ladder in described.ladder.items():
            formulation = FORMULATIONS[each]
            if not formulation.installed:
                yield _not_run(name, each, f"{formulation.package} is not installed.")
                continue
            climbed = Climbed(each, formulation.program, climb(task, formulation, ladder))
            found.append(climbed)
            yield from _of_formulation(task, climbed, errors, described.reaches)
        for error in errors:
            rows = (*_ratio(task, found, error), *_of_advice(task, found, error))
            yield from (row for row in rows if not case.has_separate_limit(name, row.quantity))
        yield _series(task, found)


def _not_run(scene: str, name: str, why: str) -> Measured:
    return Measured(RUNS, 0, scene, FORMULATIONS[name].program, {"formulation": name}, note=why)


def _of_formulation(
    task: Task, climbed: Climbed, errors: tuple[float, ...], reaches: Mapping[str, float]
) -> Iterator[Measured]:
    facts: Facts = {"formulation": climbed.name}
    best = most_accurate(climbed.rungs)
    ended = sum(rung.error < float("inf") for rung in climbed.rungs)
    yield Measured(RUNS, ended, task.name, climbed.program, facts)
    least = best.error if best else float("nan")
    note = _words(best) if best else "No run ended."
    yield Measured("least error", least, task.name, climbed.program, facts, note=note)
    if climbed.name in reaches:
        ratio = least / reaches[climbed.name]
        yield Measured(STATED, ratio, task.name, climbed.program, facts, note=note)
    for error in errors:
        aim: Facts = {**facts, "relative error": error}
        rungs = [rung for rung in climbed.rungs if rung.setting.get(ASKED, error) == error]
        cheap, small = cheapest(rungs, error), smallest(rungs, error)
        if cheap is None or small is None:
            why = f"does not reach it: {note}"
            yield Measured("not reached", least, task.name, climbed.program, aim, note=why)
            continue
        seconds = 1e3 * cheap.seconds
        yield Measured("CPU time", seconds, task.name, climbed.program, aim, note=_words(cheap), timed=True)
        yield Measured("coordinates", small.coordinates, task.name, climbed.program, aim, note=_words(small))


def _words(rung: Rung) -> str:
    return f"{rung.words}: {rung.coordinates} coordinates, error {rung.error:.2g}"


def _ratio(task: Task, found: list[Climbed], error: float) -> Iterator[Measured]:
    """Yield the CPU time of the cheapest other program over flexlink's; 0 if flexlink does not reach the error.

    Other programs' own formulations and flexlink's chain in other programs are compared separately.
    """
    costs = _costs(found, error)
    ours = min((cost.seconds for each, cost in costs.items() if FORMULATIONS[each].program == OURS), default=None)
    for words, exported in (("others / flexlink", False), ("chains elsewhere / flexlink", True)):
        theirs = {
            each: cost.seconds
            for each, cost in costs.items()
            if FORMULATIONS[each].program != OURS and FORMULATIONS[each].is_exported_chain == exported
        }
        if theirs:
            name = min(theirs, key=lambda each: theirs[each])
            note = f"{name}: {1e3 * theirs[name]:.3g} ms" + (f"; flexlink: {1e3 * ours:.3g} ms" if ours else "")
            yield from _rows(task, words, error, theirs[name] / ours if ours else 0.0, note)


def _costs(found: list[Climbed], error: float) -> dict[str, Rung]:
    """Formulation → its cheapest run with this error, without the runs that `advise` picks."""
    best = {each.name: cheapest(each.rungs, error) for each in found if each.name != ADVISE}
    return {name: rung for name, rung in best.items() if rung is not None}


def _rows(task: Task, words: str, error: float, ratio: float, note: str) -> Iterator[Measured]:
    """Yield a ratio twice: for the limit of all scenes, and for that of this scene."""
    for quantity in (f"{words}, error {error:g}", f"{task.name}, {words}, error {error:g}"):
        yield Measured(quantity, ratio, task.name, varied={"relative error": error}, note=note, timed=True)


def _of_advice(task: Task, found: list[Climbed], error: float) -> Iterator[Measured]:
    """Yield the error of the run that `advise` picks for this error, over it, and its cost relative to the front."""
    picks = [rung for each in found if each.name == ADVISE for rung in each.rungs if rung.setting[ASKED] == error]
    for pick in picks:
        aim: Facts = {"formulation": ADVISE, "relative error": error}
        yield Measured(PICK_ERROR, pick.error / error, task.name, varied=aim, note=_words(pick))
        costs = _costs(found, error)
        if costs:
            name = min(costs, key=lambda each: costs[each].seconds)
            front = costs[name]
            note = f"pick: {1e3 * pick.seconds:.3g} ms, {pick.coordinates} coordinates; {pick.note}; "
            note += f"front: {1e3 * front.seconds:.3g} ms, {name}, {_words(front)}"
            yield from _rows(task, "advise / front", error, pick.seconds / front.seconds, note)


def _series(task: Task, found: list[Climbed]) -> Series:
    rows = [
        (each.name, rung.words, rung.coordinates, rung.error, rung.seconds)
        for each in found
        for rung in each.rungs
        if rung.error < float("inf")
    ]
    error, cost = COLUMNS[3:]
    return Series(
        "formulations", f"{task.name}: {task.scene.about}", table(COLUMNS, rows), error, "error, of the length [1]",
        cost, "log", "log", group="formulation", scene=task.name,
    )  # fmt: skip
