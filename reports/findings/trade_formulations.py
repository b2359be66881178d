"""CPU time and coordinates that every formulation of a bending link needs for an error, or its least error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flexlink.pages.numbers import number
from flexlink.pages.tables import Cell, Table
from reports.formulations import COST, MISSED, RUNS, SIZE, by_scene, errors_of, names_of, value
from reports.results import Results
from validation.store import Row

SECTION = "trade"
AIM = 1e-3  # error of the sentence
RATIO = "others / flexlink"
NOT_REACHED = "does not reach it"
RULES = (
    "flexlink's times are those of complete calls of a prepared problem, others only those of their solver. The best "
    "run of a ladder of settings counts."
)


def find(results: Results) -> Iterator[Table]:
    """One table: scenes and formulations against errors."""
    scenes = by_scene(results)
    if not scenes:
        return
    errors = errors_of([row for rows in scenes.values() for row in rows])
    costs, sizes = (tuple(f"{what}, error {number(error)}" for error in errors) for what in ("ms", "coordinates"))
    heads = ("scene", "formulation", *costs, *sizes, "least error", "its settings, or why not run")
    lines = tuple(
        (scene, name, *_cells(rows, name, errors)) for scene, rows in scenes.items() for name in names_of(rows)
    )
    title = "Formulations of a bending link: CPU time and coordinates for an error of the tip"
    yield Table("trade_formulations", title, heads, lines, tuple(_sentences(scenes)))


def _cells(rows: Sequence[Row], name: str, errors: Sequence[float]) -> Iterator[Cell]:
    own = [row for row in rows if row.varied.get("formulation") == name]
    if out := next((row for row in own if row.quantity == RUNS and not row.value), None):
        yield from ("" for _ in range(2 * len(errors) + 1))
        yield out.note
        return
    for error in errors:
        missed = value(own, MISSED, name, error) is not None
        yield NOT_REACHED if missed else value(own, COST, name, error)
    for error in errors:
        yield value(own, SIZE, name, error)
    least = next((row for row in own if row.quantity == "least error"), None)
    yield least.value if least else None
    yield least.note if least else ""


def _sentences(scenes: dict[str, list[Row]]) -> Iterator[str]:
    """How flexlink's cheapest formulation compares with the cheapest other program, at the error next to `AIM`."""
    found: dict[float, dict[str, float]] = {}
    for scene, rows in scenes.items():
        for row in rows:
            if row.quantity.removeprefix(f"{scene}, ").startswith(RATIO) and row.value is not None:
                found.setdefault(float(row.varied["relative error"]), {})[scene] = row.value
    if found:
        error = min(found, key=lambda each: abs(math.log(each / AIM)))
        won = ", ".join(f"{number(ratio, 2)} ({scene})" for scene, ratio in found[error].items() if ratio >= 1.0)
        lost = ", ".join(f"{number(ratio, 2)} ({scene})" for scene, ratio in found[error].items() if ratio < 1.0)
        cheapest = (
            f"At an error of {number(error)}, the CPU time of the cheapest other program, relative to flexlink's, is"
        )
        yield f"{cheapest} {won or lost}."
        if won and lost:
            yield f"It is below 1, so that program is cheaper, for {lost}."
    yield RULES
