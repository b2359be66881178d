"""Drawing of a film's frames with matplotlib, without the texts around the picture."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from flexlink.pages.colours import INK, PALE
from flexlink.results.pictures.captions import time_text
from flexlink.results.pictures.film import Film
from flexlink.results.pictures.legend import BASE, COLOURS, FOOT, GREY, HEAD, TRACE, Legend
from flexlink.results.pictures.projection import Projected

Image = NDArray[np.uint8]


class Drawing:
    """The picture of a film: its static parts are drawn once; moving parts are drawn over them in each frame."""

    def __init__(self, film: Film, width: int) -> None:
        dpi = 100
        self.film, self.projected = film, Projected(film)
        window = self.projected.window
        aspect = (window.top - window.bottom) / (window.right - window.left)
        self.scene_height = round(width * min(max(aspect, 0.45), 1.0))
        self.size = width, self.scene_height + HEAD + FOOT + (self.scene_height + HEAD + FOOT) % 2  # even for videos
        self.window = window.filled(self.scene_height / width)
        self.figure = Figure(figsize=(self.size[0] / dpi, self.size[1] / dpi), dpi=dpi, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes = self.figure.add_axes((0, FOOT / self.size[1], 1, self.scene_height / self.size[1]))
        self.axes.set(xlim=self.window[:2], ylim=self.window[2:], aspect="equal")
        self.axes.set_axis_off()
        legend = Legend(self.figure, self.size)
        self._clock = legend.head(film)
        legend.foot(film, self.window)
        self._still()
        self._moving()
        self.canvas.draw()
        self._ground = self.canvas.copy_from_bbox(self.figure.bbox)

    def image(self, k: int) -> Image:
        """Image of frame `k`, shape (height, width, 3)."""
        self._place(k)
        self.canvas.restore_region(self._ground)
        for artist in self._movers:
            self.figure.draw_artist(artist)
        return np.ascontiguousarray(np.asarray(self.canvas.buffer_rgba())[..., :3])

    def _still(self) -> None:
        floor = LineCollection(list(self.projected.floor[..., :2]), colors=PALE, linewidths=0.7, zorder=0)
        self.axes.add_collection(floor, autolim=False)
        half = self.projected.base_half
        self._base = Rectangle((-half, -half), 2 * half, 2 * half, color=BASE, animated=True)  # above the links
        self.axes.add_patch(self._base)

    def _moving(self) -> None:
        """Create the moving parts, from back to front."""
        film, projected = self.film, self.projected
        (self._shadow,) = self.axes.plot([], [], color="0.86", linewidth=3.0, solid_joinstyle="round", animated=True)
        (self._trace,) = self.axes.plot([], [], color=TRACE, linewidth=0.9, alpha=0.75, animated=True)
        (self._line,) = self.axes.plot([], [], color="0.45", linewidth=2.0, solid_joinstyle="round", animated=True)
        self._links = PolyCollection([], linewidths=0.6, animated=True)
        self._joints = PatchCollection([], facecolor="white", edgecolor=INK, linewidth=1.1, animated=True)
        self._ball = Circle((0.0, 0.0), projected.ball_radius or 1e-9, facecolor=GREY, edgecolor=INK, animated=True)
        self._ball.set_visible(film.outline.ball > 0)
        for collection in (self._links, self._joints):
            self.axes.add_collection(collection, autolim=False)
        self.axes.add_patch(self._ball)
        self._movers = [
            self._shadow,
            self._trace,
            self._line,
            self._links,
            self._base,
            self._joints,
            self._ball,
            self._clock,
        ]

    def _place(self, k: int) -> None:
        film, projected = self.film, self.projected
        quads, order = projected.outlines(k)
        colours = self._colours(k)[order]
        self._links.set(verts=list(quads[order]), facecolor=colours, edgecolor=colours)
        places = zip(projected.joints[k, :, :2], projected.joint_radii, strict=True)
        self._joints.set_paths([Circle(tuple(place), radius) for place, radius in places])
        self._base.set_xy(tuple(projected.base[k, :2] - projected.base_half))
        self._ball.center = tuple(projected.ball[k, :2])
        self._line.set_data(*projected.skeleton[k, :, :2].T)
        if film.view.spatial:
            self._shadow.set_data(*projected.shadow[k, :, :2].T)
        self._trace.set_data(*projected.trace[film.trace_t <= film.t[k] + 1e-12, :2].T)
        self._clock.set_text(time_text(film, k))

    def _colours(self, k: int) -> NDArray[np.float64]:
        """Colour of every span, from the mean of the values at its two ends."""
        found, spans = self.film.colouring, self.projected.spans
        values = (found.values[k, spans] + found.values[k, spans + 1]) / 2
        return np.asarray(COLOURS(values / found.largest if found.largest else np.full(len(spans), np.nan)))
