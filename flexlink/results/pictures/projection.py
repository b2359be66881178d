"""Projection of the arm into the picture: its links from far to near, a window around them, and texts beside them."""

import functools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.common.types import Array, Indices
from flexlink.results.pictures.film import Film
from flexlink.results.pictures.view import View, level

AROUND = 0.06  # margin around the arm, relative to the window's size
JOINT, BASE = 1.15, 1.3  # joint radius relative to half the link's width; half the base's side relative to that radius


class Window(NamedTuple):
    """Part of the picture plane that is shown [m]."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def size(self) -> float:
        """The longer side [m]."""
        return max(self.right - self.left, self.top - self.bottom)

    def filled(self, aspect: float) -> "Window":
        """The smallest window around this one whose height is `aspect` times its width."""
        width, height = self.right - self.left, self.top - self.bottom
        wide, tall = max(width, height / aspect), max(height, width * aspect)
        x, y = (self.left + self.right) / 2, (self.bottom + self.top) / 2
        return Window(x - wide / 2, x + wide / 2, y - tall / 2, y + tall / 2)


class Projected:
    """A film projected in its view; all lengths are in m in the picture plane."""

    def __init__(self, film: Film, also: Array | None = None) -> None:
        self.film, self.view = film, film.view
        self.also = np.zeros((0, 3)) if also is None else self.view(also)
        self.points = self.view(film.points)  # (f, s, 3): right, up, depth
        self.joints = self.view(film.p[:, film.outline.joints])
        self.ball, self.trace = self.view(film.ball), self.view(film.trace)
        self.base = self.view(film.p[:, film.outline.base])

    @functools.cached_property
    def window(self) -> Window:
        """Window around the arm at all times, including its widths and a margin."""
        parts = [self.points, self.joints, self.ball, self.trace, self.also, self.view(self.film.bodies)]
        found = np.concatenate([part.reshape(-1, 3)[:, :2] for part in parts])
        if self.view.spatial:
            found = np.concatenate([found, self.floor.reshape(-1, 3)[:, :2]])
        low, high = found.min(axis=0) - thickest(self.film), found.max(axis=0) + thickest(self.film)
        room = AROUND * max(float((high - low).max()), 1e-9)
        return Window(low[0] - room, high[0] + room, low[1] - room, high[1] + room)

    @functools.cached_property
    def floor(self) -> Array:
        """Lines of a level grid below the arm, shape (lines, 2, 3), in the view; none for a planar arm."""
        return self.view(floor_of(self.film)) if self.view.spatial else np.zeros((0, 2, 3))

    @functools.cached_property
    def shadow(self) -> Array:
        """Vertical projection of the arm's line onto the floor, shape (f, b + s, 3), in the view."""
        return self.view(dropped(self.skeleton_points, self.view, floor_level(self.film)))

    @property
    def skeleton_points(self) -> Array:
        """The arm's line, drawn where links have no section, in frame 0, (f, m, 3), with nan between separate lines."""
        film = self.film
        every = np.concatenate([film.p, film.points, film.rails, np.full_like(film.p[:, :1], np.nan)], axis=1)
        every = every[:, film.outline.order]
        return np.concatenate([every, film.ball[:, None]], axis=1) if film.outline.ball else every

    @functools.cached_property
    def skeleton(self) -> Array:
        """The `skeleton_points` in the view."""
        return self.view(self.skeleton_points)

    @functools.cached_property
    def thinnest(self) -> tuple[float, float]:
        """Smallest visible half width of a link, and smallest visible radius of a ball [m]."""
        return 0.0022 * self.window.size, 0.010 * self.window.size

    @functools.cached_property
    def spans(self) -> NDArray[np.intp]:
        """Indices of the stations that are followed by another station of the same link."""
        return np.flatnonzero(np.diff(self.film.outline.link) == 0)

    def outlines(self, k: int) -> tuple[Array, NDArray[np.intp]]:
        """Four corners of every span of the links in frame `k`, shape (spans, 4, 2), and their order from far to near.

        Half the visible width of a section is |y·e| a + |z·e| b, where e is the direction in the picture perpendicular
        to the arm's line. Adjacent spans share corners.
        """
        P, spans, outline = self.points[k], self.spans, self.film.outline
        e = _normals(P[:, :2], outline.link)
        seen = np.abs(np.einsum("sai,si->sa", self.view(self.film.axes[k])[..., :2], e))
        half = np.where(outline.round, outline.across[:, 0], (seen * outline.across).sum(axis=1))
        across = np.maximum(half, self.thinnest[0])[:, None] * e  # from the line of the arm to its edge, at stations
        left, right = P[:, :2] + across, P[:, :2] - across
        quads = np.stack([left[spans], left[spans + 1], right[spans + 1], right[spans]], axis=1)
        return quads, np.argsort(P[spans, 2] + P[spans + 1, 2], kind="stable")

    @functools.cached_property
    def joint_radii(self) -> Array:
        """Radius of every driven joint [m]: slightly more than half its link's width, and at least visible."""
        outline, found = self.film.outline, []
        for body in outline.joints:
            here = outline.across[outline.body == body]
            found.append(JOINT * float(here[0].max()) if len(here) else 0.0)
        return np.maximum(found, self.thinnest[1])

    @property
    def base_half(self) -> float:
        """Half the side length of the square that shows the base, which is larger than the joint on it."""
        return BASE * max(self.thinnest[1], float(self.joint_radii[0]) if len(self.joint_radii) else 0.0)

    @property
    def ball_radius(self) -> float:
        """Radius of the payload's ball; 0 without a payload."""
        return max(self.film.outline.ball, 1.3 * self.thinnest[1]) if self.film.outline.ball else 0.0


