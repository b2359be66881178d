"""The report is one self-contained page. It depends on the stored results alone and shows first what fails."""

import csv
import dataclasses
import html
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace
from PIL import Image

from flexlink.common.errors import FlexlinkError
from flexlink.pages.colours import CYCLE, ENGINES, engine_name, look_of
from flexlink.pages.numbers import JOIN, number
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from flexlink.pages.tables import Table
from reports import full
from reports.__main__ import main
from reports.build import build
from reports.chapters import Number, Wanted
from reports.curves import curves, panels_of
from reports.drawing import pictures
from reports.figures import figure as drawn_figures
from reports.figures.lines import beams
from reports.figures.trade import Word, place_words
from reports.findings.paper import conclusion as judge
from reports.findings.paper import evaluations
from reports.results import Results, used
from reports.tables import checks, limit, meanings, series_csv
from reports.verdict import Fact, numbers_that_matter
from tests.support.words import refused, reviewed
from validation.judgement import judged_rows
from validation.store import Finished, Series, Store
from validation.tests.studies import (
    DATE,
    QUIET,
    REASON,
    first_screen,
    first_screen_html,
    page_from,
    page_of,
    row,
    stored,
    timed,
    words_of,
)

ROOT = Path(__file__).parents[2]
LOADED = re.compile(r"@import|url\((?!#)|<script|<link|<iframe|<b>q")
NAMED_PICTURE = re.compile(r'<svg [^>]*role="img" aria-label="[^"]{5,}"')
CAPTION = re.compile(r"<figcaption><strong>.{5,}</strong>")
WITHDRAWN = "A limit first set was 1e-8; it cannot be met."


