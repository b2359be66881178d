"""CPU time of other programs relative to flexlink's at equal error, by scene; right of the line flexlink is faster."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from typing import Any

import numpy as np

from flexlink.pages.colours import GREY, INK, PAPER
from flexlink.pages.numbers import JOIN, number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import table_csv
from reports.prices import LOOKS, OURS, Price, errors, prices, works
from reports.results import Results

SECTION = "trade"
TAKES: tuple[str, ...] = ()
AIM = "error"
CAPTION = (
    "Cheapest run of each program with that error. Left of the line flexlink is slower. Hollow: extrapolated, in "
    "favour of the other program."
)
LETTERS = 74  # letters in a line of a scene's description
WRITTEN: dict[str, Any] = {
    "fontsize": 8.5, "va": "top", "bbox": {"facecolor": PAPER, "edgecolor": "none", "pad": 0.3},
}  # fmt: skip
HEIGHT, ROOM = 0.15, 0.24  # height of a line of the description, and of the marks below it [in]
HEADS = (
    "scene",
    "program",
    "its cheapest",
    "CPU time [ms]",
    "flexlink's cheapest",
    "CPU time of flexlink [ms]",
    "ratio [1]",
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture per error of the tip."""
    scenes = list(works(results))
    about = {series.scene: series.title.removeprefix(f"{series.scene}: ") for _, series in scenes}
    for error in errors(results, AIM):
        found = {series.scene: prices(results, case, series, AIM, error) for case, series in scenes}
        found = {scene: price for scene, price in found.items() if OURS in price and len(price) > 1}
        if found:
            yield _picture(error, found, about)


def _picture(error: float, found: dict[str, dict[str, Price]], about: dict[str, str]) -> Picture:
    scenes = sorted(found, key=lambda scene: min(_ratios(found[scene]).values()))
    words = {scene: textwrap.fill(_with_units(f"{scene}: {about[scene]}"), LETTERS) for scene in scenes}
    tops = np.cumsum([0.0, *(ROOM + HEIGHT * (words[scene].count("\n") + 1) for scene in scenes)])
    figure, (axes,) = stacked_axes(1, 1.2 + float(tops[-1]))
    places = dict(zip(scenes, tops[1:] - 0.4 * ROOM, strict=True))
    for who, look in LOOKS.items():
        known = [scene for scene in scenes if who != OURS and who in found[scene]]
        if known:
            axes.plot([], [], look.marker, color=look.colour, linestyle="", label=look.name)
        for scene in known:
            axes.plot(
                found[scene][who].time / found[scene][OURS].time, places[scene], look.marker, color=look.colour,
                markerfacecolor="none" if found[scene][who].remark else look.colour, linestyle="",
            )  # fmt: skip
    for scene, top in zip(scenes, tops, strict=False):
        axes.axhline(places[scene], color=GREY, linewidth=0.5, zorder=0)
        axes.text(0.012, top + 0.03, words[scene], transform=axes.get_yaxis_transform(), **WRITTEN)
    axes.axvline(1.0, color=INK, label="equal to flexlink")
    axes.set(xscale="log", xlabel="CPU time / flexlink's CPU time [1]", yticks=[], ylim=(tops[-1] + 0.1, -0.1))
    axes.grid(False, axis="y")
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    title = f"CPU time of other programs relative to flexlink's, tip error {number(error)} of the motion"
    return Picture(f"trade_ratios.{error:g}", title, figure, CAPTION, _csv(found))


def _with_units(words: str) -> str:
    """Keep numbers and their units on one line."""
    return re.sub(r"(?<=\d) (?=\w)", JOIN, words)


def _ratios(price: dict[str, Price]) -> dict[str, float]:
    return {who: each.time / price[OURS].time for who, each in price.items() if who != OURS}


def _csv(found: dict[str, dict[str, Price]]) -> str:
    lines = (
        (scene, who, price[who].by, price[who].time, price[OURS].by, price[OURS].time, ratio)
        for scene, price in found.items()
        for who, ratio in _ratios(price).items()
    )
    return table_csv(HEADS, lines)
