"""Figures: one colour and name per engine, labels without overlap, short captions, units on the axes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from flexlink.pages.colours import CYCLE, ENGINES, engine_name, look_of
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports import figures, full
from reports.drawing import modules, pictures
from reports.placing import Word, place_words
from reports.results import Results
from validation.store import Series, Store
from validation.tests.studies import row, stored

ROOT = Path(__file__).parents[2]
CAPTION = 160  # letters: two lines of half a page's column


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
    others = {"extreme_digits.py": 8, "legend.py": 2, "colouring.py": 8}
    for folder in ("reports", "flexlink/results", "flexlink/scene_report"):
        for path in (ROOT / folder).rglob("*.py"):
            found = re.findall(r'"#[0-9a-f]{6}"|"tab:\w+"', path.read_text(encoding="utf-8"))
            assert len(found) <= others.get(path.name, 0), path


def test_captions_take_two_lines_at_most() -> None:
    for module in modules(figures):
        for name, value in vars(module).items():
            if isinstance(value, str) and (
                name.endswith("CAPTION") or name in ("MAP", "CLOUD", "ALONE", "PAIRS", "READ")
            ):
                assert len(value) <= CAPTION, f"{module.__name__}.{name}: {len(value)} letters"


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
