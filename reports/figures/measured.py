"""Errors against measurements, with the validation uncertainty from data, inputs and grid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.figure import Figure

from flexlink.pages.colours import BLUE, GREY, INK, VERMILION
from flexlink.pages.picture import Picture
from flexlink.pages.style import stacked_axes
from reports.measurements import WHAT, Group, groups_of
from reports.results import Results
from reports.tables import series_csv
from validation.measured.uncertainty import COVERAGE

SECTION = "measured"
TAKES = (WHAT,)
COLOURS = {"validated to u_val": BLUE, "not validated": VERMILION, "cannot be told": GREY}
CAPTION = (
    "Points: E / D; bars: ± 2 u_val / D. Blue: validated. Orange: not validated, the bar misses zero. "
    "Grey: cannot be decided, the uncertainty is too large."
)
LINE = 0.17  # height per quantity [in]


def draw(results: Results) -> Iterator[Picture]:
    """One picture per case, with a panel per group and a line per quantity."""
    for case, series in results.showing(WHAT):
        title = results.cases[case][0].title
        found = list(groups_of(case, title, series))
        yield Picture(f"{case}.{series.name}", title, _figure(found), CAPTION, series_csv(series))


def _figure(found: Sequence[Group]) -> Figure:
    figure, panels = stacked_axes(len(found), 1.0, share=False)
    counts = [len(group.error) for group in found]
    figure.set_figheight(sum(0.75 + LINE * count for count in counts))
    panels[0].get_gridspec().set_height_ratios([0.35 / LINE + count for count in counts])
    for axes, group in zip(panels, found, strict=True):
        for k, (e, u, verdict) in enumerate(zip(group.error, group.u_val, group.columns["verdict"], strict=True)):
            colour = COLOURS[verdict]
            axes.plot([e - COVERAGE * u, e + COVERAGE * u], [k, k], color=colour, linewidth=1.2)
            axes.plot([e], [k], "o", color=colour, markersize=3)
        axes.axvline(0.0, color=INK, linewidth=0.8)
        axes.set(yticks=range(len(group.error)), yticklabels=group.columns["quantity"].tolist(), xlabel="E / D [%]")
        axes.tick_params(axis="y", labelsize=8.5)
        axes.set_ylim(len(group.error) - 0.4, -0.6)
        axes.set_title(group.name, loc="left")
        axes.grid(False, axis="y")
    return figure
