"""`flexlink report`: a self-contained page about a user's scene, which states what it could not compute."""

import csv
import re
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path

import pytest

import flexlink as fl
from flexlink.cli.main import main
from flexlink.pages.tables import Table
from flexlink.pages.verdict import Report
from flexlink.scene_report import building
from flexlink.scene_report.parts import accuracy, statics
from flexlink.scene_report.report import report
from flexlink.scene_report.study import Study
from tests.conftest import ROOT
from tests.support.browser import CHROMIUM, DRIVER, Browser, axe, browser
from tests.support.words import line, refused, refused_line, reviewed, sentence
from validation.tests.test_page import CUT_WORDS, DESK, OFF_SCREEN, PHONE, UNFOLD, VIOLATIONS

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def scene() -> fl.Scene:
    return fl.load_scene(ROOT / "models" / "ptp_move.toml").varied({"run.duration": 1.0})


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
    """Files that a page loads, and links within the page."""

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


def test_the_page_is_self_contained_and_links_only_to_existing_targets(written: Report) -> None:
    links = Links(written.page.read_text(encoding="utf-8"))
    inside = {target[1:] for target in links.targets if target.startswith("#")}
    assert inside <= links.ids
    others = [target for target in links.targets if not target.startswith("#")]
    assert others
    assert [target for target in others if not (written.page.parent / target).is_file()] == []


def test_every_chapter_of_a_driven_arm_is_there(written: Report) -> None:
    assert written.failures == ()
    chapters = {"model", "motion", "agreement", "energy", "accuracy", "statics", "vibration", "settling", "loads"}
    assert chapters <= Links(written.page.read_text(encoding="utf-8")).ids


def test_the_chosen_model_is_the_first_of_the_choices_and_finer_ones_are_better(written: Report) -> None:
    own, *others = lines(written, "choices.csv")
    reviewed("report: choices", "\n".join(each["choice"] for each in (own, *others)))
    number, error = "degrees of freedom", "tip error [m]"
    errors = {int(each[number]): float(each[error]) for each in others if each[number] != own[number]}
    *coarse, finer, finest = sorted(errors)
    assert coarse[-1] < int(own[number]) < finer
    assert errors[finest] < errors[finer] < float(own[error]) < errors[coarse[0]]


def test_an_error_in_one_chapter_is_reported_and_the_others_are_complete(scene, tmp_path, monkeypatch) -> None:
    parts = "out of", "luck"

    def falls(_: object) -> None:
        raise RuntimeError("\n".join(parts))

    monkeypatch.setattr(statics, "made", falls)
    monkeypatch.setattr(building, "CHAPTERS", chapters("model", "motion", "energy", "statics", "reproduce"))
    found = report(scene.varied({"run.step": 5e-3}), tmp_path)  # beyond the largest stable step
    assert [failure.partition(": ")[0] for failure in found.failures] == [
        title for title, _ in chapters("energy", "statics").values()
    ]
    assert [(verdict.about, verdict.state) for verdict in found.verdicts] == [("Run", "fail")]
    assert not found.passed
    text = found.page.read_text(encoding="utf-8")
    assert "RuntimeError" in text
    assert " ".join(parts) in text
    for failure in found.failures:
        reviewed("report: chapter that failed", failure, values=False)
    refusal = found.verdicts[0].text
    reviewed("report: run that was refused", refusal)
    assert "run.step = 0.005 s" in refusal
    assert text.count("run.step = 0.005 s") == 2  # on the first screen and in its chapter
    assert (tmp_path / "springs.csv").is_file()


def test_the_report_gives_the_time_up_to_which_amplified_errors_are_known(models: Path) -> None:
    falling = fl.load_scene(models / "three_links.toml")
    part = accuracy.made(Study(falling))
    assert part is not None
    assert next((verdict.about, verdict.state) for verdict in part.verdicts) == ("Model error", "doubt")
    first = part.sentences[0]
    reviewed("report: error that grows", first, values=False)
    until = re.search(r" ([\d.]+) s\b.*\b1 %", first)
    assert until is not None
    assert 0.0 < float(until[1]) < falling.run.duration


