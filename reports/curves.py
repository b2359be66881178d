"""Any stored series as curves: what it needs to be drawn, it brings along."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from reports.picture import Picture
from reports.style import CYCLE, MARKERS, legend_above, panels, tidy_logs
from validation.store import Series

Array = NDArray[np.float64]
FEW = 60  # a curve with fewer points shows them


class Curve(NamedTuple):
    """One curve of a series."""

    label: str
    x: Array
    y: Array


def groups(series: Series) -> list[tuple[str, NDArray[np.bool_]]]:
    """(value of the group column, rows that have it), in order of appearance; ("", all) without one."""
    if series.group is None:
        return [("", np.full(len(series.columns[series.x]), True))]
    column = np.asarray(series.columns[series.group]).astype(str)
    return [(value, column == value) for value in dict.fromkeys(column.tolist())]


def curves(series: Series, *wanted: str) -> Iterator[Curve]:
    """The curves of a series: its columns other than the horizontal one, or only the `wanted`, for each group."""
    names = wanted or tuple(name for name in series.columns if name not in (series.x, series.group))
    for group, rows in groups(series):
        for name in names:
            label = group if group and len(names) == 1 else " ".join(part for part in (group, name) if part)
            yield Curve(label, numbers(series.columns[series.x][rows]), numbers(series.columns[name][rows]))


def numbers(column: NDArray[Any]) -> Array:
    """A column as float64."""
    return np.asarray(column, dtype=np.float64)


def draw_series(axes: Axes, series: Series) -> None:
    """All curves with labels, scales and units as the series says."""
    log = series.y_scale == "log"
    for place, curve in enumerate(curves(series)):
        visible = np.isfinite(curve.y) & (curve.y > 0.0 if log else True)
        few = visible.sum() <= FEW
        axes.plot(
            curve.x[visible], curve.y[visible], label=curve.label, color=CYCLE[place % len(CYCLE)],
            marker=MARKERS[place % len(MARKERS)] if few else None, linestyle="-" if place < len(CYCLE) else "--",
        )  # fmt: skip
    axes.set(xscale=series.x_scale, yscale=series.y_scale, xlabel=series.x_label, ylabel=series.y_label)
    tidy_logs(axes)


def picture(case: str, series: Series) -> Picture:
    """A figure of a series that no file in reports/figures/ takes care of."""
    figure, (axes,) = panels(1, 3.2)
    draw_series(axes, series)
    if len(axes.lines) > 1:
        legend_above(figure, axes, 2)
    return Picture(f"{case}.{series.name}", figure, f"{series.title} ({case}).")
