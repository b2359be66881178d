"""What a rule costs an explicit method: the largest stable step, and the work for a first mode within a limit."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
HEADS = ("rule", "largest stable RK4 step [s]", "of the longest", "hinges")


def find(results: Results) -> Iterator[Table]:
    """One table: the rules by stable step, with the same number of hinges each."""
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
            "An explicit method must follow the highest frequency of the chain, which its shortest segments set. "
            f"With equal numbers of hinges (EI = ρA = L = 1), {first} allows the longest steps; {last} takes "
            f"{number(longest / shortest, 2)} times as many. Kelvin-Voigt damping shortens steps further, because "
            "the damping ratio of a mode grows with its frequency.",
        ),
    )
