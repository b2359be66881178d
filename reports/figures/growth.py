"""Growth of rounding errors in a chaotic motion, between runs of flexlink and between flexlink and other engines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from flexlink.pages.colours import ENGINES, GREY, INK, look_of
from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes
from reports.curves import curves, put_labels
from reports.results import Results
from reports.tables import series_csv

SECTION = "trajectory"
TAKES = ("growth",)


def draw(results: Results) -> Iterator[Picture]:
    """Draw the difference up to time t on a log axis, the fitted growth, and the time up to which runs are compared."""
    for case, rows in results.of_kind("rounding_growth"):
        value = {(row.scene, row.quantity): row.value for row in rows if row.engine == "native"}
        for series in (s for s in results.series[case] if s.what in TAKES):
            scene = series.scene
            figure, (axes,) = stacked_axes(1, 3.6)
            for curve in curves(series):
                seen = curve.y > 0.0
                look = look_of(curve.label) or ENGINES["native"]
                label = look.name if look_of(curve.label) else "flexlink, different rounding"
                axes.plot(curve.x[seen], curve.y[seen], color=look.colour, label=label)
            rate, horizon = value.get((scene, "growth rate")), value.get((scene, "horizon"))
            if rate is not None and horizon is not None:
                first = next(curves(series))
                within = (first.x > 0.0) & (first.x <= horizon) & (first.y > 0.0)
                offset = np.mean(np.log(first.y[within]) - rate * first.x[within])
                axes.plot(first.x[within], np.exp(offset + rate * first.x[within]), "--", color=INK,
                          label=f"growth exp({number(rate)} t / s)")  # fmt: skip
                axes.axvline(horizon, color=GREY, linestyle=":", label=f"compared up to {number(horizon)} s")
            put_labels(axes, series)
            legend_above(figure, axes, 2)
            title = f"{scene}: growth of rounding errors"
            yield Picture(f"{case}.{series.name}", title, figure, CAPTION, series_csv(series))


CAPTION = (
    "Largest joint-angle difference up to time t. Blue: effect of rounding alone. The curve of an engine that computes "
    "the same motion follows the blue one."
)
