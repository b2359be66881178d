"""The site in a real browser, from local files: nothing is cut on desktop or phone, light or dark; search works."""

import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.browser import CHROMIUM, DRIVER, Browser, axe, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver"),
    pytest.mark.skipif("SITE" not in os.environ, reason="needs a site: python -m docs, then SITE=docs/_site"),
]
DESK, PHONE = (1280, 800), (390, 844)
PAGES = (
    "index", "start/first_arm", "start/coming_from", "howto/index", "howto/steps", "explanation/chain",
    "explanation/damping", "explanation/study", "explanation/extremes", "gallery/index", "gallery/crane",
    "gallery/payload_sweep",
    "reference/generated/api", "reference/generated/api/flexlink.Joint",
    "reference/generated/api/flexlink.simulate", "reference/generated/scene", "reference/generated/command_line",
    "reference/generated/methods", "reference/generated/messages", "reference/generated/notation",
    "reference/generated/study",
)  # fmt: skip
SEARCHES = {
    "mass_matrix": "flexlink.mass_matrix", "armature": "reference/generated/scene", "prismatic": "start/",
    "segments": "howto/segments", "damping": "howto/stiffness", "buckling": "howto/statics", "gymnasium": "howto/loop",
    "stiff": "howto/steps", "strain": "howto/loads", "LQR": "howto/control", "urdf": "start/robot",
    "shaper": "start/shaped_move", "sweep": "howto/sweeps", "tolerance": "howto/steps", "mujoco": "start/coming_from",
    "install": "start/install", "Radau5": "reference/generated/methods", "gauss": "reference/generated/rules",
    "units": "reference/", "contact": "start/for_you",
    "PID": "howto/questions", "eigenfrequency": "howto/statics", "conda": "start/install", "mamba": "start/install",
    "Simulink": "howto/questions", "MATLAB": "howto/questions", "FMU": "howto/questions", "event": "howto/loop",
    "impact": "howto/drive", "Cartesian": "howto/questions", "FRF": "howto/fit", "Windows": "start/install",
    "cite": "howto/questions", "BibTeX": "howto/questions",
}  # fmt: skip
OVERFLOW = """
const width = document.documentElement.clientWidth
if (document.documentElement.scrollWidth <= width + 1) return []
const own = e => ['auto', 'scroll', 'hidden'].includes(getComputedStyle(e).overflowX)
const scrolls = e => e && (own(e) || scrolls(e.parentElement))
return [...document.querySelectorAll('body *')].filter(e => e.checkVisibility() && !scrolls(e.parentElement)
  && e.getBoundingClientRect().right > width + 1).map(e => `${e.tagName} ${e.className} ${e.textContent.slice(0, 60)}`)
"""
STILL = "document.head.insertAdjacentHTML('beforeend', '<style>* { transition: none !important }</style>')"
VIOLATIONS = """
const done = arguments[0]
axe.run(document, {resultTypes: ['violations']}).then(found =>
  done(found.violations.map(v => `${v.id}: ${v.nodes.length} × ${v.nodes[0].html.slice(0, 200)}`)))
"""


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def site() -> Path:
    """Folder of the built site, from the environment variable SITE."""
    return Path(os.environ["SITE"])


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
@pytest.mark.parametrize("name", PAGES)
def test_pages_are_not_cut_and_are_accessible(window, site, name, size, dark) -> None:
    window.open(site / f"{name}.html", *size, dark)
    window.run(STILL)
    theme = window.run("return document.documentElement.dataset.theme")
    assert theme == ("dark" if dark else "light")
    assert window.run(OVERFLOW) == []
    script = axe()
    if script is None:
        pytest.skip("needs axe-core: npm install axe-core, or AXE=…/axe.min.js")
    window.run(script.read_text(encoding="utf-8"))
    assert window.run_async(VIOLATIONS) == []


@pytest.mark.parametrize("word", SEARCHES)
def test_search_from_a_file_finds_the_page(window: Browser, site: Path, word: str) -> None:
    window.open(site / "search.html", *DESK)
    window.run(f"location.href = 'search.html?q={word}'")
    wait = """
    const done = arguments[0]
    const look = tries => {
      const status = document.querySelector('#search-results .search-summary')
      if (status && status.textContent.includes('found') || tries == 0)
        done([...document.querySelectorAll('#search-results li a')].map(a => a.getAttribute('href')))
      else setTimeout(() => look(tries - 1), 50)
    }
    look(200)"""
    assert any(SEARCHES[word] in link for link in window.run_async(wait)), word


def test_a_hit_of_the_search_opens_at_the_section_with_most_of_its_words(window: Browser, site: Path) -> None:
    window.open(site / "search.html", *DESK)
    window.run("location.href = 'search.html?q=strain gauge'")
    click = """
    const done = arguments[0]
    const look = tries => {
      const link = document.querySelector('#search-results li a[href*="howto/loads.html"]:not([href*="#"])')
      if (link) { link.click(); done(true) } else if (tries == 0) done(false)
      else setTimeout(() => look(tries - 1), 50)
    }
    look(200)"""
    assert window.run_async(click)
    at = "return [...document.querySelectorAll('section')].find(s => Math.abs(s.getBoundingClientRect().top) < 120)?.id"
    for _ in range(100):
        if (found := window.run(at)) == "strain-gauges":
            return
        time.sleep(0.05)
    pytest.fail(f"at section {found!r}")


def test_no_page_accesses_the_network(site: Path) -> None:
    pattern = re.compile(
        r"""<(?:script|img|iframe)[^>]*src=["']?(?:https?:)?//|<link[^>]*stylesheet[^>]*href=["']?http"""
    )
    assert [path for path in site.rglob("*.html") if pattern.search(path.read_text(encoding="utf-8"))] == []
