"""The trade on one page: contestants, their runs on every scene, and what `advise` picks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from flexlink.pages.colours import BLUE, ENGINES, GREEN, Look
from reports.formulations import by_scene, series_of
from reports.prices import Run, front
from reports.results import Results
from validation.store import Row, Series

ADVISE = "advise"
RATIO = "advise / front"
LIMIT = 1.3
AIM = "error"


class Contest(NamedTuple):
    """A contestant: beginnings of the names of its formulations, its look, whether it is flexlink's, its line."""

    starts: tuple[str, ...]
    look: Look
    ours: bool = False
    line: str = "-"


def _theirs(engine: str, what: str, marker: str) -> Look:
    return Look(f"{ENGINES[engine].name} {what}", ENGINES[engine].colour, marker)


CONTESTS = (
    Contest(("chain",), Look("flexlink chain", BLUE, "o"), ours=True),
    Contest(("strain",), Look("flexlink modes", BLUE, "^"), ours=True, line=":"),
    Contest(("MuJoCo chain",), _theirs("mujoco", "chain", "D")),
    Contest(("MuJoCo flex",), _theirs("mujoco", "flex", "s"), line=":"),
    Contest(("Pinocchio chain",), _theirs("pinocchio", "chain", "s")),
    Contest(("Drake chain",), _theirs("drake", "chain", "v")),
    Contest(("Exudyn",), _theirs("exudyn", "elements", "P")),
    Contest(("PyElastica",), Look("PyElastica rods", GREEN, "X")),
)
"""In the order of the legend."""


class Scene(NamedTuple):
    """A scene: its runs by contestant, with the formulation as the method, what `advise` picks, and its rows."""

    name: str
    about: str
    runs: dict[Contest, list[Run]]
    picks: list[Run]  # the one for each error asked; the setting is that error
    rows: list[Row]


def scenes(results: Results) -> list[Scene]:
    """All scenes of the case, in its order."""
    rows = by_scene(results)
    return [
        Scene(series.scene, series.title.removeprefix(f"{series.scene}: "), *_split(series), rows[series.scene])
        for _, series in series_of(results)
    ]


def _split(series: Series) -> tuple[dict[Contest, list[Run]], list[Run]]:
    runs: dict[Contest, list[Run]] = {contest: [] for contest in CONTESTS}
    picks = []
    names = ("formulation", "settings", AIM, "CPU time [s]")
    for name, settings, error, seconds in zip(*(series.columns[each].tolist() for each in names), strict=True):
        if name == ADVISE:
            picks.append(Run(name, name, float(settings.removeprefix("tip ")), seconds, 0, {AIM: error}))
        else:
            contest = next(each for each in CONTESTS if name.startswith(each.starts))
            runs[contest].append(Run(contest.look.name, name, 0.0, seconds, 0, {AIM: error}))
    return runs, picks


def best(runs: Sequence[Run], error: float) -> Run | None:
    """The cheapest run with this error."""
    return min((run for run in runs if run.errors[AIM] <= error), key=lambda run: run.seconds, default=None)


def fronts(scene: Scene, largest: float, smallest: float) -> Iterator[tuple[Contest, list[Run]]]:
    """Contestants with their best runs below an error; errors below the smallest count as this error."""
    for contest, runs in scene.runs.items():
        known = [run._replace(errors={AIM: max(run.errors[AIM], smallest)}) for run in runs]
        shown = [run for run in front(known, AIM) if run.errors[AIM] < largest]
        if shown:
            yield contest, shown


class Ratio(NamedTuple):
    """Cost of the run that `advise` picks, relative to the front, for an error."""

    error: float
    value: float
    note: str


def ratios(scene: Scene) -> list[Ratio]:
    """Ratios of a scene, the largest error first; empty if `advise` does not apply."""
    found = [
        Ratio(float(row.varied["relative error"]), row.value, row.note)
        for row in scene.rows
        if row.quantity.removeprefix(f"{scene.name}, ").startswith(RATIO) and row.value is not None
    ]
    return sorted({ratio.error: ratio for ratio in found}.values(), reverse=True)


def why_not_advised(scene: Scene) -> str:
    """Why `advise` has no pick in a scene."""
    return next(
        (row.note for row in scene.rows if row.varied.get("formulation") == ADVISE and row.quantity == "runs"), ""
    )
