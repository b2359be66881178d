"""The page of plausible ranges, from the data file; values outside cause a warning before a run."""

from __future__ import annotations

from pathlib import Path

from docs.generators.rest import heading, literal, table
from flexlink.describe.plausibility.sizes import Range, ranges

INTRO = """\
A value outside its range was probably given in another unit. A warning names the value, the usual range, and the unit
that would bring the value into the range. It is never an error; ``--quiet-hints`` suppresses these warnings. Some
ranges apply to derived quantities, for example a link's length over its width.
"""


def page(_: Path) -> str:
    """Return every quantity with its range, the reason, and the units tried."""
    heads = ("quantity", "applies to", "plausible", "reason", "units tried")
    rows = [
        (literal(name), each.of or "the value itself", _range(each), each.reason, ", ".join(each.mistaken))
        for name, each in ranges().items()
    ]
    return "\n".join([heading("Plausible numbers"), INTRO, table(heads, rows)])


def _range(each: Range) -> str:
    low, high = each.range
    unit = "" if each.of or each.unit == "1" else f" {each.unit}"
    if low == high:
        return "depends on other values"
    return f"up to {high:g}{unit}" if low == 0 else f"{low:g} … {high:g}{unit}"
