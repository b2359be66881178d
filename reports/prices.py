"""CPU time for a given error, by program: runs, Pareto fronts and costs from the series and rows of `speed_trade`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from flexlink.pages.colours import ENGINES
from reports.results import Results
from validation.store import Row, Series

KIND = "speed_trade"
OURS = "flexlink"
LOOKS = {
    (name if name == "solvers" else look.name): look for name, look in ENGINES.items() if name != "mpmath"
}  # fmt: skip
"""Program, as named in rows and in names of methods → colour and marker in figures."""
AIMS = {"error": "tip", "deflection error": "deflection"}
"""Kind of error, as named in rows and series → the quantity that has this error."""
COST = "CPU time"
BEYOND = {"Beyond": "by its order", "At its": "at its limit"}
"""Beginning of the note of an extrapolated time → remark."""


class Run(NamedTuple):
    """A run: program, method, step [s] or tolerance, CPU time [s], evaluations, and relative error by kind."""

    who: str
    method: str
    setting: float
    seconds: float
    evaluations: float
    errors: dict[str, float]


class Price(NamedTuple):
    """CPU time [ms] for an error, and the method; `remark` marks times of other programs that are not measured."""

    time: float
    method: str
    remark: str = ""

    @property
    def by(self) -> str:
        """The method with the remark."""
        return f"{self.method} ({self.remark})" if self.remark else self.method


def works(results: Results) -> Iterator[tuple[str, Series]]:
    """(case, series of its runs by method); each scene appears once, from the case with the most runs."""
    found: dict[str, tuple[str, Series]] = {}
    for case, series in (each for each in results.showing("work") if "method" in each[1].columns):
        if series.scene not in found or _length(series) > _length(found[series.scene][1]):
            found[series.scene] = case, series
    yield from found.values()


def _length(series: Series) -> int:
    return len(series.columns[series.x])


def runs(series: Series) -> list[Run]:
    """All runs of a scene."""
    columns = (series.columns[name].tolist() for name in ("method", "setting", "CPU time [s]", "evaluations", *AIMS))
    return [
        Run(*_split(label), setting, seconds, evaluations, dict(zip(AIMS, of, strict=True)))
        for label, setting, seconds, evaluations, *of in zip(*columns, strict=True)
    ]


def _split(label: str) -> tuple[str, str]:
    """Program and method; names of flexlink's methods have no program."""
    who, _, method = label.partition(" ")
    return (who, method) if who in LOOKS else (OURS, label.removesuffix(" at its limit"))


def front(many: Sequence[Run], aim: str) -> list[Run]:
    """Pareto front, the most accurate run first: the runs than which no other run is both cheaper and more accurate."""
    best: list[Run] = []
    for run in sorted(many, key=lambda run: (run.errors[aim], run.seconds)):
        if not best or run.seconds < best[-1].seconds:
            best.append(run)
    return best


def named(best: Sequence[Run], aim: str, apart: float) -> Iterator[Run]:
    """Runs of a front to label: the first of each method, if its error exceeds `apart` times the last label's error."""
    last, known = None, set[tuple[str, str]]()
    for run in best:
        if (last is None or run.errors[aim] > apart * last.errors[aim]) and run[:2] not in known:
            last = run
            known.add(run[:2])
            yield run


def errors(results: Results, aim: str) -> list[float]:
    """Target errors of the study, the largest first."""
    return sorted({float(row.varied[aim]) for row in _times(results, aim)}, reverse=True)


def prices(results: Results, case: str, series: Series, aim: str, error: float) -> dict[str, Price]:
    """Program → its cheapest run with the target error: measured for flexlink, the study's estimate for others."""
    met = [run for run in runs(series) if run.who == OURS and run.errors[aim] <= error]
    found = {}
    if met:
        best = min(met, key=lambda run: run.seconds)
        found[OURS] = Price(1e3 * best.seconds, best.method)
    rows = [row for row in _times(results, aim) if row.case == case and row.varied[aim] == error]
    for who in LOOKS:
        times = [_price(row) for row in rows if row.engine == who and row.value]
        if times:
            found[who] = min(times)
    return found


def _times(results: Results, aim: str) -> Iterator[Row]:
    return (row for _, rows in results.of_kind(KIND) for row in rows if row.quantity == COST and aim in row.varied)


def _price(row: Row) -> Price:
    remark = next((word for begin, word in BEYOND.items() if row.note.startswith(begin)), "")
    return Price(row.value or 0.0, str(row.varied["method"]), remark)
