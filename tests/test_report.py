"""`flexlink report`: a page about a user's own scene that stands alone, and says what it could not compute."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest
from browser import CHROMIUM, DRIVER, Browser, axe, browser
from conftest import ROOT
from test_page import CUT_WORDS, DESK, OFF_SCREEN, PHONE, UNFOLD, VIOLATIONS

import flexlink as fl
from flexlink.cli.main import main
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Report
from flexlink.scene_report import building
from flexlink.scene_report.parts import accuracy, statics
from flexlink.scene_report.report import report
from flexlink.scene_report.study import Study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "ptp_move.toml").varied({"run.duration": 2.0})


@pytest.fixture(scope="module")
def written(scene: fl.Scene, tmp_path_factory: pytest.TempPathFactory) -> Report:
    return report(scene, tmp_path_factory.mktemp("report"))


def chapters(*names: str) -> dict[str, tuple[str, str]]:
    return {name: building.CHAPTERS[name] for name in names}


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    with browser() as found:
        yield found


class Links(HTMLParser):
    """What a page loads, and where it leads."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.ids: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.targets += [value or "" for name, value in attrs if name in ("src", "href")]
        self.ids |= {value or "" for name, value in attrs if name == "id"}


def lines(written: Report, name: str) -> list[dict[str, str]]:
    with (written.page.parent / name).open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_page_stands_alone_and_leads_only_to_what_is_there(written: Report) -> None:
    links = Links(written.page.read_text(encoding="utf-8"))
    inside = {target[1:] for target in links.targets if target.startswith("#")}
    assert inside <= links.ids
    beside = [target for target in links.targets if not target.startswith("#")]
    assert beside
    assert [target for target in beside if not (written.page.parent / target).is_file()] == []


def test_every_chapter_of_a_driven_arm_is_there(written: Report) -> None:
    assert written.failures == ()
    chapters = {"model", "motion", "agreement", "energy", "accuracy", "statics", "vibration", "settling", "loads"}
    assert chapters <= Links(written.page.read_text(encoding="utf-8")).ids


def test_the_model_that_was_chosen_stands_first_of_the_choices_and_finer_ones_are_better(written: Report) -> None:
    choices = {line["choice"]: line for line in lines(written, "choices.csv")}
    assert next(iter(choices)) == "this scene"
    error = {name: float(line["tip error [m]"]) for name, line in choices.items() if line["tip error [m]"]}
    assert error["4 times the hinges"] < error["twice the hinges"] < error["this scene"] < error["rigid links"]


