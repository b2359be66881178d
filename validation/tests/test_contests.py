"""The trade on one page: panels, overview, sentences about advise; the picture of README and of the site's page."""

from pathlib import Path

import pytest

from docs.generators import readme
from docs.generators import study as generated
from reports.contests import CONTESTS, ratios, scenes
from reports.figures import trade
from reports.findings.trade import trade_advice
from reports.results import Results
from tests.support.words import reviewed
from validation.formulations.ladder import FORMULATIONS
from validation.kinds.formulations import COLUMNS
from validation.store import Series, Store, table
from validation.tests.studies import row, stored

RUNS = (
    ("chain, gauss", "h 1", 9, 1e-2, 1e-3), ("chain, gauss", "h 2", 9, 1e-4, 4e-3),
    ("chain, gauss", "h 3", 9, 2e-2, 2e-3), ("MuJoCo chain, RK4", "h 1", 9, 1e-9, 1.0),
    ("advise", "tip 0.001", 7, 5e-4, 3e-3),
)  # fmt: skip
OF = {"kind": "formulations", "tolerance": None}


def study(tmp_path: Path, names: tuple[str, ...] = ("crane", "roll_up"), second: float = 2.0) -> Results:
    """A stored study of two scenes, of which the second has no advice."""
    one, two = names
    asked = ({"relative error": 1e-2}, {"relative error": 1e-3})
    ours, why = {"formulation": "chain, gauss"}, {"formulation": "advise"}
    rows = [
        row("all", scene=one, quantity="advise / front, error 0.01", value=0.5, varied=asked[0], note="pick", **OF),
        row("all", scene=one, quantity=f"{one}, advise / front, error 0.001", value=second, varied=asked[1], **OF),
        row("all", scene=two, quantity="runs", value=3, varied=ours, **OF),
        row("all", scene=two, quantity="runs", value=0, varied=why, note="Not for equilibria.", **OF),
    ]
    results = stored(tmp_path, *rows)
    for name in names:
        runs = RUNS if name == one else RUNS[:-1]
        columns = table(COLUMNS, runs)
        Store(results).add_series("all", Series("formulations", name, columns, "error", "e", "t", scene=name))
    return Results.read(results)


def test_every_formulation_has_a_contestant() -> None:
    for name in FORMULATIONS.keys() - {"advise"}:
        assert sum(name.startswith(each.starts) for each in CONTESTS) == 1, name


def test_every_scene_has_a_panel_with_fronts_and_picks(tmp_path: Path) -> None:
    page, overview = trade.trade_page(study(tmp_path))
    first, second, *_ = page.figure.axes
    assert [first.get_title(loc="left"), second.get_title(loc="left")] == ["crane", "roll up"]
    lines = {(line.get_marker(), line.get_linewidth()): line.get_xydata().tolist() for line in first.lines}
    assert lines["o", 2.6] == [[1e-4, 4.0], [1e-2, 1.0]], "thick; without the run that is worse in both"
    assert lines["D", 1.0] == [[trade.SMALLEST, 1000.0]], "errors of rounding are drawn at the edge"
    assert [line.get_xydata().tolist() for line in first.lines if line.get_marker() == "*"] == [[[5e-4, 3.0]]]
    (axes,) = overview.figure.axes
    places = {line.get_marker(): line.get_xydata().tolist() for line in axes.lines if line.get_ydata()[0] == 0}
    assert places["o"] == [[4.0, 0]], "the cheapest run with an error of 0.001"
    assert places["*"] == [[3.0, 0]]
    assert len(overview.csv.splitlines()) == 1 + len(RUNS) + len(RUNS) - 1


def test_one_scene_has_no_page(tmp_path: Path) -> None:
    results = study(tmp_path)
    assert list(trade.trade_page(Results(**{**vars(results), "rows": results.rows[:2]}))) == []


def test_costs_of_advice_are_stated_with_the_scenes_above_the_limit_and_without_advice(tmp_path: Path) -> None:
    results = study(tmp_path)
    (made,) = trade_advice(results)
    reviewed("advice: costs", " ".join(made.sentences))
    assert made.lines == (("crane", 1e-2, 0.5, "pick"), ("crane", 1e-3, 2.0, ""))
    assert [each.value for each in ratios(scenes(results)[0])] == [0.5, 2.0]


@pytest.mark.parametrize("ratio, within", [(1.3, "1 of 2"), (1.31, "0 of 2")])
def test_a_scene_is_within_the_limit_if_all_its_errors_are(tmp_path: Path, ratio: float, within: str) -> None:
    (made,) = trade_advice(study(tmp_path, second=ratio))
    assert within in made.sentences[1]


def test_the_readme_shows_the_first_picture_that_is_stored(tmp_path: Path) -> None:
    new, old = (name for name, *_ in readme.PICTURES)
    (tmp_path / f"{old}.png").touch()
    text = readme.README.read_text(encoding="utf-8")
    before = readme.with_picture(text, tmp_path)
    assert f"{old}.png" in before
    assert f"{new}.png" not in before
    (tmp_path / f"{new}.png").touch()
    after = readme.with_picture(before, tmp_path)
    assert f"{old}.png" not in after
    assert f"{new}.png" in after
    assert len(after.splitlines()) == len(before.splitlines())


def test_the_page_of_the_trade_states_what_is_not_stored_yet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generated, "FULL", tmp_path)
    monkeypatch.setattr(generated, "stored", lambda: {"chapters": [{"findings": []}]})
    assert "not contain" in generated.picture("trade_page", "about")
    assert "not contain" in " ".join(generated.finding("trade_advice"))
    shown = tmp_path / "trade_page.png"
    shown.touch()
    found = {"name": "trade_advice", "sentences": ["It costs 1."]}
    monkeypatch.setattr(generated, "stored", lambda: {"chapters": [{"findings": [found]}]})
    assert shown.name in generated.picture(shown.stem, "about")
    assert generated.finding("trade_advice") == ["It costs 1."]
