"""Labels next to points of a figure: a label that would cover another label or too many points is left out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.transforms import Bbox
from numpy.typing import NDArray

LETTER, HEIGHT = 0.60, 1.25  # mean width of a letter and height of a line, relative to the font size
PLACES = ((0, -9), (0, 9), (1, -7), (1, 7), (-1, -7), (-1, 7), (1, 0), (-1, 0), (1, -14), (-1, 14), (1, 14), (-1, -14))
"""Candidate positions of a label: side (-1 left, 0 centred, 1 right of the point) and height above the point [pt]."""
GAP = 5.0  # distance between a point and its label [pt]
COVERED = 3  # most points that a label may cover


class Word(NamedTuple):
    """A label and the point that it names, in axes units."""

    text: str
    x: float
    y: float
    colour: str


def place_words(axes: Axes, words: Sequence[Word], points: Iterable[tuple[float, float]], size: float = 8.5) -> None:
    """Write the labels, except those that would cover another label or more than `COVERED` points.

    Call it when the axes are complete, because it computes the layout.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    figure.draw_without_rendering()  # computes positions on the page
    unit = figure.dpi / 72.0
    dots = axes.transData.transform(list(points) or np.empty((0, 2)))
    room, taken = axes.get_window_extent(), list[Bbox]()
    for word in words:
        at = axes.transData.transform((word.x, word.y))
        boxes = [(side, up, _box(at, word.text, side, up, size, unit)) for side, up in PLACES]
        free = [
            (_covered(box, dots), number, side, up, box)
            for number, (side, up, box) in enumerate(boxes)
            if not any(box.overlaps(other) for other in taken) and _inside(box, room)
        ]
        if free and (best := min(free))[0] <= COVERED:
            _, _, side, up, box = best
            taken.append(box)
            axes.annotate(
                word.text, (word.x, word.y), xytext=(side * GAP, up), textcoords="offset points", color=word.colour,
                fontsize=size, ha={-1: "right", 0: "center", 1: "left"}[side], va="center",
            )  # fmt: skip


def _box(at: NDArray[np.float64], text: str, side: int, up: int, size: float, unit: float) -> Bbox:
    width, height = LETTER * size * len(text) * unit, HEIGHT * size * unit
    left = at[0] + side * GAP * unit - {-1: width, 0: width / 2, 1: 0.0}[side]
    return Bbox.from_bounds(left, at[1] + up * unit - height / 2, width, height)


def _covered(box: Bbox, dots: NDArray[np.float64]) -> int:
    inside = (dots[:, 0] > box.x0) & (dots[:, 0] < box.x1) & (dots[:, 1] > box.y0) & (dots[:, 1] < box.y1)
    return int(inside.sum())


def _inside(box: Bbox, room: Bbox) -> bool:
    return bool(box.x0 >= room.x0 and box.x1 <= room.x1 and box.y0 >= room.y0 and box.y1 <= room.y1)