def run(*command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run Python in another folder, with the project on its path."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, *command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )


class Links(HTMLParser):
    """Files that a page loads, targets of its links, and its ids."""

    def __init__(self) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.ids: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.targets += [value or "" for name, value in attrs if name in ("src", "href", "srcset", "data", "action")]
        self.ids += [value or "" for name, value in attrs if name == "id"]


def links(page: str) -> Links:
    parser = Links()
    parser.feed(page)
    return parser


def items(page: str, *parts: str) -> list[str]:
    """Paragraphs and list items of a page that contain all parts, without tags."""
    found = re.findall(r"<(?:li|p)\b[^>]*>(.*?)</(?:li|p)>", page, re.DOTALL)
    shown = (" ".join(html.unescape(re.sub(r"<[^>]*>", " ", each)).split()) for each in found)
    return [each for each in shown if all(part in each for part in parts)]


@pytest.mark.slow
def test_the_report_needs_no_engine_and_no_simulation(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row())
    blocked = "import sys\nfor name in ('pinocchio', 'mujoco', 'rich', 'mpmath'): sys.modules[name] = None\n"
    command = f"from reports.__main__ import main\nsys.exit(main(['--results', {str(results)!r}, '--out', 'o']))"
    done = run("-c", blocked + command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert row().title in (tmp_path / "o" / "index.html").read_text(encoding="utf-8")


def test_failing_rows_come_first_and_passing_findings_are_not_among_them(tmp_path: Path) -> None:
    page = words_of(tmp_path, row("fine"), row("broken", value=3e-9, quantity="T_GC"))
    (verdict,) = items(first_screen_html(page), "1 of 2")
    reviewed("reports: verdict of failing checks", verdict)
    parts = ["1 of 2", 'id="failing"', html.escape(REASON), 'id="agreement"', row("fine").title]
    positions = [page.index(part) for part in parts]
    assert positions == sorted(positions)
    broken, fine = (page.index(f'id="case-{name}"') for name in ("broken", "fine"))
    assert broken < fine, "failing cases come first in their chapter"
    failing = page[page.index('id="failing"') :].split("</section>")[0]
    assert "T_GC" in failing
    assert items(page, f"{number(1e-15)} ×")
    assert number(1e-15) not in failing
    assert failing.count("<tr class") == 1
    assert "#case-broken" in links(failing).targets


def test_a_finding_whose_number_fails_its_limit_is_marked(tmp_path: Path) -> None:
    fall = row("fall", kind="trajectory", quantity="max |Δq|", unit="rad", value=3e-9)
    page = words_of(tmp_path, row("broken", value=3e-9, quantity="M"), fall)
    (finding,) = items(page, "3 × 10⁻⁹ × ", "paper_fig5", "mujoco")
    reviewed("reports: finding that fails its limit", finding)
    mark = re.findall(r"\([^()]*\)", finding)[-1]
    assert mark not in " ".join(items(page, f"{number(1e-15)} ×"))
    assert mark in first_screen(page), "the first screen has the same mark"


def test_passing_tables_are_folded_and_failing_ones_are_open(tmp_path: Path) -> None:
    page = words_of(tmp_path, row("fine"), row("broken", value=3e-9))
    opened = {re.search(r'id="case-(\w+)"', part)[1]: " open>" in part.partition("<summary>")[0]
              for part in page.split('<details class="case')[1:]}  # type: ignore[index]  # fmt: skip
    assert opened == {"fine": False, "broken": True}


def test_a_missing_value_fails_and_is_a_known_limitation(tmp_path: Path) -> None:
    page = words_of(tmp_path, row(value=None))
    (verdict,) = items(first_screen_html(page), "1 of 1")
    reviewed("reports: verdict of failing checks", verdict)
    exceeded, missing = items(page[page.index('id="limitations"') :], "terms:", "paper_fig5", "max |Δ|")
    reviewed("reports: limit exceeded", exceeded)
    reviewed("reports: missing value", missing)


@pytest.mark.slow
def test_an_unknown_kind_of_case_gets_its_table_and_curves(tmp_path: Path) -> None:
    results = stored(tmp_path / "results", row("odd", kind="never heard of"))
    columns = {"t": np.arange(3.0), "y": np.array([1.0, np.nan, 3.0])}
    curve = Series("unheard", "How it grows", columns, "t", "t [s]", "y")
    Store(results).add_series("odd", curve)
    page = page_from(results, tmp_path)
    chapter = page[page.index('id="other"') :]
    assert row("odd").title in chapter
    assert curve.title in chapter
    picture = tmp_path / "report" / "odd.unheard"
    assert picture.with_suffix(".unheard.svg").exists()
    assert picture.with_suffix(".unheard.png").read_bytes().startswith(b"\x89PNG")


def many_curves(methods: int, *words: str) -> Series:
    """Return energy and momentum of `methods` methods at two points each, and columns of words."""
    names = np.repeat([f"method {k}" for k in range(methods)], 2)
    numbers = {name: np.arange(1.0, 2 * methods + 1) for name in ("steps", "energy", "momentum")}
    columns = {"method": names, **numbers, **dict.fromkeys(words, names)}
    return Series("drifts", "Drift", columns, "steps", "steps", "drift", group="method")


def test_columns_of_text_are_not_plotted() -> None:
    labels = [curve.label for curve in curves(many_curves(1, "scene"))]
    assert labels == [f"method 0 {name}" for name in ("energy", "momentum")]


def test_columns_without_a_positive_value_are_not_plotted_on_a_logarithmic_scale() -> None:
    series = many_curves(1)
    series.columns["energy"][:] = 0.0
    series.columns["momentum"][0] = 0.0
    assert len([*curves(series)]) == 2
    (curve,) = curves(dataclasses.replace(series, y_scale="log"))
    assert curve.y.tolist() == series.columns["momentum"].tolist()


@pytest.mark.parametrize(("methods", "panels"), [(6, [""]), (7, ["energy", "momentum"])])
def test_many_curves_are_plotted_in_one_panel_per_quantity(methods: int, panels: list[str]) -> None:
    found = panels_of(many_curves(methods))
    assert [name for name, _ in found] == panels
    assert sum(len(list(curves(part))) for _, part in found) == 2 * methods


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build a report with figures, a failing check, and titles that contain markup; return its folder."""
    folder = tmp_path_factory.mktemp("whole")
    markup = row("markup", quantity="<b>q</b>", title="A & <script>x</script>")
    page_of(folder, row(scene="one"), row(scene="two"), row("more"), row("broken", value=1.0), markup)
    return folder / "report"


@pytest.mark.slow
def test_the_page_loads_nothing_and_links_only_to_files_in_its_folder(whole: Path) -> None:
    page = (whole / "index.html").read_text(encoding="utf-8")
    found = links(page)
    for target in found.targets:
        if target.startswith("#"):
            assert target[1:] in found.ids, "the target of a link within the page exists"
        else:
            assert (whole / target).is_file(), target
    assert len(found.ids) == len(set(found.ids))
    assert not LOADED.search(page)


@pytest.mark.slow
def test_every_figure_has_a_title_a_name_and_a_link_to_its_data(whole: Path) -> None:
    page = (whole / "index.html").read_text(encoding="utf-8")
    figures = re.findall(r"<figure .*?</figure>", page, re.DOTALL)
    assert len(figures) >= 3
    for figure in figures:
        assert NAMED_PICTURE.search(figure)
        assert CAPTION.search(figure)
        (data,) = re.findall(r'href="([^"]*\.csv)"', figure)
        assert len((whole / data).read_text(encoding="utf-8").splitlines()) > 1


@pytest.mark.slow
def test_figures_share_glyphs_and_use_only_defined_elements(whole: Path) -> None:
    page = (whole / "index.html").read_text(encoding="utf-8")
    defined = re.findall(r'<(?:path|clipPath) id="([^"]*)"', page)
    assert len(defined) == len(set(defined))
    used = set(re.findall(r'href="#([\w-]*)"|url\(#([^)]*)\)', page.split("</nav>")[-1]))
    assert {one or other for one, other in used} - {"speed-table"} <= set(defined) | set(links(page).ids)


def test_the_page_names_no_folder_of_the_machine_that_made_it(tmp_path: Path) -> None:
    page = words_of(tmp_path, row())
    assert str(tmp_path) not in page
    assert str(ROOT) not in page


def test_csv_reads_back_exactly(tmp_path: Path) -> None:
    value = 0.1 + 0.2
    words_of(tmp_path, row(value=value, tolerance=1.0))
    with (tmp_path / "report" / "terms.csv").open(encoding="utf-8", newline="") as file:
        (read,) = csv.DictReader(file)
    assert float(read["value"]) == value
    assert read["reason"] == REASON


@pytest.mark.parametrize(("metres", "unit"), [(1.0, "m"), (1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm")])
def test_the_distance_of_two_tips_is_drawn_in_the_unit_of_its_axis(tmp_path: Path, metres: float, unit: str) -> None:
    columns = {"t": np.arange(2.0), "far": metres * np.array([2.0, 4.0]), "near": metres * np.array([0.5, 0.25])}
    results = stored(tmp_path, row())
    Store(results).add_series("terms", Series("beams", "Title", columns, "t", "t [s]", "y [m]", scene="arm"))
    (picture,) = beams(Results.read(results))
    (axes,) = picture.figure.axes
    assert axes.get_ylabel().endswith(f"[{unit}]")
    far, near = (line.get_ydata() for line in axes.lines)
    assert [*far, *near] == pytest.approx([2.0, 4.0, 0.5, 0.25])


def test_a_line_of_a_figures_data_has_panel_and_curve() -> None:
    columns = {"t": np.array([0.5]), "y": np.array([2.0]), "scene": np.array(["arm"]), "rule": np.array(["gauss"])}
    series = Series("sweep", "Title", columns, "t", "t [s]", "y [m]", group="rule", panel="scene")
    assert [*csv.reader(series_csv(series).splitlines())] == [
        ["series", "panel", "curve", "column", "t [s]", "y [m]"], ["sweep", "arm", "gauss", "y", "0.5", "2.0"],
    ]  # fmt: skip


def test_the_share_of_a_limit_exceeds_one_exactly_if_the_check_fails() -> None:
    upper, over = row(value=0.5, tolerance=1.0), row(value=2.0, tolerance=1.0)
    lower = row(value=7.5, tolerance=3.0, bound="at least", passed=True)
    under = row(value=1.5, tolerance=3.0, bound="at least", passed=False)
    assert [used(r) for r in (upper, over, lower, under)] == [0.5, 2.0, 0.4, 2.0]
    assert limit(lower) == "≥ 3"


def test_a_reason_is_listed_once_for_all_rows_and_notes_in_each_row() -> None:
    notes = ["Largest at joint 'upper.1'.", "Hm."]
    rows = [row(note=notes[0]), row(note=notes[1], engine="pinocchio")]
    found, _ = checks(judged_rows(rows, {}))
    assert [meaning.reason for meaning in meanings(rows)] == [REASON]
    assert [line[found.heads.index("note")] for line in found.lines] == notes


def test_failing_checks_are_listed_first_and_rows_without_a_limit_last() -> None:
    calm = {"calls": Finished("k", DATE, "A processor", QUIET)}
    rows = [row("b", tolerance=None), row("b"), timed(0.5), timed(2.0), row("b", value=1.0, quantity="q")]
    found, _ = checks(judged_rows(rows, calm))
    assert found.classes == ("FAIL", "missed", "met", "pass", "info") == tuple(line[0] for line in found.lines)
    assert [line[1] for line in found.lines] == ["q", "public call", "public call", "M", "M"]


def test_a_field_has_a_column_only_if_it_differs_between_rows(tmp_path: Path) -> None:
    rows = [row(varied={"method": "RK4", "step": h}, quantity="q") for h in (1e-3, 1e-4)]
    found, common = checks(judged_rows(rows, {}))
    assert common.split(", ") == ["paper_fig5", "MuJoCo", "RK4"]
    *first, last = found.heads
    assert first == ["state", "quantity", "setting", "value", "limit"]
    reviewed("reports: head of the share of a limit", last)
    assert [line[2] for line in found.lines] == ["h = 0.001 s", "h = 0.0001 s"]
    words_of(tmp_path, *rows)
    with (tmp_path / "report" / "terms.csv").open(encoding="utf-8", newline="") as file:
        assert [(line["method"], float(line["step [s]"])) for line in csv.DictReader(file)] == [
            ("RK4", 1e-3),
            ("RK4", 1e-4),
        ]


def test_a_withdrawn_limit_is_a_known_limitation(tmp_path: Path) -> None:
    page = words_of(tmp_path, row(tolerance=None, given_up=WITHDRAWN), row("fine"))
    limitation = page[page.index('id="given-up"') :]
    assert WITHDRAWN in limitation
    without = words_of(tmp_path / "without", row(tolerance=None), row("fine"))
    (verdict,) = set(items(first_screen_html(page), "1 ")) - set(items(first_screen_html(without)))
    reviewed("reports: verdict with a withdrawn limit", verdict)


def conclusion(rk4: float, rk10: float) -> Table:
    """Table of the paper's conclusion for methods with errors `rk4` N⁻⁴ and `rk10` N⁻¹⁰ after N evaluations."""
    work = np.geomspace(10.0, 1e5, 9)
    return judge("name", "scene", {"RK4": (work, rk4 * work**-4), "RK10": (work, rk10 * work**-10)})


def test_the_papers_conclusion_changes_where_the_curves_cross() -> None:
    found = conclusion(rk4=1.0, rk10=1e18)  # the methods are equal at N = 10³, where both errors are 1e-12
    assert {line[-1] for line in found.lines[:-1]} == {"RK4"}
    assert found.lines[-1][1] == pytest.approx(1e3, rel=1e-9), (
        "interpolation between logarithms is exact on a power law"
    )
    crossing = conclusion(rk4=1.0, rk10=10**8.7)  # the methods are equal at N = 10^1.45, with error 10^-5.8
    assert [line[-1] for line in crossing.lines] == ["RK4"] * 5 + ["RK10"] * 7
    shown = crossing.sentences[0].replace(JOIN, " ")
    limits = re.findall(r"0\.1|10⁻[¹²⁵⁶]+", shown)
    assert limits == ["0.1", "10⁻⁵", "10⁻⁶", "10⁻¹²"]
    reviewed("reports: conclusion of the paper", shown)


@pytest.mark.parametrize(("rk4", "rk10", "cheapest"), [(1.0, 1e30, "RK4"), (1e12, 1e10, "RK10")])
def test_the_papers_conclusion_may_be_true_everywhere_or_nowhere(rk4: float, rk10: float, cheapest: str) -> None:
    found = conclusion(rk4, rk10)
    assert {line[-1] for line in found.lines} == {cheapest}
    reviewed("reports: conclusion of the paper", found.sentences[0])


def test_cost_at_an_accuracy_is_none_if_missed_and_ignores_undefined_errors() -> None:
    work = np.array([10.0, 100.0, 1000.0])
    assert evaluations(work, np.array([1e-2, np.inf, 1e-4]), 1e-5) is None
    assert evaluations(work, np.array([1e-2, np.nan, 1e-4]), 1e-4) == pytest.approx(1e3)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (1e-12, "10⁻¹²"), (1.234e-15, "1.23 × 10⁻¹⁵"), (4.0, "4"), (123.456, "123"), (1234.5, "1234"),
     (0.0015, "0.0015"), (-2.5e-7, "−2.5 × 10⁻⁷"), (-8.2, "−8.2"), (2e5, "2 × 10⁵"), (None, "–")],
)  # fmt: skip
def test_numbers_are_short_and_correctly_rounded(value: float | None, text: str) -> None:
    assert number(value).replace(JOIN, " ") == text


