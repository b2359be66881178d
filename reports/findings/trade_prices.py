"""CPU time of each program's cheapest run for each scene and error, including cases in which flexlink is slower."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.prices import AIMS, LOOKS, OURS, Price, errors, prices, works
from reports.results import Results

SECTION = "trade"
MOST = 8  # largest number of cases with a faster program that a sentence lists
FAVOUR = (
    "Times of other programs without a run are extrapolated by the order of the method, or taken from a run at the "
    "stability limit that is assumed to be accurate. Both are in their favour."
)
Line = tuple[str, float, dict[str, Price]]  # scene, error, program → price


def find(results: Results) -> Iterator[Table]:
    """One table for errors of the tip, and one for errors of the deflection."""
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
    return Table(f"trade_prices.{word}", title, heads, table, _sentences(lines))


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


def _sentences(lines: list[Line]) -> tuple[str, ...]:
    ratios = {(scene, error): ratio for scene, error, price in lines if (ratio := _ratio(price)) is not None}
    lost = sorted((ratio, combination) for combination, ratio in ratios.items() if ratio < 1.0)
    nowhere = [f"{scene} at {number(error)}" for scene, error, price in lines if OURS not in price]
    won = f"flexlink is the cheapest in {len(ratios) - len(lost)} of {len(ratios)} combinations of scene and error."
    sentences = [won]
    if lost:
        named = [f"{scene} at {number(error)} ({number(ratio, 2)} × flexlink’s time)" for ratio, (scene, error) in lost]
        more = "; …" if len(lost) > MOST else ""
        sentences.append(f"Another program is cheaper in {len(lost)} of them: {'; '.join(named[:MOST])}{more}.")
    if nowhere:
        sentences.append(f"flexlink does not reach the error within the study's time budget for: {'; '.join(nowhere)}.")
    return (*sentences, FAVOUR)
