"""What a notebook shows: a compact table of every object that is looked at, and every picture once."""

from __future__ import annotations

from collections.abc import Callable
from html.parser import HTMLParser
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from conftest import flexible, make_scene, nasty_scene

import flexlink as fl
from flexlink.advice.verdict import Advice
from flexlink.common import notebook

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
    """By the figure itself; pyplot, which would draw it a second time, does not know it."""
    figure = shown[name].plot(*([shown["chain"]] if name == "modes" else []))
    assert figure._repr_png_().startswith(b"\x89PNG")
    assert not plt.get_fignums()
    assert figure.axes[0].lines


def test_an_arm_is_drawn_where_it_is_asked_for() -> None:
    scene = SCENE.varied({"initial.joint_deg": [30.0, -20.0]})
    chain = fl.lump(scene)
    start, straight = (one.axes[0].lines[0].get_xydata() for one in (scene.plot(), chain.plot()))
    q, _ = fl.initial_state(scene, chain)
    np.testing.assert_array_equal(start, chain.plot(q).axes[0].lines[0].get_xydata())
    assert not np.allclose(start, straight)
    with pytest.raises(fl.errors.ArgumentError, match="q has shape"):
        chain.plot([0.0])


def missing(name: str) -> None:
    raise ImportError(name)


@pytest.mark.parametrize("name", ["scene", "chain", "run", "modes"])
def test_without_matplotlib_a_plot_says_what_to_install(
    shown: dict[str, Any], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    load: Callable[[str], None] = missing
    monkeypatch.setattr(notebook.importlib, "import_module", load)
    with pytest.raises(fl.errors.MissingDependencyError, match="flexlink\\[report\\]"):
        shown[name].plot(*([shown["chain"]] if name == "modes" else []))
