"""Formulations at equal error: the rows and series of the kind `formulations`, one case for each scene."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.pages.colours import ENGINES, ORANGE, Look
from reports.results import Results
from validation.store import Row, Series

KIND, WHAT = "formulations", "formulations"
OURS = "native"
MARKERS = ("o", "s", "^", "D", "v", "P")
COST, SIZE, MISSED, RUNS = "CPU time", "coordinates", "not reached", "runs"


def by_scene(results: Results) -> dict[str, list[Row]]:
    """Scene → its rows, from the case with the most of them."""
    found: dict[str, list[Row]] = {}
    for _, rows in results.of_kind(KIND):
        for scene in dict.fromkeys(row.scene for row in rows):
            own: list[Row] = [row for row in rows if row.scene == scene]
            if len(own) > len(found.get(scene, [])):
                found[scene] = own
    return found


def series_of(results: Results) -> Iterator[tuple[str, Series]]:
    """(case, runs of a scene), from the case with the most rows of that scene."""
    cases = {scene: rows[0].case for scene, rows in by_scene(results).items()}
    yield from ((case, series) for case, series in results.showing(WHAT) if cases.get(series.scene) == case)


def errors_of(rows: Sequence[Row]) -> list[float]:
    """Errors asked for, the largest first."""
    return sorted({float(row.varied["relative error"]) for row in rows if "relative error" in row.varied}, reverse=True)


def names_of(rows: Sequence[Row]) -> list[str]:
    """Formulations in the order of measurement."""
    return list(dict.fromkeys(str(row.varied["formulation"]) for row in rows if "formulation" in row.varied))


def value(rows: Sequence[Row], quantity: str, name: str, error: float) -> float | None:
    """Value of a quantity for a formulation and an error; None if it was not measured."""
    wanted = {"formulation": name, "relative error": error}
    return next((row.value for row in rows if row.quantity == quantity and dict(row.varied) == wanted), None)


def looks(names: Sequence[str]) -> dict[str, Look]:
    """Colour by program and marker by formulation."""
    found: dict[str, Look] = {}
    for name in names:
        program, _, _ = name.lower().partition(" ")
        colour = ENGINES[program].colour if program in ENGINES else ENGINES[OURS].colour
        colour = ORANGE if program == "pyelastica" else colour
        used = sum(look.colour == colour for look in found.values())
        found[name] = Look(name, colour, MARKERS[used % len(MARKERS)])
    return found
