"""Parts of errors, stable steps, measurements, and CPU times."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import median

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.curves import curves, panels_of
from reports.findings import finding
from reports.measurements import WHAT
from reports.results import Results
from reports.wording import displayed
from validation.store import Row, Series

PARTS = {
    "model": "the link type", "space": "the number of hinges and the rule", "time": "the method and the step",
    "rounding": "rounding",
}  # fmt: skip
MM = 1e3  # millimetres per metre
LITTLE = 0.01  # fraction of the error below which a part is not worth reducing


@finding("errors")
def errors_split(results: Results) -> Iterator[Table]:
    """Parts of the error of each run, and which part is worth reducing: one table over all scenes.

    One table, if the study has split any error into parts.
    """
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
        f"Of {plural(len(runs), 'run')}, the largest part of the error comes "
        + ", ".join(f"from {PARTS[part]} in {count}" for part, count in first)
        + "."
    )
    idle = sum(errors["time"] < LITTLE * errors["total"] for errors in runs)
    yield f"In {idle} of these runs, smaller steps would reduce the error by less than {100 * LITTLE:.0f} %."
    worst = max(errors["rounding"] / errors["total"] for errors in runs)
    yield f"Rounding causes at most {number(100 * worst, 2)} % of the error of a run."


KIND, QUANTITY = "stable_steps", "observed / predicted − 1"
CLOSE = 1e-3  # relative difference up to which two steps are equal in practice


@finding("extremes", "stable steps")
def stable_steps(results: Results) -> Iterator[Table]:
    """Largest stable steps: difference between observation and prediction, per method.

    One table per case.
    """
    for case, rows in results.of_kind(KIND):
        found: dict[str, list[Row]] = {}
        for row in rows:
            if row.quantity == QUANTITY and row.value is not None:
                found.setdefault(str(row.varied["method"]), []).append(row)
        if found:
            heads = ("method", "scenes", "median difference [1]", "largest difference [1]", "scene with the largest")
            lines = tuple(_steps_line(method, of) for method, of in found.items())
            title = "Largest stable step: runs compared with the prediction from the modes"
            sentence = _steps_sentence([row for of in found.values() for row in of])
            yield Table(f"{case}.methods", title, heads, lines, (sentence,))


def _steps_line(method: str, rows: list[Row]) -> tuple[str, int, float, float, str]:
    worst = max(rows, key=_off)
    return method, len(rows), median(map(_off, rows)), _off(worst), worst.scene


def _off(row: Row) -> float:
    return row.value or 0.0


def _steps_sentence(rows: list[Row]) -> str:
    worst, close = max(rows, key=_off), sum(_off(row) <= CLOSE for row in rows)
    most = f"{number(100 * _off(worst))} % ({worst.where})"
    found = f"{close} of {plural(len(rows), 'largest stable step')}, found by bisection, are within"
    return f"{found} {number(100 * CLOSE)} % of the prediction; the largest difference is {most}."


HELD_OUT = "held out"
COLUMNS = (
    "quantity", "unit", "S", "D", "E", "u_num", "GCI", "order", "u_input", "u_D", "u_val", "verdict", "held out S",
    "held out u_val", "held out verdict",
)  # fmt: skip
HEADS = {"GCI": "grid convergence index", "order": "observed order", "S": "S, simulated", "D": "D, measured"}
FIT = (
    "The fit is 100 (1 − |measured − model| / |measured|). It is 100 for a perfect model, and 0 for a model that is no "
    "better than a zero signal. psf, fsf, lqr, hinf and lqg are names of recordings."
)


@finding("measured", HELD_OUT)
def measured(results: Results) -> Iterator[Table]:
    """Measured quantities: error, validation uncertainty with its parts, and verdict; fits to held-out recordings.

    For each case, a table of fits to held-out recordings; then for each case, a table of quantities.
    """
    for case, series in results.showing(HELD_OUT):
        fits = tuple(zip(*(column.tolist() for column in series.columns.values()), strict=True))
        title = f"{results.cases[case][0].title}: fit [%]"
        yield Table(f"{case}.held_out", title, tuple(series.columns), fits, (FIT,), opened=True)
    heads = tuple(HEADS.get(name, name) for name in COLUMNS)
    for case, series in results.showing(WHAT):
        columns = ([_shown(each) for each in series.columns[name].tolist()] for name in COLUMNS)
        lines = tuple(zip(*columns, strict=True))
        title = results.cases[case][0].title
        yield Table(f"{case}.quantities", f"{title}: all quantities", heads, lines, (), to_look_up=True)


def _shown(value: str | float) -> str | float | None:
    """A verdict as displayed; nothing for a quantity that was not held out."""
    return displayed(value) if isinstance(value, str) else None if math.isnan(value) else value


ORDER = ("native", "public", "pinocchio", "pinocchio, fastest", "mujoco")


@finding("speed")
def speed_times(results: Results) -> Iterator[Table]:
    """Table of CPU times against n for flexlink and every engine.

    One table per job.
    """
    for case, series in results.showing("cost"):
        times: dict[tuple[str, float], dict[str, float]] = {}
        for family, part in panels_of(series):
            for curve in curves(part):
                for n, time in zip(curve.x, curve.y, strict=True):
                    times.setdefault((family, float(n)), {})[curve.label] = float(time)
        engines = [engine for engine in ORDER if any(engine in row for row in times.values())]
        lines = tuple((family, n, *(row.get(engine) for engine in engines)) for (family, n), row in times.items())
        sentence = (
            "native: flexlink in a compiled loop; public: a call of flexlink from Python, which checks its arguments. "
            "Engines are called from Python."
        )
        heads = ("chain", "n", *(f"{engine} [µs]" for engine in engines))
        yield Table(f"{case}.{series.name}.times", series.title, heads, lines, (sentence,), to_look_up=True)