def test_what_cannot_be_computed_is_a_sentence_and_the_rest_is_there(
    scene: fl.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def falls(_: object) -> None:
        raise RuntimeError("out of\nluck")

    monkeypatch.setattr(statics, "made", falls)
    monkeypatch.setattr(building, "CHAPTERS", chapters("model", "motion", "energy", "statics", "reproduce"))
    found = report(scene.varied({"run.step": 5e-3}), tmp_path)  # beyond the largest stable one
    assert [failure.partition(": ")[0] for failure in found.failures] == [
        title for title, _ in chapters("energy", "statics").values()
    ]
    assert [(verdict.about, verdict.state) for verdict in found.verdicts] == [("Run", "fail")]
    assert not found.passed
    text = found.page.read_text(encoding="utf-8")
    assert "RuntimeError: out of luck" in text
    assert "largest stable" in text
    assert (tmp_path / "springs.csv").is_file()


def test_where_the_motion_multiplies_errors_the_error_is_not_told_but_how_long_it_could_be(models: Path) -> None:
    falling = fl.load_scene(models / "three_links.toml")
    part = accuracy.made(Study(falling))
    assert part is not None
    assert next((verdict.about, verdict.state) for verdict in part.verdicts) == ("Model error", "doubt")
    until = re.search(r"Up to (\S+) s the two finest models differ by less than 1 %", part.sentences[0])
    assert until is not None
    assert 0.0 < float(until[1]) < falling.run.duration


def test_an_arm_that_does_not_bend_has_its_joints_held_and_its_steps_judged(models: Path) -> None:
    scene = fl.load_scene(models / "paper_fig5.toml").varied({"run.duration": 0.1})
    rigid = Study(fl.rigidified(scene))
    held = statics.made(rigid).tables[0].lines
    q, _ = fl.initial_state(rigid.scene, rigid.chain)
    assert [line[2] for line in held] == pytest.approx(fl.gravity_torque(rigid.chain, q).tolist(), rel=1e-12)
    assert (found := accuracy.made(rigid)) is not None
    assert "Tip error from steps" in found.verdicts[0].text


def test_the_command_writes_the_page_and_a_line_a_chapter(models: Path, tmp_path: Path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(building, "CHAPTERS", chapters("model", "accuracy"))
    out = tmp_path / "a" / "b"
    fast = ["--set", "run.duration=0.05"]
    assert main(["report", str(models / "paper_fig5.toml"), "--out", str(out), *fast]) == 0
    told = capsys.readouterr()
    assert str(out / "index.html") in told.out
    assert "Model error" in told.out
    assert "Model: done" in told.err


def test_a_file_that_is_not_there_or_of_no_known_kind_is_refused_before_the_work(models: Path, tmp_path: Path) -> None:
    scene = fl.load_scene(models / "paper_fig5.toml")
    for name, reason in (("theirs.xml", "no such file"), ("theirs.docx", "expected .urdf")):
        with pytest.raises(fl.errors.ArgumentError, match=reason):
            fl.report(scene, tmp_path / "out", against=tmp_path / name)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("package", ["matplotlib", "jinja2"])
def test_a_missing_package_is_named_with_what_installs_it(models: Path, tmp_path: Path, package: str) -> None:
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from flexlink.cli.main import main\n"
        f"sys.exit(main(['report', {str(models / 'paper_fig5.toml')!r}, '--out', {str(tmp_path / 'out')!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "pip install 'flexlink[report]'" in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
class TestInABrowser:
    @pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
    @pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
    def test_nothing_is_cut_and_nobody_shut_out(
        self, window: Browser, written: Report, size: tuple[int, int], dark: bool
    ) -> None:
        window.open(written.page, *size, dark)
        window.run(UNFOLD)
        assert window.run(OFF_SCREEN) == []
        assert window.run(CUT_WORDS) == []
        if script := axe():
            window.run(script.read_text(encoding="utf-8"))
            assert window.run_async(VIOLATIONS) == []

    @pytest.mark.parametrize("width", [600, 800, 1050, 1150])
    def test_a_table_wider_than_the_window_scrolls_by_itself(
        self, window: Browser, written: Report, width: int
    ) -> None:
        window.open(written.page, width, 800)
        window.run(UNFOLD)
        whole, seen = window.run("const d = document.documentElement; return [d.scrollWidth, d.clientWidth]")
        assert whole <= seen


def test_a_column_is_of_numbers_where_nothing_else_stands() -> None:
    table = Table("name", "Title", ("text", "number", "mixed"), (("a", 1.0, None), ("b", None, "none")))
    assert table.numeric == {"number"}
    assert table.csv == "text,number,mixed\na,1.0,\nb,,none\n"


def test_a_mistake_in_another_file_stands_on_the_first_screen(
    scene: fl.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setattr(building, "CHAPTERS", chapters("theirs", "measurements"))
    for name, gravity, state in (("right.xml", -9.81, "pass"), ("wrong.xml", 9.81, "fail")):
        theirs = tmp_path / name
        theirs.write_text(fl.to_mjcf(fl.lump(scene.varied({"gravity": (0.0, 0.0, gravity)}))), encoding="utf-8")
        found = report(scene, tmp_path / "out", against=theirs)
        assert [verdict.state for verdict in found.verdicts] == [state]
        assert found.passed is (state == "pass")
    assert "gravity has the wrong sign" in found.verdicts[0].text