def test_the_command_writes_the_page_and_one_line_per_chapter(models, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.setattr(building, "CHAPTERS", chapters("model", "accuracy"))
    out = tmp_path / "a" / "b"
    command = ["report", str(models / "paper_fig5.toml"), "--out", str(out), "--set", "run.duration=0.05"]
    assert main(command) == 0
    printed = capsys.readouterr()
    assert line(printed.out, str(out / "index.html"))
    for title, _ in chapters("model", "accuracy").values():
        assert line(printed.err, f"{title}: ")
    reviewed("report: chapters done", printed.err, values=False)
    reviewed("report: verdict", line(printed.out, "Model error"), values=False)


def test_a_missing_or_unknown_file_is_refused_before_the_computation(models: Path, tmp_path: Path) -> None:
    scene = fl.load_scene(models / "paper_fig5.toml")
    for name, id in (("theirs.xml", "no-such-file"), ("theirs.docx", "wrong-type")):
        with refused(fl.errors.ArgumentError, id) as caught:
            fl.report(scene, tmp_path / "out", against=tmp_path / name)
        assert name in str(caught.value)
    assert ".urdf" in str(caught.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("package", ["matplotlib", "jinja2"])
def test_a_missing_package_is_reported_with_the_extra_that_installs_it(models, tmp_path, package: str) -> None:
    code = (
        f"import sys; sys.modules[{package!r}] = None\n"
        "from flexlink.cli.main import main\n"
        f"sys.exit(main(['report', {str(models / 'paper_fig5.toml')!r}, '--out', {str(tmp_path / 'out')!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "'flexlink[report]'" in refused_line(done.stderr, "package-missing")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")
class TestInABrowser:
    @pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
    @pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
    def test_nothing_is_clipped_and_the_page_is_accessible(self, window, written, size, dark) -> None:
        window.open(written.page, *size, dark)
        window.run(UNFOLD)
        assert window.run(OFF_SCREEN) == []
        assert window.run(CUT_WORDS) == []
        if script := axe():
            window.run(script.read_text(encoding="utf-8"))
            assert window.run_async(VIOLATIONS) == []

    @pytest.mark.parametrize("width", [600, 800, 1050, 1150])
    def test_a_table_wider_than_the_window_scrolls_separately(self, window, written, width) -> None:
        window.open(written.page, width, 800)
        window.run(UNFOLD)
        full, shown = window.run("const d = document.documentElement; return [d.scrollWidth, d.clientWidth]")
        assert full <= shown


def test_a_column_is_numeric_if_it_contains_only_numbers() -> None:
    table = Table("name", "Title", ("text", "number", "mixed"), (("a", 1.0, None), ("b", None, "none")))
    assert table.numeric == {"number"}
    assert [row.split(",") for row in table.csv.splitlines()] == [
        ["text", "number", "mixed"], ["a", "1.0", ""], ["b", "", "none"],
    ]  # fmt: skip


def test_a_mistake_in_a_compared_file_is_on_the_first_screen(scene: fl.Scene, tmp_path, monkeypatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.setattr(building, "CHAPTERS", chapters("theirs", "measurements"))
    for name, gravity, state in (("right.xml", -9.81, "pass"), ("wrong.xml", 9.81, "fail")):
        theirs = tmp_path / name
        theirs.write_text(fl.to_mjcf(fl.lump(scene.varied({"gravity": (0.0, 0.0, gravity)}))), encoding="utf-8")
        found = report(scene, tmp_path / "out", against=theirs)
        assert [verdict.state for verdict in found.verdicts] == [state]
        assert found.passed is (state == "pass")
    reviewed("report: mistake in another file", found.verdicts[0].text)
    assert "gravity" in found.verdicts[0].text


def test_measurements_outside_the_run_fail_on_the_first_screen(scene: fl.Scene, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(building, "CHAPTERS", chapters("measurements"))
    measured = tmp_path / "measured.csv"
    measured.write_text("t [s],tip x [m]\n1000,0.1\n1001,0.2\n1002,0.1\n", encoding="utf-8")
    found = report(scene, tmp_path / "out", against=measured)
    assert not found.passed
    reviewed("report: measurements outside the run", found.verdicts[0].text)


def test_a_change_within_its_uncertainty_explains_nothing(scene: fl.Scene, tmp_path, monkeypatch) -> None:
    """The columns of x and z are swapped."""
    monkeypatch.setattr(building, "CHAPTERS", chapters("measurements"))
    run = fl.simulate(scene)
    swapped = {"tip x [m]": run.tip[:, 2], "tip z [m]": run.tip[:, 0]}
    rows = [("t [s]", *swapped), *zip(run.t, *swapped.values(), strict=True)]
    measured = tmp_path / "measured.csv"
    measured.write_text("\n".join(",".join(map(str, row)) for row in rows), encoding="utf-8")
    found = report(scene, tmp_path / "out", against=measured)
    page = (tmp_path / "out" / "index.html").read_text(encoding="utf-8")
    reviewed("report: nothing explains the difference", sentence(page, "units and the order"), values=False)
    assert found.passed
