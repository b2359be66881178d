"""The report's cost table: Pareto fronts, the cheapest run of each program, and scenes where flexlink is slower."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from reports.figures import trade_fronts
from reports.findings import trade_prices
from reports.prices import BEYOND, OURS, Price, Run, front, prices, works
from reports.results import Results
from tests.support.words import reviewed
from validation.store import Row, Series, Store, table
from validation.tests.studies import row, stored

TITLE = "arm: it moves"
TIP, DEFLECTION = "error of the tip", "error of the deflection"
RATIO, ON_FRONT = "cheapest other / flexlink", "on its front, tip"
BY_ORDER = BEYOND["Beyond"]
RUNS = (  # program and method, setting, tip error, seconds, deflection error, evaluations
    ("Radau5", 1e-2, 5e-3, 1e-3, 5e-2, 100),
    ("Radau5", 1e-3, 5e-5, 4e-3, 5e-4, 400),
    ("RK4 at its limit", 1e-4, 5e-5, 3e-3, 5e-4, 900),
    ("MuJoCo Euler", 1e-3, 5e-3, 2e-3, 5e-3, 50),
    ("Pinocchio Radau", 1e-2, 1e-5, 2e-3, 1e-4, 60),
)
COLUMNS = ("method", "setting", "error", "CPU time [s]", "deflection error", "evaluations")


def time(engine: str, method: str, error: float, value: float, **fields: object) -> Row:
    varied = {"method": method, "error": error}
    named = {
        "case": "trade",
        "kind": "speed_trade",
        "quantity": "CPU time",
        "unit": "ms",
        "timed": True,
        "scene": "arm",
    }
    return row(value=value, tolerance=None, engine=engine, varied=varied, **named | fields)


ROWS = (
    time("native", "Radau5", 1e-2, 1.0), time("native", "Radau5", 1e-4, 4.0),
    time("MuJoCo", "Euler", 1e-2, 1.5), time("MuJoCo", "implicit", 1e-2, 7.0),
    time("MuJoCo", "Euler", 1e-4, 90.0, note="Beyond its smallest measured error, by its order."),
    time("Pinocchio", "Radau", 1e-4, 2.0), time("Pinocchio", "Radau", 1e-6, 8.0),
)  # fmt: skip


def study(tmp_path: Path, *more: Row) -> Results:
    folder = stored(tmp_path / "results", *ROWS, *more)
    series = Series("work", TITLE, table(COLUMNS, RUNS), "error", "error", "CPU time [s]", scene="arm")
    Store(folder).add_series("trade", series)
    return Results.read(folder)


def run(error: float, seconds: float) -> Run:
    return Run(OURS, "RK4", 0.0, seconds, 1, {"error": error})


def test_a_pareto_front_contains_the_runs_not_dominated_in_error_and_time() -> None:
    best = [run(1e-8, 5.0), run(1e-5, 2.0), run(1e-2, 1.0)]
    beaten = [run(1e-5, 3.0), run(1e-4, 2.0), run(1e-1, 1.5)]
    assert front([*beaten, *best], "error") == best


def test_the_cost_is_the_cheapest_run_of_flexlink_and_the_study_estimate_for_others(tmp_path: Path) -> None:
    results = study(tmp_path)
    ((case, series),) = works(results)
    assert prices(results, case, series, "error", 1e-4) == {
        OURS: Price(3.0, "RK4"), "MuJoCo": Price(90.0, "Euler", BY_ORDER), "Pinocchio": Price(2.0, "Radau"),
    }  # fmt: skip
    assert prices(results, case, series, "error", 1e-2)["MuJoCo"] == Price(1.5, "Euler")
    assert OURS not in prices(results, case, series, "error", 1e-6)


def test_the_list_has_wins_losses_and_errors_that_flexlink_does_not_reach(tmp_path: Path) -> None:
    (finding,) = trade_prices.find(study(tmp_path))
    parts = {"wins": ("1 of 2",), "losses": ("arm", "10⁻⁴", "0.67 ×"), "out of reach": ("arm", "10⁻⁶")}
    for what, each in parts.items():
        (text,) = (text for text in finding.sentences if all(part in text for part in each))
        reviewed(f"prices: {what}", text)
    lines = [dict(zip(finding.heads, line, strict=True)) for line in finding.lines]
    assert [line[TIP] for line in lines] == [1e-2, 1e-4, 1e-6]
    assert [line[RATIO] for line in lines] == [1.5, pytest.approx(2 / 3), None]
    assert (lines[1]["MuJoCo [ms]"], lines[1]["MuJoCo: method"]) == (90.0, f"Euler ({BY_ORDER})")
    assert lines[0]["Pinocchio [ms]"] is None


def test_every_scene_has_two_fronts_and_all_runs_in_the_csv(tmp_path: Path) -> None:
    (picture,) = trade_fronts.draw(study(tmp_path))
    assert picture.title == TITLE
    tip, bend = picture.figure.axes
    assert (tip.get_xlabel(), bend.get_xlabel()) == (f"{TIP} [1]", f"{DEFLECTION} [1]")
    lines = {line.get_label(): line.get_xdata().tolist() for line in tip.lines if line.get_linestyle() == "-"}
    assert lines == {OURS: [5e-5, 5e-3], "MuJoCo": [5e-3], "Pinocchio": [1e-5]}
    table = list(csv.DictReader(io.StringIO(picture.csv)))
    assert len(table) == len(RUNS)
    assert [line[ON_FRONT] for line in table] == ["yes", "", "yes", "yes", "yes"]
