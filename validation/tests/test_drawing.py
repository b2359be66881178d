"""Figures of the study show every series once, in their order, with the numbers of the right rows."""

from itertools import pairwise
from statistics import median
from types import SimpleNamespace
from typing import Any

import pytest

from reports import appendix, curves, drawing
from reports.chapters import Makers
from reports.figures import figure, motion, physics, speed
from reports.findings import finding
from validation.judgement import judged_rows
from validation.store import Series, table
from validation.tests.studies import row


def series(name: str, y: float = 1.0, **fields: Any) -> Series:
    return Series(name, name, table(("x", "y"), [(0.0, y), (1.0, y)]), "x", "x", "y", **fields)


def test_a_long_text_fits_on_the_page_and_a_short_one_is_not_spread_over_it() -> None:
    for count in (3, 200):
        places = [text.get_position()[1] for text in appendix._text([("word", "normal")] * count).texts]
        between = {round(above - below, 9) for above, below in pairwise(places)}
        assert len(between) == 1 and max(between) <= appendix.LINE
        assert min(places) >= appendix.MARGIN - 1e-9


def test_figures_come_by_the_names_of_their_functions() -> None:
    makers = Makers()

    @makers("chapter")
    def last(_: Any) -> Any:
        yield 2

    @makers("chapter")
    def first(_: Any) -> Any:
        yield 1

    assert [one for _, one in makers.made(None)] == [1, 2]


def test_a_series_that_a_finding_takes_is_not_drawn_again(monkeypatch: pytest.MonkeyPatch) -> None:
    taken = min(finding.taken - figure.taken)
    results: Any = SimpleNamespace(series={"terms": [series(taken), series("another")]}, cases={"terms": [row()]})
    monkeypatch.setattr(figure, "made", lambda _: iter(()))
    monkeypatch.setattr(curves, "picture", lambda case, one: one.what)
    drawn: list[Any] = [one for _, one in drawing.pictures(results)]
    assert drawn == ["another"]


def test_the_data_of_a_motion_contain_every_engine() -> None:
    shown: Any = SimpleNamespace(native={"a": series("a", 1.5)}, engines={"mujoco": {"a": series("a", 2.5)}})
    found = motion.data(shown)
    assert found.count("1.5") == found.count("2.5") == 2


def test_each_panel_of_a_sweep_has_the_orders_of_its_measure(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr(physics, "_rules", lambda axes, one, orders: shown.append(orders["gauss"]))
    monkeypatch.setattr(physics, "legend_above", lambda *_: None)
    orders = {"mode 1": 4.0, "mode 2": 3.0}
    rows = [row(quantity="fitted order", value=n, varied={"measure": m, "rule": "gauss"}) for m, n in orders.items()]
    physics._sweeps([series("sweep", part=measure) for measure in orders], rows)
    assert shown == [4.0, 3.0]


def test_the_cost_of_a_step_is_the_median_over_the_runs_of_a_method() -> None:
    values = [1.0, 2.0, 5.0]
    rows = [row(quantity="cost per step", value=value, varied={"method": "RK4"}) for value in values]
    results: Any = SimpleNamespace(of_kind=lambda _: [("integrators", judged_rows(rows, {}))])
    (drawn,) = speed.cost(results)
    assert [bar.get_width() for bar in drawn.figure.axes[0].patches] == [median(values)]
