"""Error of each run and its parts on a logarithmic axis: one panel per scene, one line per run."""

from __future__ import annotations

from collections.abc import Iterator

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flexlink.pages.colours import BLUE, GREEN, GREY, INK, ORANGE, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import WIDTH, legend_above, tidy_logs
from reports.curves import floats
from reports.results import Results
from reports.tables import series_csv
from validation.store import Series

SECTION = "errors"
TAKES = ("errors",)
LOOKS = {
    "model": (VERMILION, "s"), "space": (BLUE, "o"), "time": (ORANGE, "^"), "rounding": (GREEN, "D"),
    "total": (INK, "|"),
}  # fmt: skip
CAPTION = (
    "Largest tip error and its parts: link type (model), hinges (space), steps (time), rounding. Reduce the rightmost "
    "part first."
)
LINE = 0.5  # height per run [in]


def draw(results: Results) -> Iterator[Picture]:
    """One picture with all scenes."""
    found = [series for _, series in results.showing(*TAKES)]
    if not found:
        return
    lengths = [len(series.columns["run"]) for series in found]
    figure = Figure(figsize=(WIDTH, LINE * sum(lengths) + 0.6 * len(found) + 0.7), layout="constrained")
    panels = figure.subplots(len(found), 1, sharex=True, squeeze=False, height_ratios=lengths)[:, 0]
    for axes, series in zip(panels, found, strict=True):
        _fill(axes, series)
    left, right = panels[-1].get_xlim()
    panels[-1].set(xlabel="tip error [m]", xlim=(0.3 * left, right))  # room for the first tick label
    legend_above(figure, panels[0], 3)
    yield Picture("errors_split.parts", "Where the error of a run comes from", figure, CAPTION, series_csv(*found))


def _fill(axes: Axes, series: Series) -> None:
    runs = series.columns["run"].tolist()
    for part, (colour, marker) in LOOKS.items():
        sizes = floats(series.columns[part])
        places = [k for k, size in enumerate(sizes) if size > 0.0]
        size = 16.0 if part == "total" else 7.0
        axes.plot(sizes[places], places, marker, color=colour, label=part, markersize=size, linestyle="none")
    for k, run in enumerate(runs):
        axes.axhline(k, color=GREY, linewidth=0.6, zorder=0)
        axes.text(0.0, k - 0.22, run, transform=axes.get_yaxis_transform(), fontsize=9.5, va="bottom")
    axes.set(xscale="log", yticks=[], ylim=(len(runs) - 0.6, -0.8))
    axes.grid(False, axis="y")
    axes.set_title(series.title, loc="left")
    tidy_logs(axes)
