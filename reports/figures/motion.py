"""Motions in the panels of the paper's figure 5, and the paper's arm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from flexlink.common.types import Array
from flexlink.pages.colours import CYCLE, GREY, INK, VERMILION, engine_name, look_of
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, colour_along, stacked_axes
from flexlink.pages.tables import table_csv
from reports.curves import curves, floats
from reports.figures import figure
from reports.results import Results
from reports.tables import series_csv
from validation.store import Series


@figure("trajectory", "panel")
def motion(results: Results) -> Iterator[Picture]:
    """Motion of every scene except the paper's, in the panels of the paper's figure 5.

    Up to five panels per scene.
    """
    for motion in motions(results):
        if motion.scene not in SCENES:
            name, title = f"{motion.case}.{motion.scene}", f"{motion.scene}: motion"
            yield Picture(name, title, draw_tall(motion), caption(motion), data(motion))


SCENES = {"paper_fig5": "hanging arm", "paper_fig5_raised": "raised arm"}


@figure("figure5", "panel")
def paper_fig5(results: Results) -> Iterator[Picture]:
    """Figure 5 of the paper, in both readings of its initial angle.

    Five panels per reading.
    """
    for motion in _found(results):
        title = f"Figure 5 of the paper, {SCENES[motion.scene]}"
        yield Picture(f"figure5.{motion.scene}", title, draw_tall(motion), caption(motion), data(motion))


def readme(results: Results) -> Picture | None:
    """Figure for the README, with the first reading of the initial angle."""
    for motion in _found(results):
        return Picture("readme", "Figure 5 of the paper", draw_wide(motion), caption(motion), data(motion))
    return None


def _found(results: Results) -> list[Motion]:
    return sorted((m for m in motions(results) if m.scene in SCENES), key=lambda m: list(SCENES).index(m.scene))


ELBOW, HAND = "joint-3", "hand"
READINGS = {
    "paper_fig5": "hanging 10° from the vertical (scene paper_fig5)",
    "paper_fig5_raised": "10° from upright (scene paper_fig5_raised, the other reading of the paper's angle)",
}
"""Initial configuration by scene; the first scene in the study is drawn."""
UNTIL = 1.0  # end of the picture's interval [s]
POSTURES = 6  # configurations drawn in this interval
CAPTION = "Two flexible links of 1.25 m each fall from rest, {}. Colours from light to dark: times from 0 to 1 s."
TITLE = "The arm of the paper's figure 5"


@figure("summary")
def arm(results: Results) -> Iterator[Picture]:
    """Picture for the first screen: the arm of the paper's figure 5 during the first second of its fall.

    One picture.
    """
    found = {motion.scene: motion for motion in motions(results) if _is_in_space(motion)}
    yield from (_arm_picture(found[scene]) for scene in [scene for scene in READINGS if scene in found][:1])


def _is_in_space(motion: Motion) -> bool:
    return all(part in motion.native and {"x", "z"} <= set(motion.native[part].columns) for part in (ELBOW, HAND))


def _arm_picture(motion: Motion) -> Picture:
    time, elbow = _path(motion, ELBOW)
    _, hand = _path(motion, HAND)
    end = int(np.searchsorted(time, UNTIL, side="right"))
    chosen = np.unique(np.linspace(0, max(end - 1, 0), POSTURES).astype(int))
    figure = Figure(figsize=(0.5 * WIDTH, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(hand[:end, 0], hand[:end, 1], color=GREY, linewidth=0.8)
    for k, part in zip(chosen, np.linspace(0.0, 1.0, len(chosen)), strict=True):
        joints = np.array([(0.0, 0.0), elbow[k], hand[k]])
        axes.plot(*joints.T, color=colour_along(part), linewidth=2.4, solid_capstyle="round")
        axes.plot(*joints[1:2].T, "o", color=VERMILION, markersize=5)
    axes.plot(0.0, 0.0, "s", color=INK, markersize=9)
    axes.plot(0.0, 0.0, "o", color=VERMILION, markersize=5)
    axes.set(xlabel="x [m]", ylabel="z, downwards [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    ring = {"marker": "o", "color": VERMILION, "linestyle": ""}
    key = {
        "flexible link": Line2D([], [], color=colour_along(1.0), linewidth=2.4), "free joint": Line2D([], [], **ring),
        "path of the hand": Line2D([], [], color=GREY, linewidth=0.8),
    }  # fmt: skip
    figure.legend(key.values(), key.keys(), loc="outside upper left", frameon=False)
    lines = [(float(time[k]), *elbow[k].tolist(), *hand[k].tolist()) for k in range(end)]
    heads = ("time [s]", "elbow x [m]", "elbow z [m]", "hand x [m]", "hand z [m]")
    return Picture("arm", TITLE, figure, CAPTION.format(READINGS[motion.scene]), table_csv(heads, lines))


def _path(motion: Motion, part: str) -> tuple[Array, Array]:
    """Times, and the coordinates x and z of a point at each time."""
    columns = motion.native[part].columns
    return floats(columns["time [s]"]), np.column_stack([floats(columns[axis]) for axis in "xz"])


PANELS = ("active", "passive-2", "passive-3", "joint-3", "hand")  # parts of the stored series "panel", a to e
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
    overlay = f" Points: {who}, which load the exported file and use the same method and step." if who else ""
    return f"Joint angles, and positions in frame 0. Lines: flexlink.{overlay}"


def data(motion: Motion) -> str:
    """Data of the picture as CSV."""
    return series_csv(*(one for part in (motion.native, *motion.engines.values()) for one in part.values()))