def test_a_second_value_may_share_the_setting_of_the_first(tmp_path: Path) -> None:
    ours = [
        row("ours", value, None, quantity="fit", varied={"situation": at}) for at, value in (("a", 65.0), ("b", 62.0))
    ]
    theirs = [
        row("theirs", v, None, quantity="other", varied={"situation": at}) for at, v in (("a", 64.0), ("b", 66.0))
    ]
    results = Results.read(stored(tmp_path, *ours, *theirs))
    least = Wanted(kind="pointwise", quantity="fit", pick="smallest")
    other = Wanted(kind="pointwise", quantity="other", pick="smallest")
    for beside, shown in ((False, "64"), (True, "66")):
        number = Number(label="label", value=(least, replace(other, beside=beside)))
        assert numbers_that_matter(results, [number]) == [Fact("label", (("62", ""), (shown, "")))]


def test_missing_results_are_one_line_and_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--results", str(tmp_path / "none"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    reviewed("reports: missing results", error)
    assert "-m validation" in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["finished.json", "plan.json", "environment.json", "series/terms.curve.npz"])
def test_a_truncated_results_file_is_one_line_and_exit_code_2(tmp_path, capsys, name: str) -> None:
    results = stored(tmp_path / "results", row())
    Store(results).add_series("terms", Series("curve", "Title", {"x": np.ones(2), "y": np.ones(2)}, "x", "x", "y"))
    (results / name).write_bytes((results / name).read_bytes()[:20])
    assert main(["--results", str(results), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert name in error
    assert error.count("\n") == 1


def test_an_unwritable_report_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with refused(FlexlinkError, "cannot-write"):
        build(stored(tmp_path / "results", row()), tmp_path / "file")


@pytest.mark.slow
def test_the_report_does_not_depend_on_the_number_of_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    results = stored(tmp_path / "results", row())
    for k in range(5):
        columns = {"n": np.arange(3.0), "error": 2.0 ** -np.arange(k, k + 3.0)}
        series = Series("halves", f"Title {k}", columns, "n", "n", "error", "log", "log", part=str(k))
        Store(results).add_series("terms", series)
    alone = build(results, tmp_path / "alone", tmp_path / "none")
    monkeypatch.setattr("reports.drawing.WORTH_A_PROCESS", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    written_here: list[str] = []
    shown = Picture.shown
    monkeypatch.setattr(Picture, "shown", lambda self, *to: written_here.append(self.name) or shown(self, *to))  # type: ignore[func-returns-value]
    shared = build(results, tmp_path / "shared", tmp_path / "none")
    assert 3 <= len(written_here) <= 4, "this process wrote about half of seven pictures"
    names = {file.name for file in alone.parent.iterdir()}
    assert names == {file.name for file in shared.parent.iterdir()}
    for name in names:
        assert (alone.parent / name).read_bytes() == (shared.parent / name).read_bytes(), name


LONGEST_CAPTION = 160  # letters: two lines of half a page's column


def drawn(path: Path) -> dict[str, Figure]:
    """Figures by name, from a small study in which engines appear in several figures."""
    engines = ("pinocchio", "mujoco")
    growth = {"kind": "rounding_growth", "tolerance": None}
    rows = [row(engine=engine, quantity=name) for engine in engines for name in ("M", "T_GC with tip wrench")]
    results = stored(path, *rows, row("rounding_growth", quantity="growth rate", **growth))
    time = np.linspace(0.1, 1.0, 9)
    columns = {"time [s]": time} | {name: 1e-15 * np.exp(time) for name in ("native, one ulp", *engines)}
    labels = "time [s]", "time [s]", "max |Δq| up to t [rad]"
    Store(results).add_series("rounding_growth", Series("growth", "Title", columns, *labels, scene="one"))
    plain = Series("unheard", "Title", {name: columns[name] for name in ("time [s]", *engines)}, *labels)
    Store(results).add_series("terms", plain)
    return {picture.name: picture.figure for _, picture in pictures(Results.read(results))}


def test_an_engine_has_one_colour_and_one_name_in_all_figures(tmp_path: Path) -> None:
    for name, figure in drawn(tmp_path).items():
        if name == "overview":
            continue
        for look in (ENGINES["pinocchio"], ENGINES["mujoco"]):
            lines = [line for axes in figure.axes for line in axes.lines if line.get_label() == look.name]
            assert [line.get_color() for line in lines] == [look.colour], name


def test_colours_of_engines_differ_and_belong_to_the_colour_blind_safe_palette() -> None:
    looks = ENGINES.values()
    assert len({look.colour for look in looks}) == len({look.marker for look in looks}) == len(looks)
    assert {look.colour for look in looks} - {ENGINES["mpmath"].colour} == set(CYCLE)


@pytest.mark.parametrize("name", ["native", "flexlink", "Flexlink"])
def test_an_engine_is_recognised_by_its_stored_name_and_its_display_name(name: str) -> None:
    assert engine_name(name) == "flexlink"
    assert look_of(name) == ENGINES["native"]
    assert look_of("RK4") is None


def test_all_figures_use_the_same_palette() -> None:
    """The exceptions, a red-to-blue colour map and the greys of a film, are not used for curves."""
    others = {"extremes.py": 8, "drawing.py": 2, "colouring.py": 8}
    for folder in ("reports", "flexlink/results", "flexlink/scene_report"):
        for path in (ROOT / folder).rglob("*.py"):
            found = re.findall(r'"#[0-9a-f]{6}"|"tab:\w+"', path.read_text(encoding="utf-8"))
            assert len(found) <= others.get(path.name, 0), path


def test_captions_take_two_lines_at_most() -> None:
    for module in {sys.modules[maker.make.__module__] for maker in drawn_figures.values()}:
        for name, value in vars(module).items():
            if isinstance(value, str) and name.isupper():
                assert len(value) <= LONGEST_CAPTION, f"{module.__name__}.{name}: {len(value)} letters"


def test_point_labels_never_overlap_and_stay_inside_the_axes() -> None:
    random = np.random.default_rng(0)
    figure, (axes,) = stacked_axes(1, 3.0)
    x, y = random.random((2, 40))
    axes.plot(x, y, "o")
    place_words(
        axes, [Word(f"method {k}", *at, "k") for k, at in enumerate(zip(x, y, strict=True))], zip(x, y, strict=True)
    )
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert 5 < len(boxes) < 40, "labels without room are left out"
    room = axes.get_window_extent()
    for k, box in enumerate(boxes):
        assert room.x0 - 1 <= box.x0 < box.x1 <= room.x1 + 1
        assert not any(box.overlaps(other) for other in boxes[:k])


def test_a_label_does_not_cover_the_line_that_it_names() -> None:
    _, (axes,) = stacked_axes(1, 3.0)
    x = np.linspace(0, 1, 200)
    axes.plot(x, x)
    place_words(axes, [Word("RK4", 0.5, 0.5, "k")], zip(x, x, strict=True))
    (text,) = axes.texts
    box = text.get_window_extent()
    on_line = axes.transData.transform(np.column_stack([x, x]))
    assert sum(box.contains(*at) for at in on_line) <= 3


def test_a_checked_in_figure_keeps_the_colour_of_every_engine(tmp_path: Path) -> None:
    """The figure has few marks in many colours and much text; a small palette once dropped rare colours."""
    figure, (axes,) = stacked_axes(1, 6.0)
    for k, look in enumerate(ENGINES.values()):
        axes.plot([k], [k], look.marker, color=look.colour)
    for k in range(30):
        axes.text(0.0, k / 5, "two links of 40 hinges in a plane " * 2, fontsize=8)
    file = tmp_path / "picture.png"
    Picture("picture", "Title", figure, "", "").save_png(file)
    before = {colour for _, colour in Image.open(file).convert("RGB").getcolors(10**6) or ()}
    full._shrink(file)
    after = {colour for _, colour in Image.open(file).convert("RGB").getcolors(10**6) or ()}
    for look in ENGINES.values():
        wanted = tuple(int(look.colour[k : k + 2], 16) for k in (1, 3, 5))
        assert wanted in before
        assert min(max(abs(a - b) for a, b in zip(wanted, found, strict=True)) for found in after) <= 12, look.name
