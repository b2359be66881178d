"""Display names for stored quantities and verdicts; stored names cannot change, because they identify results."""

from __future__ import annotations

DISPLAYED = {
    "RK4 / rival": "RK4 / other method",
    "advice over naive cost": "cost of the advice / cost of a naive run",
    "advice's time over naive cost": "time of the advice / cost of a naive run",
    "apart": "difference",
    "cannot be told": "cannot be decided",
    "cells judged": "cells with a known true error",
    "coarser chain apart": "tip difference of a coarser chain",
    "cost over the grid's cheapest": "cost / cheapest cost of the grid",
    "dear": "too expensive",
    "error, beside": "refused, warned or diverged, other engine",
    "false doubt": "unnecessary warning",
    "hinges not enough": "insufficient hinges",
    "horizon over a third's, smallest": "horizon / horizon of a third of the tolerance, smallest",
    "judged": "with a known true error",
    "members a second": "members per second",
    "met, but is not": "reported as met, but not met",
    "naive over advised cost": "naive cost / advised cost",
    "near": "within 10 tolerances",
    "not once": "members without exactly one row",
    "own error / error": "error of the reference / error",
    "own error / part": "error of the reference / part",
    "own error / smallest aim": "error of the reference / smallest target error",
    "own error / smallest error": "error of the reference / smallest target error",
    "reference's own error / error": "error of the reference / error",
    "reference, its own error": "error of the reference",
    "references apart / own error": "difference of two references / error of the reference",
    "share of false doubts": "share of unnecessary warnings",
    "silent wrong": "wrong without a warning",
    "silent wrong, beside": "wrong without a warning, other engine",
    "stated too little": "stated error too small",
    "stated too much": "stated error / true error, largest",
    "step where they meet": "step with equal errors of rounding and steps",
    "tip apart": "tip difference",
    "tip apart / allowed": "tip difference / allowed",
    "unknown": "no reference",
    "within": "within tolerance",
    "within, beside": "within tolerance, other engine",
    "witness, its two runs apart": "difference of two runs of the other program",
    "witnesses left out": "other programs not installed",
}
"""Stored name → name that pages show."""


def displayed(name: str) -> str:
    """Display name of a stored quantity or verdict; other names are shown unchanged."""
    return DISPLAYED.get(name, name)
