"""Texts in the pictures of a film; these texts are the same in all formats."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexlink.results.pictures.film import Film
from flexlink.results.pictures.projection import Window, nice
from flexlink.results.pictures.view import View


def subtitle(film: Film) -> str:
    """Magnification of the deflections, and speed of the film."""
    scale = "deflections true to scale" if film.magnify == 1 else f"deflections × {film.magnify:g}"
    return scale + ("" if film.speed == 1 else f", time × {film.speed:g}")


def time_text(film: Film, k: int) -> str:
    """Time of a frame, with enough digits to distinguish it from the next one."""
    return f"t = {film.t[k]:.{digits_of_time(film)}f} s"


def digits_of_time(film: Film) -> int:
    """Number of decimals that distinguish consecutive frames."""
    return min(max(math.ceil(-math.log10(film.speed / film.fps) - 1e-9), 0), 9)


def number(value: float) -> str:
    """Format a number with up to three significant digits, as briefly as possible."""
    return f"{value:.3g}" if value == 0 or 1e-3 <= abs(value) < 1e4 else f"{value:.2e}"


def scale_bar(window: Window) -> tuple[float, str]:
    """Length of the scale bar [m], a round number of about a fifth of the window's width, and its label."""
    length = nice((window.right - window.left) / 8)
    for unit, metres in (("km", 1e3), ("m", 1.0), ("mm", 1e-3), ("µm", 1e-6)):
        if length >= 0.1 * metres or unit == "µm":
            return length, f"{length / metres:g} {unit}"
    raise AssertionError


def axes_of_frame(view: View) -> list[tuple[str, NDArray[np.float64]]]:
    """Axes of frame 0 that are not seen end on, with their direction in the picture."""
    found = [(name, view(axis)[:2]) for name, axis in zip("xyz", np.eye(3), strict=True)]
    return [(name, tip) for name, tip in found if np.linalg.norm(tip) > 0.05]
