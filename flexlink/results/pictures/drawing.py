"""Drawing of a film's frames with matplotlib, without the texts around the picture."""

from collections.abc import Sequence

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PatchCollection, PolyCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.text import Text
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.colours import BLUE, INK, PALE
from flexlink.results.pictures import projection
from flexlink.results.pictures.colouring import STOPS, UNKNOWN
from flexlink.results.pictures.film import Film
from flexlink.results.pictures.projection import Projected, Window
from flexlink.results.pictures.view import View

Image = NDArray[np.uint8]
GREY, BASE, TRACE = "#595d61", "#73777b", BLUE


class Drawing:
    """The picture of a film: its static parts are drawn once; moving parts are drawn over them in each frame."""

    marks: Sequence[tuple[str, str]] = (("■ base", BASE), ("○ joint", INK))

    def __init__(self, film: Film, width: int, also: Array | None = None) -> None:
        """`also` are points in frame 0, shape (…, 3) [m], which the picture shows besides the arm."""
        dpi = 100
        self.film, self.projected = film, Projected(film, also)
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
        legend.foot(film, self.window, self.marks)
        floor = LineCollection(list(self.projected.floor[..., :2]), colors=PALE, linewidths=0.7, zorder=0)
        self.axes.add_collection(floor, autolim=False)
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

    def _moving(self) -> None:
        """Create the moving parts, from back to front."""
        (self._shadow,) = self.axes.plot([], [], color="0.86", linewidth=3.0, solid_joinstyle="round", animated=True)
        (self._trace,) = self.axes.plot([], [], color=TRACE, linewidth=0.9, alpha=0.75, animated=True)
        behind, before = self._arm()
        self._movers = self._shadow, *behind, self._trace, *before, self._clock

    def _arm(self) -> tuple[tuple[Artist, ...], tuple[Artist, ...]]:
        """Create the parts of the arm behind and before the path of its tip."""
        film, projected, half = self.film, self.projected, self.projected.base_half
        self._base = Rectangle((-half, -half), 2 * half, 2 * half, color=BASE, animated=True)  # above the links
        self.axes.add_patch(self._base)
        (self._line,) = self.axes.plot([], [], color="0.45", linewidth=2.0, solid_joinstyle="round", animated=True)
        self._links = PolyCollection([], linewidths=0.6, animated=True)
        self._joints = PatchCollection([], facecolor="white", edgecolor=INK, linewidth=1.1, animated=True)
        self._ball = Circle((0.0, 0.0), projected.ball_radius or 1e-9, facecolor=GREY, edgecolor=INK, animated=True)
        self._ball.set_visible(film.outline.ball > 0)
        for collection in (self._links, self._joints):
            self.axes.add_collection(collection, autolim=False)
        self.axes.add_patch(self._ball)
        return (), (self._line, self._links, self._base, self._joints, self._ball)

    def _place(self, k: int) -> None:
        film, projected = self.film, self.projected
        self._place_arm(k)
        if film.view.spatial:
            self._shadow.set_data(*projected.shadow[k, :, :2].T)
        self._trace.set_data(*projected.trace[film.trace_t <= film.t[k] + 1e-12, :2].T)
        self._clock.set_text(f"t = {film.t[k]:.{projection.digits_of_time(film)}f} s")

    def _place_arm(self, k: int) -> None:
        film, projected = self.film, self.projected
        quads, order = projected.outlines(k)
        colours = colours_of(film, projected.spans, k)[order]
        self._links.set(verts=list(quads[order]), facecolor=colours, edgecolor=colours)
        places = zip(projected.joints[k, :, :2], projected.joint_radii, strict=True)
        self._joints.set_paths([Circle(tuple(place), radius) for place, radius in places])
        self._base.set_xy(tuple(projected.base[k, :2] - projected.base_half))
        self._ball.center = tuple(projected.ball[k, :2])
        self._line.set_data(*projected.skeleton[k, :, :2].T)


def colours_of(film: Film, spans: NDArray[np.intp], k: int) -> NDArray[np.float64]:
    """Colours (spans, 4) of the spans of the links in frame `k`, from the mean of the values at their two ends."""
    found = film.colouring
    values = (found.values[k, spans] + found.values[k, spans + 1]) / 2
    return np.asarray(COLOURS(values / found.largest if found.largest else np.full(len(spans), np.nan)))


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
        self._text(SIDE, self.height - 31, projection.subtitle(film), va="top", fontsize=9)
        style = {"va": "top", "ha": "right", "fontsize": 10, "family": "DejaVu Sans Mono"}
        return self._text(self.width - SIDE, self.height - 30, "", animated=True, **style)

    def foot(self, film: Film, window: Window, marks: Sequence[tuple[str, str]]) -> None:
        """Draw the colour bar with its unit, the scale bar and the key."""
        if film.colouring.largest:
            self._colours(film.colouring.largest, film.colouring.label)
        length, text = projection.scale_bar(window)
        right, pixels = self.width - SIDE, length / (window.right - window.left) * self.width
        ends = [(right - pixels) / self.width, right / self.width], [66 / self.height] * 2
        style = {"color": INK, "linewidth": 1.5, "solid_capstyle": "butt", "transform": self.figure.transFigure}
        self.figure.add_artist(Line2D(*ends, **style))
        self._text(right, 50, text, ha="right")
        self._axes(film.view)
        self._key([*marks, *[("● payload", GREY)] * bool(film.outline.ball), ("— path of the tip", TRACE)])

    def _colours(self, largest: float, label: str) -> None:
        bar = self.figure.add_axes((SIDE / self.width, 60 / self.height, 0.42, 10 / self.height))
        ticks = [0.0, largest / 2, largest]
        self.figure.colorbar(ScalarMappable(Normalize(0, largest), COLOURS), cax=bar, orientation="horizontal")
        bar.set_xticks(ticks, [projection.number(tick) for tick in ticks], fontsize=8, color=INK)
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
        for name, tip in projection.axes_of_frame(view):
            place.plot([0.0, tip[0]], [0.0, tip[1]], color=BASE, linewidth=1.0)
            beyond = 1.45 * tip / max(float(np.linalg.norm(tip)), 0.6)
            place.text(*beyond, name, fontsize=8, color=GREY, ha="center", va="center")

    def _key(self, marks: Sequence[tuple[str, str]]) -> None:
        x, renderer = float(SIDE), self.figure.canvas.get_renderer()
        for text, colour in marks:
            x += self._text(x, 8, text, color=colour).get_window_extent(renderer).width + 12

    def _text(self, x: float, y: float, text: str, **style: object) -> Text:
        return self.figure.text(x / self.width, y / self.height, text, **{"fontsize": 8, "color": INK, **style})
