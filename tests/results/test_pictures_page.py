"""Player page in a real browser: the arm stays in its canvas; mouse, touch and keys work; the page is accessible."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

import flexlink as fl
from tests.conftest import ROOT
from tests.support.browser import CHROMIUM, DRIVER, Browser, axe, browser

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (CHROMIUM and DRIVER), reason="needs chromium and chromedriver"),
]

DESK, PHONE = (1280, 800), (390, 844)
BEYOND = """
const beyond = []
for (const angle of film.spatial ? [-180, -120, -60, 0, 60, 120] : [0]) {
  turn.value = angle; turned()
  for (let k = 0; k < frames; k++) {
    const all = bodies(k)
    film.body.map((b, s) => pixel(placed(all[b], at(place, s)))).forEach(([x, y]) => {
      if (!(x > 4 && x < canvas.width - 4 && y > 4 && y < canvas.height - 4)) beyond.push([angle, k, x, y])
    })
  }
}
return beyond
"""
INK = """
const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data
let drawn = 0
for (let i = 3; i < data.length; i += 4) drawn += data[i] > 128
return drawn
"""
LABEL, CLOCK = "return play.textContent", "return one('.clock').textContent"
PLAYING, SEEN = "return running !== null", "return canvas.toDataURL()"
WIDTH, LEGEND = "return document.documentElement.scrollWidth", "return one('.legend').getBoundingClientRect().bottom"
VIOLATIONS = "const done = arguments[0]; axe.run().then(found => done(found.violations.map(v => v.id)))"


@pytest.fixture(scope="module")
def window() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    films = {}
    for name in ("paper_fig5", "t3_spatial"):
        run = fl.simulate(fl.load_scene(ROOT / "models" / f"{name}.toml"), duration=0.4)
        films[name] = run.animate(folder / f"{name}.html", magnify=10.0)
    return films


@pytest.mark.parametrize("size", [DESK, PHONE], ids=["desk", "phone"])
@pytest.mark.parametrize("name", ["paper_fig5", "t3_spatial"])
def test_the_arm_is_within_its_canvas_and_nothing_is_wider_than_the_screen(
    name: str, size: tuple[int, int], window: Browser, pages: dict[str, Path]
) -> None:
    window.open(pages[name], *size)
    assert window.run(BEYOND) == []
    assert window.run(INK) > 1000
    assert window.run(WIDTH) <= size[0]
    assert window.run(LEGEND) <= size[1]


def test_the_player_plays_stops_and_follows_the_slider(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *PHONE)
    assert window.run(LABEL) == "Pause"  # it starts playing
    window.run("play.click()")
    assert window.run(LABEL) == "Play"
    window.run("slider.value = 5; slider.dispatchEvent(new Event('input'))")
    assert window.run(CLOCK) == "t = 0.20 s"
    spoken = window.run("return slider.getAttribute('aria-valuetext')")
    assert spoken == "0.20 seconds"
    window.run("play.focus(); play.click()")
    playing = window.run(f"{PLAYING} && document.activeElement === play")
    assert playing


def test_the_player_works_without_a_mouse(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *DESK)
    stops = "[...document.querySelectorAll('button, input')].filter(e => e.checkVisibility() && e.tabIndex >= 0)"
    assert window.run(f"return {stops}.length") == 3
    window.run("document.activeElement.blur()")
    before = window.run(PLAYING)
    window.run("document.body.dispatchEvent(new KeyboardEvent('keydown', {key: ' ', bubbles: true}))")
    assert window.run(PLAYING) != before


def test_turning_the_view_changes_the_picture(window: Browser, pages: dict[str, Path]) -> None:
    window.open(pages["t3_spatial"], *DESK)
    window.run("stop(); slider.value = 3; show()")
    seen = window.run(SEEN)
    window.run("turn.value = 90; turn.dispatchEvent(new Event('input'))")
    assert window.run(SEEN) != seen
    spoken = window.run("return turn.getAttribute('aria-valuetext')")
    assert spoken == "90 degrees"


@pytest.mark.skipif(axe() is None, reason="needs axe-core")
def test_the_page_is_accessible(window: Browser, pages: dict[str, Path]) -> None:
    for page in pages.values():
        window.open(page, *PHONE)
        found = axe()
        assert found is not None
        window.run(found.read_text(encoding="utf-8"))
        assert window.run_async(VIOLATIONS) == []
