"""What others take for an error over what flexlink takes, scene by scene: wins right of the line, losses left."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import number
from flexlink.pages.picture import Picture
from flexlink.pages.style import INK, legend_above, stacked_axes, tidy_logs
from flexlink.pages.tables import table_csv
from reports.prices import DISPLAY_NAMES, LOOKS, OURS, Price, errors, prices, works
from reports.results import Results

SECTION = "trade"
TAKES: tuple[str, ...] = ()
AIM = "error"
CAPTION = (
    "CPU time of each contestant's cheapest run with that error, over flexlink's. Left of the line flexlink is slower. "
    "Hollow: extrapolated by the method's order or its stability limit, in the contestant's favour."
)
HEADS = (
    "scene",
    "contestant",
    "its cheapest",
    "CPU time [ms]",
    "flexlink's cheapest",
    "CPU time of flexlink [ms]",
    "ratio [1]",
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture an error of the tip."""
    scenes = list(works(results))
    for error in errors(results, AIM):
        found = {series.scene: prices(results, case, series, AIM, error) for case, series in scenes}
        found = {scene: price for scene, price in found.items() if OURS in price and len(price) > 1}
        if found:
            yield _picture(error, found)


def _picture(error: float, found: dict[str, dict[str, Price]]) -> Picture:
    figure, (axes,) = stacked_axes(1, 1.3 + 0.24 * len(found))
    scenes = sorted(found, key=lambda scene: min(_ratios(found[scene]).values()))
    for who, (colour, marker) in LOOKS.items():
        places = [
            (ratio, y) for y, scene in enumerate(scenes) for w, ratio in _ratios(found[scene]).items() if w == who
        ]
        filled = [colour if not found[scenes[y]][who].remark else "none" for _, y in places]
        for k, ((ratio, y), face) in enumerate(zip(places, filled, strict=True)):
            label = DISPLAY_NAMES.get(who, who) if k == 0 else None
            axes.plot(ratio, y, marker, color=colour, markerfacecolor=face, linestyle="", label=label)
    axes.axvline(1.0, color=INK)
    axes.set(xscale="log", xlabel="CPU time / that of flexlink [1]", yticks=range(len(scenes)), yticklabels=scenes)
    axes.set_ylim(len(scenes) - 0.5, -0.5)
    tidy_logs(axes)
    legend_above(figure, axes, 3)
    title = f"What an error of the tip of {number(error)} of its motion costs others"
    return Picture(f"trade_ratios.{error:g}", title, figure, CAPTION, _csv(found))


def _ratios(price: dict[str, Price]) -> dict[str, float]:
    return {who: each.time / price[OURS].time for who, each in price.items() if who != OURS}


def _csv(found: dict[str, dict[str, Price]]) -> str:
    lines = (
        (scene, who, price[who].by, price[who].time, price[OURS].by, price[OURS].time, ratio)
        for scene, price in found.items()
        for who, ratio in _ratios(price).items()
    )
    return table_csv(HEADS, lines)
