"""Plots of any stored series as curves, with the labels and scales that the series contains."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from numpy.typing import NDArray

from flexlink.common.types import Array
from flexlink.pages.colours import CYCLE, MARKERS, engine_name, look_of
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes, tidy_linear, tidy_logs
from reports.tables import series_csv
from validation.store import Series

FEW = 60  # curves with fewer points are drawn with markers
MOST = 2 * len(CYCLE)  # curves in a panel: a solid and a dashed one in each colour


def legend_above(figure: Figure, axes: Axes, columns: int) -> Legend:
    """Add one legend above all panels, where it does not hide curves."""
    handles, labels = axes.get_legend_handles_labels()
    return figure.legend(
        handles, labels, loc="outside upper left", ncols=columns, frameon=False, columnspacing=1.0, handletextpad=0.5
    )


class Curve(NamedTuple):
    """One curve of a series."""

    label: str
    x: Array
    y: Array


def panels_of(series: Series) -> list[tuple[str, Series]]:
    """(value of the panel column, the series of that panel), in order of appearance.

    Without a panel column, there is one panel, ("", all), or one per quantity if it would have over `MOST` curves.
    """
    if series.panel is None:
        names = quantities(series)
        if len(names) == 1 or len(names) * len(groups(series)) <= MOST:
            return [("", series)]
        rest = {name: values for name, values in series.columns.items() if name not in names}
        return [(name, dataclasses.replace(series, columns=rest | {name: series.columns[name]})) for name in names]
    column = np.asarray(series.columns[series.panel]).astype(str)
    rest = {name: values for name, values in series.columns.items() if name != series.panel}
    return [
        (value, dataclasses.replace(series, panel=None, columns={n: v[column == value] for n, v in rest.items()}))
        for value in dict.fromkeys(column.tolist())
    ]


def quantities(series: Series) -> tuple[str, ...]:
    """Names of the numeric columns, except the horizontal one; on a logarithmic scale some value must be positive."""
    log = series.y_scale == "log"
    return tuple(
        name
        for name, values in series.columns.items()
        if name != series.x and values.dtype.kind in "iuf" and (not log or (values > 0).any())
    )


def groups(series: Series) -> list[tuple[str, NDArray[np.bool_]]]:
    """(value of the group column, rows with that value), in order of appearance; ("", all) without such a column."""
    if series.group is None:
        return [("", np.full(len(series.columns[series.x]), True))]
    column = np.asarray(series.columns[series.group]).astype(str)
    return [(value, column == value) for value in dict.fromkeys(column.tolist())]


def curves(series: Series, *wanted: str) -> Iterator[Curve]:
    """Curves of a series for each group: all numeric columns, or only `wanted`, against the horizontal column."""
    names = wanted or quantities(series)
    for group, rows in groups(series):
        for name in names:
            label = group if group and len(names) == 1 else " ".join(part for part in (group, name) if part)
            yield Curve(label, floats(series.columns[series.x][rows]), floats(series.columns[name][rows]))


def floats(column: NDArray[Any]) -> Array:
    """Convert a column to float64."""
    return np.asarray(column, dtype=np.float64)


def draw_series(axes: Axes, series: Series) -> None:
    """Draw all curves, with the labels, scales and units of the series."""
    log = series.y_scale == "log"
    for place, curve in enumerate(curves(series)):
        visible = np.isfinite(curve.y) & (curve.y > 0.0 if log else True)
        few, look = visible.sum() <= FEW, look_of(curve.label)
        colour = look.colour if look else CYCLE[place % len(CYCLE)]
        marker = look.marker if look else MARKERS[place % len(MARKERS)]
        axes.plot(
            curve.x[visible], curve.y[visible], label=engine_name(curve.label), color=colour,
            marker=marker if few else None, linestyle="-" if place < len(CYCLE) else "--",
        )  # fmt: skip
    put_labels(axes, series)


def put_labels(axes: Axes, series: Series) -> None:
    """Set the scales and labels of the series."""
    unit = "" if "[" in series.y_label else " [1]"
    axes.set(xscale=series.x_scale, yscale=series.y_scale, xlabel=series.x_label, ylabel=series.y_label + unit)
    tidy_logs(axes)
    tidy_linear(axes)


def picture(case: str, series: Series) -> Picture:
    """Figure with plain curves, for a series that no file in reports/figures/ draws."""
    found = panels_of(series)
    figure, all_axes = stacked_axes(len(found), 3.2 if len(found) == 1 else 2.3)
    for axes, (name, part) in zip(all_axes, found, strict=True):
        draw_series(axes, part)
        axes.set_title(name, loc="left")
        if axes is not all_axes[-1]:
            axes.set_xlabel("")
    if len(all_axes[0].lines) > 1:
        legend_above(figure, all_axes[0], 2)
    return Picture(f"{case}.{series.name}", series.title, figure, f"Results of the case {case}.", series_csv(series))
