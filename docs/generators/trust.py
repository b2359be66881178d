"""Comparison of the model with measured arms, for the page on how far a prediction can be trusted."""

from __future__ import annotations

import functools
from pathlib import Path

from matplotlib.figure import Figure

from flexlink.pages.colours import BLUE, GREY, VERMILION
from reports.measurements import Group, expectation, groups_of, table
from validation.case import load_cases
from validation.measured import stored
from validation.store import Series

CASES = (
    "measured_rotating_beam", "measured_pazy_wing", "measured_steel_cantilever", "measured_strip_on_flange",
    "measured_laboratory_ringing",
)  # fmt: skip


@functools.cache
def groups() -> tuple[Group, ...]:
    """Groups of quantities of all measured cases, as stored; the study compares what it measures with them."""
    found = {case.name: case.title for case in load_cases(*CASES)}
    return tuple(
        group
        for name in CASES
        for group in groups_of(name, found[name], Series("measured", "", stored.columns(name), "quantity", "", "E"))
    )


def sentences() -> str:
    """What to expect, as on the first screen of the report, one sentence a line."""
    return "\n".join(f"- {each}." for each in expectation(groups()).removesuffix(".").split(". "))


def lines() -> str:
    """The table of the report's first screen, in Markdown."""
    found = table(groups())
    assert found is not None
    rows = [found.heads, ["---"] * len(found.heads), *([_cell(each) for each in line] for line in found.lines)]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _cell(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def errors(path: str | Path) -> None:
    """Draw E / D of all decided quantities, nothing fitted and held out, a row for each group."""
    shown = [group for group in groups() if group.name != "damping"]  # an error of −68 % would hide all others
    figure = Figure(figsize=(7, 0.45 * len(shown) + 1), layout="constrained")
    axes = figure.subplots()
    for row, group in enumerate(shown):
        for line, up, colour in ((group.free, -0.15, VERMILION), (group.held_out, 0.15, BLUE)):
            axes.plot(line.error, [row + up] * len(line.error), "o", color=colour, markersize=4, alpha=0.6)
    axes.plot([], [], "o", color=VERMILION, label="nothing fitted")
    axes.plot([], [], "o", color=BLUE, label="one number fitted to the other half")
    axes.axvline(0.0, color=GREY, linewidth=0.8)
    names = [f"{group.title}: {group.name}" for group in shown]
    axes.set(yticks=range(len(shown)), yticklabels=names, xlabel="E / D [%]", ylim=(len(shown) - 0.5, -0.5))
    axes.legend(loc="lower right")
    figure.savefig(path)


def group(case: str, name: str) -> Group:
    """One group, for the checks of the page."""
    (found,) = (each for each in groups() if (each.case, each.name) == (case, name))
    return found
