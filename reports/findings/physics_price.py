"""Cost of a lumping rule for an explicit method: the largest stable step."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
HEADS = ("rule", "largest stable RK4 step [s]", "relative to the longest", "hinges")


def find(results: Results) -> Iterator[Table]:
    """One table: rules by stable step, with the same number of hinges each."""
    found = [
        (str(row.varied["rule"]), row.value, row.varied["hinges"])
        for row in results.rows
        if row.quantity == "stable step of RK4" and row.value
    ]
    if not found:
        return
    ranked = sorted(found, key=lambda each: -each[1])
    (first, longest, _), (last, shortest, _) = ranked[0], ranked[-1]
    lines = tuple((rule, step, f"{100 * step / longest:.0f} %", hinges) for rule, step, hinges in ranked)
    yield Table(
        "physics_price",
        "Stable step of each lumping rule",
        HEADS,
        lines,
        (
            "The highest frequency of the chain, set by its shortest segments, limits the step of an explicit method. "
            f"With equal numbers of hinges (EI = ρA = L = 1), {first} allows the longest steps; {last} needs "
            f"{number(longest / shortest, 2)} times as many. Kelvin-Voigt damping shortens the stable step further, "
            "because the damping ratio of a mode increases with its frequency.",
        ),
    )
