"""The five panels of the paper's figure 5, for the motion of any scene."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexlink.pages.colours import CYCLE, INK, engine_name, look_of
from flexlink.pages.style import stacked_axes
from reports.curves import curves
from reports.results import Results
from reports.tables import series_csv
from validation.store import Series

PANELS = ("active", "passive-2", "passive-3", "joint-3", "hand")  # parts of the stored series "panel", a to e
TAKES = ("panel",)
POINTS = 12  # number of points by which an engine's curve is shown
LOOK: dict[str, Any] = {
    "color": INK, "markersize": 4.5, "markerfacecolor": "none", "markeredgewidth": 0.8, "linestyle": "",
}  # fmt: skip
LEGEND = 4  # most legend entries that fit on a phone's screen


class Motion(NamedTuple):
    """Motion of a scene by panel, from flexlink and from the engines."""

    case: str
    scene: str
    native: dict[str, Series]
    engines: dict[str, dict[str, Series]]


def motions(results: Results) -> list[Motion]:
    """Every scene whose motion is stored by a case."""
    found = []
    for case, scene in dict.fromkeys((case, series.scene) for case, series in results.showing("panel")):
        by_engine: dict[str, dict[str, Series]] = {"": {}}
        stored = {(s.engine, s.part): s for s in results.series[case] if s.what == "panel" and s.scene == scene}
        for engine in sorted({engine for engine, _ in stored}):
            by_engine[engine] = {part: stored[engine, part] for part in PANELS if (engine, part) in stored}
        found.append(Motion(case, scene, by_engine.pop(""), by_engine))
    return found


def draw_tall(motion: Motion) -> Figure:
    """All panels one above the other, for a page."""
    figure, axes = stacked_axes(len(motion.native), 1.7)
    _fill(axes, motion)
    axes[-1].set_xlabel("time [s]")
    key = _key(motion)
    figure.legend(
        key.values(), key.keys(), loc="outside upper left", ncols=len(key), frameon=False, handletextpad=0.5,
        columnspacing=1.0,
    )  # fmt: skip
    return figure


def draw_wide(motion: Motion) -> Figure:
    """All panels in two rows, for the README."""
    figure = Figure(figsize=(12.0, 5.6), layout="constrained")
    axes = list(figure.subplots(2, 3, sharex=True).flat)
    _fill(axes, motion)
    for panel in axes[len(motion.native) :]:
        panel.axis("off")
        key = _key(motion, ", from the exported file")
        panel.legend(key.values(), key.keys(), loc="center", frameon=False)
    for panel in axes[2:5]:
        panel.set_xlabel("time [s]")
        panel.tick_params(labelbottom=True)
    return figure


def _key(motion: Motion, words: str = "") -> dict[str, Line2D]:
    """Legend of lines and points."""
    key = {"flexlink": Line2D([], [], color=INK)}
    for name in motion.engines:
        key[engine_name(name) + words] = Line2D([], [], marker=_marker(name), **LOOK)
    return key


def _marker(engine: str) -> str:
    look = look_of(engine)
    return look.marker if look else "o"


def _fill(axes: list[Axes], motion: Motion) -> None:
    for letter, panel, (name, series) in zip("abcde", axes, motion.native.items(), strict=False):
        entries = _entries(series)
        for curve in curves(series):
            entry = entries.index(curve.label if curve.label in entries else series.legend[curve.label])
            panel.plot(curve.x, curve.y, color=CYCLE[entry], linewidth=0.6)
        handles = [Line2D([], [], color=CYCLE[k]) for k in range(len(entries))]
        for number, (engine, others) in enumerate(motion.engines.items()):
            if name in others:
                _points(panel, others[name], number, _marker(engine))
        panel.set_title(f"{letter}) {series.title}", loc="left")
        panel.set_ylabel(series.y_label.replace("coordinate in frame 0", "position"))
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + (0.5 if len(entries) > 3 else 0.3) * (high - low))  # room for the legend
        panel.legend(
            handles, entries, loc="upper left", ncols=3 if len(entries) < 4 else 2, frameon=False,
            borderpad=0.1, labelspacing=0.2, columnspacing=1.0,
        )  # fmt: skip


def _entries(series: Series) -> list[str]:
    """Legend entries: every curve, or the shared entries of the series if the curves are more than `LEGEND`."""
    labels = [curve.label for curve in curves(series)]
    return labels if len(labels) <= LEGEND else sorted({series.legend.get(label, label) for label in labels})


def _points(panel: Axes, series: Series, number: int, marker: str) -> None:
    """Draw the points of an engine, at different times for each engine, so that they do not cover each other."""
    for curve in curves(series):
        step = max(1, len(curve.x) // POINTS)
        chosen = np.arange(number * step // 2, len(curve.x), step)
        panel.plot(curve.x[chosen], curve.y[chosen], marker=marker, **LOOK)


def caption(motion: Motion) -> str:
    """Caption of the picture."""
    who = " and ".join(engine_name(name) for name in motion.engines)
    overlay = f" Points: {who}, from the exported file, same method and step." if who else ""
    return f"Joint angles, and positions in frame 0. Lines: flexlink.{overlay}"


def data(motion: Motion) -> str:
    """Data of the picture as CSV."""
    return series_csv(*(one for part in (motion.native, *motion.engines.values()) for one in part.values()))
