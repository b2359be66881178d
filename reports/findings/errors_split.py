"""Parts of the error of each run, and which part is worth reducing: one table over all scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results
from validation.store import Series

SECTION = "errors"
PARTS = {
    "model": "link type",
    "space": "number of hinges and rule",
    "time": "method and step",
    "rounding": "rounding",
}
MM = 1e3  # millimetres per metre
LITTLE = 0.01  # fraction of the error below which a part is not worth reducing


def find(results: Results) -> Iterator[Table]:
    """One table, if the study has split any error into parts."""
    runs = [run for _, series in results.showing("errors") for run in _runs(series)]
    if runs:
        lines = tuple(_line(name, errors) for name, errors in runs)
        heads = ("run", *(f"{part} [mm]" for part in PARTS), "error [mm]", "largest part")
        sentences = tuple(_sentences([errors for _, errors in runs]))
        yield Table("errors_split.where", "Where the error of a run comes from", heads, lines, sentences)


def _runs(series: Series) -> Iterator[tuple[str, Mapping[str, float]]]:
    for k, run in enumerate(series.columns["run"].tolist()):
        yield f"{series.scene}: {run}", {name: float(series.columns[name][k]) for name in (*PARTS, "total")}


def _line(name: str, errors: Mapping[str, float]) -> tuple[str | None, ...]:
    shown = (number(MM * errors[part], 2) if errors[part] else None for part in (*PARTS, "total"))
    return name, *shown, _most(errors)


def _most(errors: Mapping[str, float]) -> str:
    return max(PARTS, key=lambda part: errors[part])


def _sentences(runs: Sequence[Mapping[str, float]]) -> Iterator[str]:
    first = Counter(map(_most, runs)).most_common()
    yield (
        f"Largest part of the error in {plural(len(runs), 'run')}: "
        + "; ".join(f"{PARTS[part]} in {count}" for part, count in first)
        + "."
    )
    idle = sum(errors["time"] < LITTLE * errors["total"] for errors in runs)
    yield f"In {idle} of them, smaller steps would reduce the error by less than {100 * LITTLE:.0f} %."
    worst = max(errors["rounding"] / errors["total"] for errors in runs)
    yield f"Rounding is at most {number(worst, 2)} of the error of a run."
