"""Model needed for a given error: every link type, rule, number of hinges, method and step, and their Pareto front."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.colours import GREEN, GREY, INK, ORANGE, SKY
from flexlink.pages.picture import Picture
from flexlink.pages.style import legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import columns_csv
from reports.placing import Word, place_words
from reports.prices import Run, front, named
from reports.results import Results
from validation.store import Series

SECTION = "trade"
TAKES = ("models",)
LOOKS = {"rigid": (GREY, "s"), "T1": (ORANGE, "o"), "T2": (GREEN, "^"), "T3": (SKY, "D")}
AIM = "error"
ROOM = 0.15  # factor on the left limit of the axis, to leave room for the first label
SHOWN = 1.0  # runs with a relative error of this size or larger are not drawn
APART = 4.0  # smallest ratio of the errors of two labelled runs
CAPTION = (
    "One mark per combination of link type, hinges, rule, method and step. Line: the best ones. Vertical edge: error "
    "of a link type, whatever its hinges."
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture per scene."""
    for case, series in results.showing(*TAKES):
        many = [run for run in _runs(series) if 0.0 < run.errors[AIM] < SHOWN]
        best = front(many, AIM)
        figure, (axes,) = stacked_axes(1, 4.2)
        for who, (colour, marker) in LOOKS.items():
            if not (own := [run for run in many if run.who == who]):
                continue
            x, y = [run.errors[AIM] for run in own], [run.seconds for run in own]
            axes.plot(x, y, marker, color=colour, label=who, markersize=4.0, alpha=0.6, markeredgewidth=0)
        axes.plot([run.errors[AIM] for run in best], [run.seconds for run in best], "-", color=INK)
        axes.set(xscale="log", yscale="log", xlabel="error of the tip [1]", ylabel="CPU time [s]")
        axes.margins(0.1, 0.1)
        axes.set_xlim(ROOM * axes.get_xlim()[0])
        tidy_logs(axes)
        legend_above(figure, axes, 4)
        words = [Word(_cut(run), run.errors[AIM], run.seconds, INK) for run in named(best, AIM, APART)]
        place_words(axes, words, [(run.errors[AIM], run.seconds) for run in many])
        yield Picture(f"{case}.{series.name}", series.title, figure, CAPTION, columns_csv(series.columns))


def _cut(run: Run) -> str:
    """Link type, number of hinges and rule of a run."""
    return "rigid" if run.who == "rigid" else f"{run.who}, {run.method}"


def _runs(series: Series) -> Iterator[Run]:
    """Runs, with the link type in place of the program, and number of hinges and rule in place of the method."""
    names = ("type", "rule", "hinges", "setting", "error", "CPU time [s]")
    for flex, rule, hinges, setting, error, seconds in zip(*(series.columns[n].tolist() for n in names), strict=True):
        yield Run(flex, f"{hinges} {rule}", setting, seconds, 0, {AIM: error})
