"""Report in a real browser: nothing is cut on desktops, phones or paper, light or dark; the page is accessible."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from reports.build import build
from tests.support.browser import CHROMIUM, DRIVER, Browser, axe, browser
from validation.store import Series, Store
from validation.tests.studies import BUSY, row, stored, timed

pytestmark = [pytest.mark.slow, pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver")]

LONG = "a_name_without_any_place_to_break_" * 4
DESK, PHONE = (1280, 800), (390, 844)
OFF_SCREEN = """
const width = document.documentElement.clientWidth
const seen = [...document.querySelectorAll('body *')].filter(e => e.checkVisibility() && !e.closest('.drawing *'))
const off = seen.filter(e => { const r = e.getBoundingClientRect(); return r.right > width + 1 || r.left < -1 })
const cut = seen.filter(e => e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).overflowX !== 'visible')
return [...off, ...cut].map(e => `${e.tagName} ${e.className} ${e.textContent.slice(0, 60)}`)
"""
VIOLATIONS = """
const done = arguments[0]
axe.run({exclude: [['.drawing > *']]}, {resultTypes: ['violations']}).then(found =>
  done(found.violations.map(v => `${v.id}: ${v.nodes[0].html.slice(0, 200)}`)))
"""
CUT_WORDS = """
const cut = []
for (const drawing of document.querySelectorAll('.drawing')) {
  const whole = drawing.getBoundingClientRect()
  for (const word of drawing.querySelectorAll('g[transform*="scale(0.1"]')) {
    const w = word.getBoundingClientRect()
    if (w.left < whole.left - 1 || w.right > whole.right + 1 || w.top < whole.top - 1 || w.bottom > whole.bottom + 1)
      cut.push(`${drawing.getAttribute('aria-label')}: ${w.left - whole.left} to ${w.right - whole.right}`)
  }
}
return cut
"""
UNFOLD = "document.querySelectorAll('main details').forEach(d => { d.open = true })"
FOLD = "document.querySelectorAll('main details').forEach(d => { d.open = false })"
SCREENS = "return document.documentElement.scrollHeight / window.innerHeight"


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study with everything that a page can show: failures, gaps, disturbed timings, long names and notes."""
    folder = tmp_path_factory.mktemp("page")
    varied = {"rule": "gauss_matched", "hinges": 10, "step": 1e-4, "load": LONG}
    wordy = {"varied": varied, "note": "A note. " * 20}
    many = [row("many", quantity=f"q{k}", value=1e-14 * k, scene=f"scene_{k % 2}", **wordy) for k in range(9)]
    broken = row("broken", value=3e-9, quantity=LONG, kind="statics")
    given_up = row("given", tolerance=None, given_up="It cannot be met.")
    fast = [timed(2.0, varied=varied | {"n": k}) for k in range(4)]
    results = stored(folder / "results", broken, *many, given_up, *fast, conditions=BUSY, planned=("absent",))
    columns = {"t": np.linspace(0, 1, 50), "y": np.linspace(0, 1, 50) ** 2}
    for part in ("one", "two"):
        series = Series("unheard", f"Curve {part}", columns, "t", "time [s]", "y [m]", part=part)
        Store(results).add_series("many", series)
    return build(results, folder / "report", folder / "no reference", None)


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
@pytest.mark.parametrize("script", [FOLD, UNFOLD], ids=["folded", "unfolded"])
class TestEverywhere:
    def test_nothing_is_cut_or_off_screen(self, window, page, size, dark, script) -> None:
        window.open(page, *size, dark)
        window.run(script)
        assert window.run(OFF_SCREEN) == []

    @pytest.mark.skipif(axe() is None, reason="needs axe-core: npm install axe-core, or AXE=…/axe.min.js")
    def test_no_accessibility_violation(self, window, page, size, dark, script) -> None:
        window.open(page, *size, dark)
        window.run(script)
        window.run((axe() or page).read_text(encoding="utf-8"))
        assert window.run_async(VIOLATIONS) == []


def test_no_label_of_a_figure_is_cut(window: Browser, page: Path) -> None:
    window.open(page, *DESK)
    window.run(UNFOLD)
    words = window.run("return document.querySelectorAll('.drawing g[transform*=\"scale(0.1\"]').length")
    assert words > 20
    assert window.run(CUT_WORDS) == []


def test_the_first_screen_of_a_desktop_has_verdicts_and_numbers(window: Browser, page: Path) -> None:
    window.open(page, *DESK)
    seen = window.run("""return ['.verdicts', '.facts'].map(name => {
        const box = document.querySelector(name).getBoundingClientRect(); return box.width > 0 && box.top < 800 })""")
    assert seen == [True, True]


@pytest.mark.parametrize(("size", "which"), [(DESK, "nav.side"), (PHONE, "nav.top")])
def test_the_navigation_stays_in_view(window: Browser, page: Path, size: tuple[int, int], which: str) -> None:
    window.open(page, *size)
    top = window.run(
        """window.scrollTo(0, 3000)
        const nav = document.querySelector(arguments[0])
        return [window.scrollY > 500, nav.checkVisibility(), nav.getBoundingClientRect().top]""",
        which,
    )
    assert top == [True, True, 0]


def test_a_link_to_a_folded_case_unfolds_it(window: Browser, page: Path) -> None:
    window.open(page, *DESK)
    window.run(FOLD)
    window.run("location.hash = 'case-many'")
    unfolded = window.run("return document.getElementById('case-many').closest('details').open")
    assert unfolded is True


def test_on_paper_nothing_is_cut_and_there_is_no_navigation(window: Browser, page: Path) -> None:
    window.open(page, 794, 1123, media="print")  # A4 at 96 dots an inch
    assert window.run(OFF_SCREEN) == []
    visible = window.run("return [...document.querySelectorAll('nav')].map(n => n.checkVisibility())")
    assert visible == [False, False]
    assert window.print().startswith(b"%PDF")


LATEST = Path(__file__).parents[2] / "reports" / "latest" / "index.html"


@pytest.mark.skipif(not LATEST.is_file(), reason="needs a report: python -m validation")
def test_the_full_report_is_short_and_small_and_cuts_no_word(window: Browser) -> None:
    """The page of all cases has a screen for every 3.5 cases with folded chapters, and 2 MB without the drawings."""
    window.open(LATEST, *DESK)
    window.run(FOLD)
    cases = window.run("""return document.querySelectorAll("[id^='case-']").length""")
    assert window.run(SCREENS) <= cases / 3.5
    window.run(UNFOLD)
    assert window.run(CUT_WORDS) == []
    drawn = window.run(
        "return [...document.querySelectorAll('svg')].map(s => s.outerHTML.length).reduce((a, b) => a + b)"
    )
    assert len(LATEST.read_text(encoding="utf-8")) - drawn <= 2e6
