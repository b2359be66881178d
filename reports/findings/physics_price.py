"""What a rule costs an explicit method: the largest stable step, and the work for a first mode within a bar."""

from __future__ import annotations

from collections.abc import Iterator

from reports.finding import Finding
from reports.numbers import number
from reports.results import Results

SECTION = "physics"
HEADS = ("rule", "largest stable RK4 step [s]", "of the longest", "chain")


def find(results: Results) -> Iterator[Finding]:
    """One table: the rules by stable step, with the same number of hinges each."""
    steps = {row.setting: row.value for row in results.rows if row.quantity == "stable step of RK4" and row.value}
    if not steps:
        return
    longest = max(steps.values())
    ranked = sorted(steps, key=lambda setting: -steps[setting])
    lines = tuple(
        (
            setting.partition(", ")[0],
            steps[setting],
            f"{100 * steps[setting] / longest:.0f} %",
            setting.partition(", ")[2],
        )
        for setting in ranked
    )
    first, last = (setting.partition(", ")[0] for setting in (ranked[0], ranked[-1]))
    yield Finding(
        "physics_price",
        "The price of a rule",
        (
            "An explicit method must follow the highest frequency of the chain, which its shortest segments set. "
            f"With as many hinges each (EI = ρA = L = 1), {first} allows the longest steps, and {last} takes "
            f"{number(longest / steps[ranked[-1]], 2)} times as many. Kelvin-Voigt damping shrinks them further, since "
            "the damping ratio of a mode grows with its frequency.",
        ),
        HEADS,
        lines,
    )
