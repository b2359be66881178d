"""Arms in pictures: from the side with gravity downwards, and from above where they are not in a plane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.pages.style import BLUE, GREY, INK, VERMILION, WIDTH
from flexlink.results.notebook_figure import NotebookFigure as Figure

Array = NDArray[np.float64]

FLAT = 0.02
"""Part of its extent by which an arm may leave a plane that is drawn as flat."""

EMPTY = 0.06
"""Margin around what is drawn, as a part of its extent."""


class View(NamedTuple):
    """A direction to look from: the unit vectors of frame 0 that point right and up in the picture."""

    right: Array
    up: Array
    labels: tuple[str, str]

    def __call__(self, points: Array) -> tuple[Array, Array]:
        """Coordinates in the picture [m] of points (…, 3)."""
        return points @ self.right, points @ self.up


def views_of(points: Array, gravity: Array) -> list[View]:
    """From the side, across the plane in which most of the points lie; and from above, if they are not all in it."""
    size = np.linalg.norm(gravity)
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    centred = points.reshape(-1, 3) - points.reshape(-1, 3).mean(axis=0)
    level = centred - np.outer(centred @ up, up)
    across = np.linalg.svd(level, full_matrices=False)[2][0]
    across -= (across @ up) * up
    if np.linalg.norm(across) < 0.5:  # all points in one vertical line
        across = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    across = _away(across / np.linalg.norm(across), points)
    beside = np.cross(up, across)
    side = View(across, up, (f"{_named(across) or 'across'} [m]", f"{_named(up) or 'up'} [m]"))
    extent = np.ptp(centred, axis=0).max() or 1.0
    if np.ptp(centred @ beside) <= FLAT * extent:
        return [side]
    above = View(across, beside, (side.labels[0], f"{_named(beside) or 'across, from above'} [m]"))
    return [side, above]


def _away(direction: Array, points: Array) -> Array:
    """The direction or its opposite, so that the arm reaches to the right, or else along a positive axis."""
    way = (points.reshape(-1, *points.shape[-2:])[:, -1] - points.reshape(-1, *points.shape[-2:])[:, 0]).mean(axis=0)
    lean = float(way @ direction)
    if abs(lean) < 1e-6 * (np.abs(way).max() or 1.0):
        lean = float(direction[np.argmax(np.abs(direction))])
    return direction if lean >= 0 else -direction


def _named(direction: Array) -> str:
    """x, −y …: the axis of frame 0 along which a direction points; empty for any other."""
    k = int(np.argmax(np.abs(direction)))
    if abs(direction[k]) < 1 - 1e-6:
        return ""
    return f"{'' if direction[k] > 0 else '−'}{'xyz'[k]}"


def panels(views: list[View], points: Array) -> tuple[Figure, list[Axes]]:
    """A panel a view, in which these points fit at one scale."""
    boxes = []
    for view in views:
        x, y = view(_from_base(points.reshape(-1, 3)))
        margin = EMPTY * (max(np.ptp(x), np.ptp(y)) or 1.0)
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
    axes.plot(*view(_from_base(points)), color=BLUE, linewidth=2.2, zorder=2)
    axes.plot(*view(np.zeros((1, 3))), "s", color=INK, markersize=8, zorder=3, label="base")
    x, y = view(points)
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
    axes.plot(*view(_from_base(points)), color=colour, linewidth=1.0, zorder=1, label=label)


def _from_base(points: Array) -> Array:
    """With the origin of frame 0 before them, from which the first one hangs."""
    return np.concatenate([np.zeros((1, 3)), points])
