"""All combinations of model and method are compared with the flexible arm; the cheapest for each error is listed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from msgspec.structs import replace

from flexlink.describe.spec import decode
from reports.figures import trade_models
from reports.results import Results
from tests.support.words import reviewed
from validation.case import CASES, load_case
from validation.kinds import speed_models
from validation.store import Series, Store, table
from validation.tests.studies import row, stored

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
    *rows, series = speed_models.run(case, scene={"paper_fig5": grid}, errors=(1e-1, 1e-5), budget=5.0)
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


RUNS = (
    ("rigid", "paper", 0, "RK4", 1e-2, 1e-1, 1e-4), ("T1", "gauss", 2, "Radau5", 1e-2, 1e-3, 1e-3),
    ("T1", "paper", 4, "Radau5", 1e-2, 1e-2, 5e-3), ("T3", "gauss", 4, "Radau5", 1e-4, 1e-6, 1e-1),
)  # fmt: skip


def test_the_pareto_front_names_type_hinges_and_rule_and_the_csv_has_every_run(tmp_path: Path) -> None:
    results = stored(tmp_path, row("models", kind="speed_models"))
    series = Series("models", "arm: which", table(speed_models.COLUMNS, RUNS), "error", "error", "t", scene="arm")
    Store(results).add_series("models", series)
    (picture,) = trade_models.draw(Results.read(results))
    (axes,) = picture.figure.axes
    assert [text.get_text() for text in axes.texts] == ["T3, 4 gauss", "T1, 2 gauss", "rigid"]
    assert [line.get_label() for line in axes.lines if line.get_linestyle() == "None"] == ["rigid", "T1", "T3"]
    assert len(picture.csv.splitlines()) == len(RUNS) + 1
