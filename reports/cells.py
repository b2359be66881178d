"""Maps of cells: one panel per engine side by side, one row per parameter with the range of its values."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from flexlink.common.types import Array
from flexlink.pages.colours import engine_name
from flexlink.pages.numbers import number
from flexlink.pages.style import WIDTH

ROW = 0.24  # height of a row of cells [in]
LETTERS = 7.5  # font size of row names [pt]


def panels_beside(engines: Sequence[str], rows: Sequence[str], room: float) -> tuple[Figure, list[Axes]]:
    """Figure with one panel per engine, the first with row names; `room` is the height without the rows [in]."""
    figure = Figure(figsize=(WIDTH, room + ROW * len(rows)), layout="constrained")
    axes = list(figure.subplots(1, len(engines), sharey=True, squeeze=False)[0])
    for panel, engine in zip(axes, engines, strict=True):
        panel.set_title(engine_name(engine), loc="left", fontsize=10.0)
        panel.set_xticks([])
        panel.tick_params(length=0)
        panel.grid(False)
        panel.spines[:].set_visible(False)
    axes[0].set_yticks(np.arange(len(rows)) + 0.5, rows, fontsize=LETTERS)
    axes[0].set_ylim(len(rows), 0)
    return figure, axes


def fill(axes: Axes, values: Array, colours: object, highest: float) -> object:
    """Draw each value, 0 to `highest`, as a coloured cell; cells with nan stay empty."""
    cells = np.ma.masked_invalid(values)
    return axes.pcolormesh(cells, cmap=colours, vmin=0, vmax=highest, edgecolors="w", linewidth=0.6)


def with_range(name: str, varied: Sequence[str]) -> str:
    """Name of a row with its first and last value: "density, times: 10⁻¹⁵ … 10⁶"."""
    values = [float(text.rsplit(" ", 1)[-1]) for text in varied]
    plain, unit = (found[1], found[2]) if (found := re.fullmatch(r"(.*?)( \[[^\]]*\])", name)) else (name, "")
    ends = number(values[0], 2) if len(values) == 1 else f"{number(values[0], 2)} … {number(values[-1], 2)}"
    return f"{plain}{' ×' if plain.endswith(', times') else ':'} {ends}{unit}".replace(", times ×", " ×")


def key(figure: Figure, entries: Sequence[tuple[str, str]], columns: int) -> None:
    """Add a legend of colours, given as (colour, words), above the panels."""
    handles = [Patch(facecolor=colour, label=words) for colour, words in entries]
    figure.legend(
        handles=handles, loc="outside upper left", ncols=columns, frameon=False, fontsize=10.0, handlelength=1.0,
        columnspacing=1.0,
    )  # fmt: skip
