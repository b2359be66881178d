"""The page of plausible ranges: which numbers are doubted before a run, from the data file."""

from __future__ import annotations

from pathlib import Path

from docs.generators.rest import heading, literal, table
from flexlink.describe.plausibility.ranges import Range, ranges

INTRO = """\
A number outside its range is likely given in another unit: a warning names it, what is usual, and the unit that would
bring it there. It is never an error; ``--quiet-hints`` leaves these warnings out. Some ranges are of what follows from
the number, such as a link's length over its width.
"""


def page(_: Path) -> str:
    """Every quantity with its range, the reason, and the units that are tried."""
    heads = ("quantity", "what", "plausible", "reason", "units that are tried")
    rows = [
        (literal(name), each.of or "the number itself", _range(each), each.reason, ", ".join(each.mistaken))
        for name, each in ranges().items()
    ]
    return "\n".join([heading("Plausible numbers"), INTRO, table(heads, rows)])


def _range(each: Range) -> str:
    low, high = each.range
    unit = "" if each.of or each.unit == "1" else f" {each.unit}"
    if low == high:
        return "by other numbers"
    return f"up to {high:g}{unit}" if low == 0 else f"{low:g} … {high:g}{unit}"
