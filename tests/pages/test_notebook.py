"""Display in notebooks: a compact table of every object, and every picture once."""

import html
import importlib
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest

import flexlink as fl
from flexlink.advice.verdict import Advice, time
from flexlink.pages.numbers import number
from flexlink.pages.tables import table_csv
from flexlink.pages.verdict import Report, Verdict
from tests.conftest import ROOT, flexible, make_scene, nasty_scene
from tests.support.words import line, refused, reviewed

SCENE = make_scene(
    flexible("a<b>&"), flexible("c", segments=30), run=fl.RunSettings(step=1e-6, sample=1e-5, duration=1e-4)
)


class Table(HTMLParser):
    """The texts of all cells, and the depth of open tags at the end."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.cells: list[str] = []
        self.depth = 0
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.depth += 1

    def handle_endtag(self, tag: str) -> None:
        self.depth -= 1

    def handle_data(self, data: str) -> None:
        self.cells.append(data)


@pytest.fixture(scope="module")
def shown() -> dict[str, Any]:
    chain = fl.lump(SCENE)
    advice = Advice(True, SCENE, 1e-6, 1e-3, 0.1, 0.2, 0.1, None, 1.0, 3, 1.5, ("model      a < b", "steps      RK4"))
    return {
        "scene": SCENE, "chain": chain, "run": fl.simulate(SCENE), "modes": fl.modes(chain), "advice": advice,
        "comparison": fl.compare(nasty_scene(), engines=["native"], samples=2),
    }  # fmt: skip


@pytest.mark.parametrize(
    ("name", "wanted"),
    [
        ("scene", ["a<b>&", "length [m]", "test: RK4, step 1e-06 s, duration 0.0001 s"]),
        ("chain", ["a<b>&", "a<b>&.1.z", "yes", "…"]),
        ("run", ["t [s]", "imbalance [J]", "smallest", "…"]),
        ("modes", ["frequency [Hz]", "…"]),
        ("advice", ["model", "a < b", "RK4"]),
        ("comparison", ["worst joint", "ok"]),
    ],
)
def test_an_object_is_shown_as_a_compact_table(shown: dict[str, Any], name: str, wanted: list[str]) -> None:
    text = shown[name]._repr_html_()
    table = Table(text)
    assert table.depth == 0
    assert text.count("<tr>") <= 16
    assert set(wanted) <= set(table.cells)


@pytest.mark.parametrize("name", ["scene", "chain", "run", "modes"])
def test_a_picture_is_shown_once(shown: dict[str, Any], name: str) -> None:
    """The figure displays itself; pyplot does not manage it and so does not draw it a second time."""
    others = plt.get_fignums()  # close figures that other tests of this process left open
    figure = shown[name].plot(*([shown["chain"]] if name == "modes" else []))
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert plt.get_fignums() == others
    assert figure.axes[0].lines


@pytest.mark.parametrize(("name", "tag"), [("arm.gif", "<img "), ("arm.html", "<iframe ")])
def test_a_film_plays_if_its_path_is_the_value_of_a_cell(shown: dict[str, Any], name: str, tag: str, tmp_path) -> None:
    path = shown["run"].animate(tmp_path / name, width=320)
    assert path == tmp_path / name
    assert path._repr_html_().startswith(tag)
    assert str(tmp_path) not in path._repr_html_()
    path.unlink()
    assert path._repr_html_() is None, "the notebook shows the path"


def test_a_notebook_shows_the_diagnosis_of_a_comparison(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    scene = SCENE.varied({"gravity": (0.0, -9.81, 0.0)})
    file = tmp_path / "theirs.xml"
    file.write_text(fl.to_mjcf(fl.lump(scene)).replace("-9.81", "9.81"), encoding="utf-8")
    found = fl.compare(scene, file=file, samples=4)
    assert html.escape(line(found.diagnosis, "  1. "), quote=False) in found._repr_html_()


def test_rows_of_a_sweep_are_shown_as_a_table() -> None:
    mass = {"mass": {"of": "tip z [m]"}}
    rows = fl.sweep(fl.Sweep(scene=SCENE, grid={"tip.mass": [0.5, 1.5]}, quantity=mass))
    table = Table(rows._repr_html_())
    assert table.depth == 0
    assert {"2 rows, 0 failed", "0.5", "1.5"} <= set(table.cells)


def test_a_report_is_displayed_as_its_verdicts() -> None:
    found = Report(Path("page/index.html"), (Verdict("Engines", "pass", "agree", "200 states <"),), ())
    path = "page/index.html"
    assert repr(found) == f"<Report '{path}': Engines agree>"
    table = Table(found._repr_html_())
    for cell in ("Engines", "agree", "200 states <", path):
        assert cell in table.cells


def test_a_notebook_shows_the_notes_of_an_import() -> None:
    found = fl.import_urdf(ROOT / "examples" / "reach_arm.urdf")
    first = Table(found._repr_html_()).cells[0].splitlines()[0]
    assert first in str(found)
    assert "5 joints" in first and "flange" in first
    reviewed("notebook: first line of an import", first)


def test_an_arm_is_drawn_in_the_given_configuration() -> None:
    scene = SCENE.varied({"initial.joint_deg": [30.0, -20.0]})
    chain = fl.lump(scene)
    start, straight = (one.axes[0].lines[0].get_xydata() for one in (scene.plot(), chain.plot()))
    q, _ = fl.initial_state(scene, chain)
    np.testing.assert_array_equal(start, chain.plot(q).axes[0].lines[0].get_xydata())
    assert not np.allclose(start, straight)
    with refused(fl.errors.ArgumentError, "wrong-shape"):
        chain.plot([0.0])


def missing(name: str) -> None:
    raise ImportError(name)


@pytest.mark.parametrize("name", ["scene", "chain", "run", "modes"])
def test_without_matplotlib_a_plot_is_refused(shown: dict[str, Any], name: str, monkeypatch) -> None:
    load: Callable[[str], None] = missing
    monkeypatch.setattr(importlib, "import_module", load)
    with refused(fl.errors.MissingDependencyError, "package-missing"):
        shown[name].plot(*([shown["chain"]] if name == "modes" else []))


def test_numbers_rounded_to_one_more_digit_are_written_out_and_zeros_stay_in_tables() -> None:
    assert [number(999.7), number(-99.97, 2), number(9999.7, 4)] == ["1000", "−100", "10000"]
    assert (time(0.9997), time(0.9994)) == ("1 s", "999 ms")
    assert table_csv(("a", "b"), [(0.0, None), (0, False)]) == "a,b\n0.0,\n0,False\n"
