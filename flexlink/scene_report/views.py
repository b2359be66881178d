"""An arm in pictures that are true to scale."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.style import WIDTH
from flexlink.results.notebook_figure import NotebookFigure as Figure
from flexlink.results.pictures.view import View


def panels(views: list[View], points: Array) -> tuple[Figure, list[Axes]]:
    """A panel a view, in which these points fit at one scale."""
    boxes = []
    for view in views:
        x, y = view.flat(_from_base(points.reshape(-1, 3)))
        margin = 0.06 * (max(np.ptp(x), np.ptp(y)) or 1.0)
        boxes.append((x.min() - margin, x.max() + margin, y.min() - margin, y.max() + margin))
    width = max(box[1] - box[0] for box in boxes)
    heights = [min(max((box[3] - box[2]) / width, 0.18), 1.3) for box in boxes]
    figure = Figure(figsize=(WIDTH, 0.85 * WIDTH * sum(heights) + 0.75 * len(views)), layout="constrained")
    axes = figure.subplots(len(views), 1, squeeze=False, height_ratios=heights)[:, 0]
    for view, panel, box in zip(views, axes, boxes, strict=True):
        panel.set(xlim=box[:2], ylim=box[2:], xlabel=view.labels[0], ylabel=view.labels[1])
        panel.set_aspect("equal", adjustable="box")
    return figure, list(axes)


def draw_arm(axes: Axes, view: View, points: Array, chain: Chain) -> None:
    """The arm as lines between the origins of its bodies: springs are dots, driven joints rings, the tip is a star."""
    axes.plot(*view.flat(_from_base(points)), color=BLUE, linewidth=2.2, zorder=2)
    axes.plot(*view.flat(np.zeros((1, 3))), "s", color=INK, markersize=8, zorder=3, label="base")
    x, y = view.flat(points)
    hinges = [chain.body(k) for k, c in enumerate(chain.coordinates) if c.axis]
    driven = [chain.body(int(k)) for k in chain.active]
    if hinges:
        axes.plot(x[hinges], y[hinges], ".", color=INK, markersize=6, zorder=4, label="springs")
    if driven:
        ring = {"markerfacecolor": "none", "markeredgewidth": 1.8, "color": VERMILION}
        axes.plot(x[driven], y[driven], "o", markersize=9, zorder=5, label="driven joints", **ring)
    axes.plot(x[-1:], y[-1:], "*", color=INK, markersize=9, zorder=5, label="tip")


def draw_shadow(axes: Axes, view: View, points: Array, label: str | None = None, colour: str = GREY) -> None:
    """An arm as a thin line."""
    axes.plot(*view.flat(_from_base(points)), color=colour, linewidth=1.0, zorder=1, label=label)


def _from_base(points: Array) -> Array:
    """With the origin of frame 0 before them, from which the first one hangs."""
    return np.concatenate([np.zeros((1, 3)), points])
