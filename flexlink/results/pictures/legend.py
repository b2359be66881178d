"""Texts around a picture drawn with matplotlib: name, scales, time, colour bar with unit, key."""

from __future__ import annotations

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text

from flexlink.pages.colours import BLUE, INK
from flexlink.results.pictures.captions import axes_of_frame, number, scale_bar, subtitle
from flexlink.results.pictures.colouring import STOPS, UNKNOWN
from flexlink.results.pictures.film import Film
from flexlink.results.pictures.projection import Window
from flexlink.results.pictures.view import View

GREY, BASE, TRACE = "#595d61", "#73777b", BLUE
HEAD, FOOT = 54, 80  # heights of the texts above the scene and of the legend below it [pixels]
SIDE = 14  # margin at both sides [pixels]

COLOURS = LinearSegmentedColormap.from_list("load", STOPS).with_extremes(bad=UNKNOWN)


class Legend:
    """Texts in a figure of a given width and height [pixels]."""

    def __init__(self, figure: Figure, size: tuple[int, int]) -> None:
        self.figure, self.width, self.height = figure, *size

    def head(self, film: Film) -> Text:
        """Draw name and scales; return the text field for the time, which is still empty."""
        self._text(SIDE, self.height - 10, film.name, va="top", fontsize=11, fontweight="bold", parse_math=False)
        self._text(SIDE, self.height - 31, subtitle(film), va="top", fontsize=9)
        style = {"va": "top", "ha": "right", "fontsize": 10, "family": "DejaVu Sans Mono"}
        return self._text(self.width - SIDE, self.height - 30, "", animated=True, **style)

    def foot(self, film: Film, window: Window) -> None:
        """Draw the colour bar with its unit, the scale bar and the key."""
        if film.colouring.largest:
            self._colours(film.colouring.largest, film.colouring.label)
        length, text = scale_bar(window)
        right, pixels = self.width - SIDE, length / (window.right - window.left) * self.width
        ends = [(right - pixels) / self.width, right / self.width], [66 / self.height] * 2
        style = {"color": INK, "linewidth": 1.5, "solid_capstyle": "butt", "transform": self.figure.transFigure}
        self.figure.add_artist(Line2D(*ends, **style))
        self._text(right, 50, text, ha="right")
        self._axes(film.view)
        self._key(bool(film.outline.ball))

    def _colours(self, largest: float, label: str) -> None:
        bar = self.figure.add_axes((SIDE / self.width, 60 / self.height, 0.42, 10 / self.height))
        ticks = [0.0, largest / 2, largest]
        self.figure.colorbar(ScalarMappable(Normalize(0, largest), COLOURS), cax=bar, orientation="horizontal")
        bar.set_xticks(ticks, [number(tick) for tick in ticks], fontsize=8, color=INK)
        for place, tick in zip(("left", "center", "right"), bar.get_xticklabels(), strict=True):
            tick.set_ha(place)
        bar.tick_params(length=2, pad=1)
        self._text(SIDE, 29, label)

    def _axes(self, view: View) -> None:
        """Draw the axes of frame 0 in this view, between colour bar and scale bar."""
        side, x = 54, 0.42 * self.width + SIDE + 0.2 * (0.58 * self.width - 2 * SIDE)
        place = self.figure.add_axes((x / self.width, 26 / self.height, side / self.width, side / self.height))
        place.set(xlim=(-1.8, 1.8), ylim=(-1.8, 1.8))
        place.set_axis_off()
        for name, tip in axes_of_frame(view):
            place.plot([0.0, tip[0]], [0.0, tip[1]], color=BASE, linewidth=1.0)
            place.text(
                *(1.45 * tip / max(float(np.linalg.norm(tip)), 0.6)),
                name,
                fontsize=8,
                color=GREY,
                ha="center",
                va="center",
            )

    def _key(self, payload: bool) -> None:
        words = [("■ base", BASE), ("○ joint", INK), ("● payload", GREY), ("— path of the tip", TRACE)]
        x, renderer = float(SIDE), self.figure.canvas.get_renderer()
        for text, colour in words if payload else words[:2] + words[3:]:
            shown = self._text(x, 8, text, color=colour)
            x += shown.get_window_extent(renderer).width + 12

    def _text(self, x: float, y: float, text: str, **style: object) -> Text:
        return self.figure.text(x / self.width, y / self.height, text, **{"fontsize": 8, "color": INK, **style})
