"""Conversion of tables in time to the piecewise polynomials that the kernels read."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array


def pieces_of(name: str, times: Array, rows: Array, *, smooth: bool) -> Array:
    """Coefficients (m, order + 1, d) of a table (m, d): linear or cubic-spline pieces, constant after the last time.

    Raises
    ------
    SceneError
        The rows of the named table change by more than float64 can represent.
    """
    degree = 3 if smooth else 1
    coefficients = np.zeros((len(times), degree + 1, rows.shape[1]))
    coefficients[:, 0] = rows
    with np.errstate(over="ignore", invalid="ignore"):
        coefficients[:-1, 1] = np.diff(rows, axis=0) / np.diff(times)[:, None]
        if smooth and np.isfinite(coefficients).all():
            from scipy.interpolate import CubicSpline  # noqa: PLC0415  0.1 s that few scenes need

            coefficients[:-1] = CubicSpline(times, rows).c[::-1].transpose(1, 0, 2)
    if not np.isfinite(coefficients).all():
        raise SceneError(
            f"{name}: the change from one time to the next overflows float64; use smaller changes, or times farther "
            "apart",
            id="overflow",
        )
    return coefficients


def held_knots(times: Array) -> Array:
    """Knots of a table in which each row applies until the next time.

    Knots are rounded down by more than the rounding error of a sample's time, so a sample at a knot sees the new row.
    """
    return times * (1 - 8 * np.finfo(float).eps)