def _normals(P: Array, link: Indices) -> Array:
    """Unit vectors across a line of points, (s, 2), each normal to the mean direction of the two adjacent segments."""
    steps = np.diff(P, axis=0, append=P[-1:])
    steps[:-1][np.diff(link) != 0] = 0.0
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    unit = np.divide(steps, lengths, out=np.zeros_like(steps), where=lengths > 0)
    unit[1:] += np.where((np.diff(link) == 0)[:, None], unit[:-1].copy(), 0.0)
    turned = np.column_stack([-unit[:, 1], unit[:, 0]])
    lengths = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.asarray(np.divide(turned, lengths, out=np.tile([0.0, 1.0], (len(P), 1)), where=lengths > 1e-9))


def thickest(film: Film) -> float:
    """Largest distance from the line or centre of a link, joint, base or payload to its edge or corner [m]."""
    return max(float(film.outline.across.max(initial=0.0)) * 2**0.5 * JOINT * BASE, film.outline.ball)


def floor_level(film: Film) -> float:
    """Height of the floor [m], slightly below the lowest point of the arm during the film."""
    heights = np.concatenate([(part @ film.view.vertical).ravel() for part in (film.points, film.bodies, film.ball)])
    return float(heights.min()) - thickest(film) - 0.02 * film.reach


def dropped(points: Array, view: View, level: float) -> Array:
    """Vertical projections of these points onto the horizontal plane at height `level` [m]."""
    v = view.vertical
    return np.asarray(points + (level - points @ v)[..., None] * v)


def floor_of(film: Film) -> Array:
    """Lines of the floor's grid in frame 0, shape (lines, 2, 3), spaced by a round number."""
    v = film.view.vertical
    a = np.array([level(v), np.cross(v, level(v))])
    flat = np.concatenate([film.points.reshape(-1, 3), film.bodies.reshape(-1, 3)]) @ a.T
    step = nice(float(np.ptp(flat, axis=0).max()) / 5)
    low, high = np.floor(flat.min(axis=0) / step), np.ceil(flat.max(axis=0) / step)
    corner = floor_level(film) * v
    lines = []
    for across, along in ((0, 1), (1, 0)):
        for k in np.arange(low[across], high[across] + 1):
            lines.append([step * (k * a[across] + m * a[along]) + corner for m in (low[along], high[along])])
    return np.array(lines)


def nice(length: float) -> float:
    """Smallest of the numbers 1, 2, 5 × 10ⁿ, n any integer, that is at least `length`."""
    power = 10.0 ** np.floor(np.log10(max(length, 1e-12)))
    return float(next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= length * (1 - 1e-9)))


def subtitle(film: Film) -> str:
    """Magnification of the deflections, and speed of the film."""
    scale = "deflections true to scale" if film.magnify == 1 else f"deflections × {film.magnify:g}"
    return scale + ("" if film.speed == 1 else f", time × {film.speed:g}")


def digits_of_time(film: Film) -> int:
    """Number of decimals that distinguish consecutive frames."""
    return min(max(math.ceil(-math.log10(film.speed / film.fps) - 1e-9), 0), 9)


def number(value: float) -> str:
    """Format a number with up to three significant digits, as briefly as possible."""
    return f"{value:.3g}" if value == 0 or 1e-3 <= abs(value) < 1e4 else f"{value:.2e}"


def scale_bar(window: Window) -> tuple[float, str]:
    """Length of the scale bar [m], a round number of about a fifth of the window's width, and its label."""
    length = nice((window.right - window.left) / 8)
    units = (("km", 1e3), ("m", 1.0), ("mm", 1e-3))
    unit, metres = next((one for one in units if length >= 0.1 * one[1]), ("µm", 1e-6))
    return length, f"{length / metres:g} {unit}"


def axes_of_frame(view: View) -> list[tuple[str, NDArray[np.float64]]]:
    """Axes of frame 0 that are not seen end on, with their direction in the picture."""
    found = [(name, view(axis)[:2]) for name, axis in zip("xyz", np.eye(3), strict=True)]
    return [(name, tip) for name, tip in found if np.linalg.norm(tip) > 0.05]
