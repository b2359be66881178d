"""The report's cost table: Pareto fronts, the cheapest run of each program, and scenes where flexlink is slower."""

import csv
import io
import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from flexlink.describe.spec import decode
from reports.figures.trade import trade_fronts, trade_models, trade_ratios
from reports.findings.trade import trade_prices
from reports.prices import BEYOND, LOOKS, OURS, Price, Run, front, prices, works
from reports.results import Results
from tests.support.words import reviewed
from validation.case import CASES, load_case
from validation.kinds import speed_models
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
        "case": "trade", "kind": "speed_trade", "quantity": "CPU time", "unit": "ms", "timed": True, "scene": "arm",
    }  # fmt: skip
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
    others = ({"case": "crane"}, {"case": "rules", "kind": "speed_rules"}, {"quantity": "evaluations"})
    results = study(tmp_path, *(time("MuJoCo", "Euler", 1e-4, 0.1, **other) for other in others))
    ((case, series),) = works(results)
    assert prices(results, case, series, "error", 1e-4) == {
        OURS: Price(3.0, "RK4"), "MuJoCo": Price(90.0, "Euler", BY_ORDER), "Pinocchio": Price(2.0, "Radau"),
    }  # fmt: skip
    assert prices(results, case, series, "error", 1e-2)["MuJoCo"] == Price(1.5, "Euler")
    assert OURS not in prices(results, case, series, "error", 1e-6)


def test_the_list_has_wins_losses_and_errors_that_flexlink_does_not_reach(tmp_path: Path) -> None:
    (finding,) = trade_prices(study(tmp_path))
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
    (picture,) = trade_fronts(study(tmp_path))
    assert picture.title == TITLE
    tip, bend = picture.figure.axes
    assert (tip.get_xlabel(), bend.get_xlabel()) == (f"{TIP} [1]", f"{DEFLECTION} [1]")
    lines = {line.get_label(): line.get_xdata().tolist() for line in tip.lines if line.get_linestyle() == "-"}
    assert lines == {OURS: [5e-5, 5e-3], "MuJoCo": [5e-3], "Pinocchio": [1e-5]}
    table = list(csv.DictReader(io.StringIO(picture.csv)))
    assert len(table) == len(RUNS)
    assert [line[ON_FRONT] for line in table] == ["yes", "", "yes", "yes", "yes"]


def test_times_relative_to_flexlink_are_drawn_and_listed_with_both_times(tmp_path: Path) -> None:
    coarse, fine = trade_ratios(study(tmp_path))
    heads = ("program", "its cheapest", "CPU time [ms]", "flexlink's cheapest", "CPU time of flexlink [ms]")
    lines = {picture.name: list(csv.DictReader(io.StringIO(picture.csv))) for picture in (coarse, fine)}
    assert [tuple(line[head] for head in heads) for line in (*lines[coarse.name], *lines[fine.name])] == [
        ("MuJoCo", "Euler", "1.5", "Radau5", "1.0"), ("Pinocchio", "Radau", "2.0", "RK4", "3.0"),
        ("MuJoCo", f"Euler ({BY_ORDER})", "90.0", "RK4", "3.0"),
    ]  # fmt: skip
    ratios = {"MuJoCo": 90 / 3, "Pinocchio": 2 / 3}
    assert {line["program"]: float(line["ratio [1]"]) for line in lines[fine.name]} == pytest.approx(ratios)
    (axes,) = fine.figure.axes
    points = {look.marker: line for line in axes.lines for look in LOOKS.values() if line.get_marker() == look.marker}
    drawn = {who: points[LOOKS[who].marker].get_xdata()[0] for who in ratios}
    assert drawn == pytest.approx(ratios)


CASE = load_case(CASES / "speed_models.toml")
GRID = {
    "change": {"name": "short", "run.duration": 0.1, "run.sample": 0.02, "material.aluminium.young": 70e7},
    "true": "z", "fine": {"method": "Radau5", "tolerances": [1e-7, 1e-6], "hinges": [8, 6]},
    "flex": ["rigid", "z"], "hinges": {"paper": [1, 4], "gauss": [2]},
    "tolerances": {"Radau5": [1e-1, 1e-4]}, "stepped": ["RK4"],
}  # fmt: skip


@pytest.fixture(scope="module")
def found():
    """Rows and series of the case for a run of 0.1 s."""
    grid, case = decode(GRID, speed_models.Grid), replace(CASE, scenes=("paper_fig5",))
    *rows, series = speed_models.speed_models(case, scene={"paper_fig5": grid}, errors=(1e-1, 1e-5), budget=5.0)
    return rows, series


@pytest.mark.slow
def test_every_combination_runs_once_and_a_rigid_arm_has_no_hinges(found):
    made = list(zip(*(found[1].columns[name].tolist() for name in ("type", "rule", "hinges", "method")), strict=True))
    cuts = [("rigid", "paper", 0), ("T1", "paper", 1), ("T1", "paper", 4), ("T1", "gauss", 2)]
    assert made == [(*cut, method) for cut in cuts for method in ("Radau5", "Radau5", "RK4")]


@pytest.mark.slow
def test_the_cheapest_run_that_meets_an_error_is_listed_with_its_model(found):
    rows, series = found
    known, *times = rows
    assert (known.quantity.split(" / ")[0], known.scene) == ("own error", "short")
    assert times, "at least one run meets the largest error"
    for each in times:
        met = series.columns["CPU time [s]"][series.columns["error"] <= each.varied["error"]]
        assert each.value == pytest.approx(1e3 * met.min())
        assert each.timed
    bending, rigid = (speed_models.Run(next(cut_of(flex)), 0.1, 1.0).in_words for flex in ("z", "rigid"))
    reviewed("models: setup", f"{bending}\n{rigid}")
    assert [part for part in re.split(r"[ ,()]+", bending) if part in {"T1", "1", "paper", "RK4", "0.001"}] == [
        "T1", "1", "paper", "RK4", "0.001",
    ]  # fmt: skip
    assert "hinge" not in rigid


def cut_of(flex: str):
    grid = decode(GRID, speed_models.Grid)
    return (replace(cut, method="RK4", step=1e-3) for cut in grid.cuts() if cut.flex == flex)


MODEL_RUNS = (
    ("rigid", "paper", 0, "RK4", 1e-2, 1e-1, 1e-4), ("T1", "gauss", 2, "Radau5", 1e-2, 1e-3, 1e-3),
    ("T1", "paper", 4, "Radau5", 1e-2, 1e-2, 5e-3), ("T3", "gauss", 4, "Radau5", 1e-4, 1e-6, 1e-1),
)  # fmt: skip


def test_the_pareto_front_names_type_hinges_and_rule_and_the_csv_has_every_run(tmp_path: Path) -> None:
    results = stored(tmp_path, row("models", kind="speed_models"))
    series = Series("models", "arm: which", table(speed_models.COLUMNS, MODEL_RUNS), "error", "error", "t", scene="arm")
    Store(results).add_series("models", series)
    (picture,) = trade_models(Results.read(results))
    (axes,) = picture.figure.axes
    assert [text.get_text() for text in axes.texts] == ["T3, 4 gauss", "T1, 2 gauss", "rigid"]
    assert [line.get_label() for line in axes.lines if line.get_linestyle() == "None"] == ["rigid", "T1", "T3"]
    assert len(picture.csv.splitlines()) == len(MODEL_RUNS) + 1
