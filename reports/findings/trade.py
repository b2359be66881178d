"""Costs of models and programs at equal error."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Cell, Table
from reports.contests import LIMIT, Scene, ratios, scenes, why_not_advised
from reports.findings import finding
from reports.formulations import COST, MISSED, RUNS, SIZE, by_scene, errors_of, names_of, value
from reports.prices import AIMS, LOOKS, OURS, Price, errors, prices, works
from reports.results import Results
from reports.wording import from_to
from validation.store import Row

HEADS = ("scene", "error required", "cost of advise's pick / front", "pick; front")


@finding("trade")
def trade_advice(results: Results) -> Iterator[Table]:
    """What the model costs that `advise` picks, relative to the front of all contestants, for every scene and error.

    One table, if any scene has a pick.
    """
    found = scenes(results)
    lines = tuple((scene.name, each.error, each.value, each.note) for scene in found for each in ratios(scene))
    if lines:
        title = "What advise picks, relative to the cheapest run of all contestants with the same error"
        yield Table("trade_advice", title, HEADS, lines, tuple(sentences(found)))


def sentences(found: Sequence[Scene]) -> Iterator[str]:
    """The range of the costs, the number of scenes within the limit, and every scene that is not."""
    of = {scene.name: ratios(scene) for scene in found}
    values = [each.value for own in of.values() for each in own]
    span = f"{from_to(number(min(values)), number(max(values)))} times the CPU time of the front"
    yield f"The run that advise picks takes {span}, the cheapest run of any program with the same error."
    within = sum(bool(own) and all(each.value <= LIMIT for each in own) for own in of.values())
    where = f"{within} of {plural(len(of), 'scene')}"
    yield f"In {where}, this ratio is at most {number(LIMIT)} for all required errors."
    over = [
        f"{name} ({number(each.value)} for an error of {number(each.error)})"
        for name, own in of.items()
        for each in own
        if each.value > LIMIT
    ]
    if over:
        yield f"It is larger in: {', '.join(over)}."
    for scene in found:
        if not of[scene.name] and (why := why_not_advised(scene)):
            yield f"advise has no pick for {scene.name}. {why}"


AIM = 1e-3  # error of the sentence
OTHERS = "others / flexlink"
NOT_REACHED = "not reached"
RULES = (
    "flexlink's times are those of complete calls with a prepared problem; for other programs, only the time of the "
    "solver counts. Each formulation runs a list of settings, and its best run counts."
)


@finding("trade")
def trade_formulations(results: Results) -> Iterator[Table]:
    """CPU time and coordinates that every formulation of a bending link needs for an error, or its least error.

    One table: scenes and formulations against errors.
    """
    scenes = by_scene(results)
    if not scenes:
        return
    errors = errors_of([row for rows in scenes.values() for row in rows])
    costs, sizes = (tuple(f"{what}, error {number(error)}" for error in errors) for what in ("ms", "coordinates"))
    heads = ("scene", "formulation", *costs, *sizes, "least error", "its settings, or why not run")
    lines = tuple(
        (scene, name, *_formulation_cells(rows, name, errors))
        for scene, rows in scenes.items()
        for name in names_of(rows)
    )
    title = "Formulations of a bending link: CPU time and coordinates for an error of the tip"
    yield Table("trade_formulations", title, heads, lines, tuple(_formulation_sentences(scenes)))


def _formulation_cells(rows: Sequence[Row], name: str, errors: Sequence[float]) -> Iterator[Cell]:
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


def _formulation_sentences(scenes: dict[str, list[Row]]) -> Iterator[str]:
    """How flexlink's cheapest formulation compares with the cheapest other program, at the error next to `AIM`."""
    found: dict[float, dict[str, float]] = {}
    for scene, rows in scenes.items():
        for row in rows:
            if row.quantity.removeprefix(f"{scene}, ").startswith(OTHERS) and row.value is not None:
                found.setdefault(float(row.varied["relative error"]), {})[scene] = row.value
    if found:
        error = min(found, key=lambda each: abs(math.log(each / AIM)))
        won = ", ".join(f"{number(ratio, 2)} ({scene})" for scene, ratio in found[error].items() if ratio >= 1.0)
        lost = ", ".join(f"{number(ratio, 2)} ({scene})" for scene, ratio in found[error].items() if ratio < 1.0)
        cheapest = (
            f"For an error of {number(error)}, the CPU time of the cheapest other program, divided by flexlink's, is"
        )
        yield f"{cheapest} {won or lost}."
        if won and lost:
            yield f"Another program is cheaper where the ratio is below 1: {lost}."
    yield RULES


MOST = 8  # largest number of cases with a faster program that a sentence lists
FAVOUR = (
    "Where another program has no run with the error, its time is extrapolated by the order of the method, or it is "
    "the time of a run at the stability limit, which is assumed to be accurate. Both favour the other program."
)
Line = tuple[str, float, dict[str, Price]]  # scene, error, program → price


@finding("trade")
def trade_prices(results: Results) -> Iterator[Table]:
    """CPU time of each program's cheapest run for each scene and error, including cases in which flexlink is slower.

    One table for errors of the tip, and one for errors of the deflection.
    """
    for aim, word in AIMS.items():
        wanted = errors(results, aim)
        lines = [
            (series.scene, error, prices(results, case, series, aim, error))
            for case, series in works(results)
            for error in wanted
        ]
        if lines:
            yield _finding(word, lines)


def _finding(word: str, lines: list[Line]) -> Table:
    names = [who for who in LOOKS if any(who in price for _, _, price in lines)]
    shown = [LOOKS[who].name for who in names]
    times, methods = (f"{who} [ms]" for who in shown), (f"{who}: method" for who in shown)
    table = tuple((scene, error, *_cells(price, names)) for scene, error, price in lines)
    heads = ("scene", f"error of the {word}", *times, "cheapest other / flexlink", *methods)
    title = f"CPU time for an error of the {word}: cheapest run of each program"
    return Table(f"trade_prices.{word}", title, heads, table, _price_sentences(lines))


def _cells(price: dict[str, Price], names: list[str]) -> Iterator[float | str | None]:
    """CPU times, then the ratio, then the methods, which a narrow page may hide."""
    found = [price.get(who) for who in names]
    yield from (each and each.time for each in found)
    yield _ratio(price)
    yield from (each and each.by for each in found)


def _ratio(price: dict[str, Price]) -> float | None:
    """CPU time of the cheapest other program relative to flexlink's."""
    others = [each.time for who, each in price.items() if who != OURS]
    return min(others) / price[OURS].time if others and OURS in price else None


def _price_sentences(lines: list[Line]) -> tuple[str, ...]:
    ratios = {(scene, error): ratio for scene, error, price in lines if (ratio := _ratio(price)) is not None}
    lost = sorted((ratio, combination) for combination, ratio in ratios.items() if ratio < 1.0)
    nowhere = [f"{scene}, error {number(error)}" for scene, error, price in lines if OURS not in price]
    won = f"flexlink is the cheapest in {len(ratios) - len(lost)} of {len(ratios)} combinations of scene and error."
    sentences = [won]
    if lost:
        named = [
            f"{scene}, error {number(error)} ({number(ratio, 2)} × flexlink’s time)" for ratio, (scene, error) in lost
        ]
        more = "; …" if len(lost) > MOST else ""
        sentences.append(f"Another program is cheaper in {len(lost)} of them: {'; '.join(named[:MOST])}{more}.")
    if nowhere:
        sentences.append(f"flexlink does not reach the error within the study's time budget for: {'; '.join(nowhere)}.")
    return (*sentences, FAVOUR)
