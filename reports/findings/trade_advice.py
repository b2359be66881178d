"""What the model costs that `advise` picks, relative to the front of all contestants, for every scene and error."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.contests import LIMIT, Scene, ratios, scenes, why_not_advised
from reports.results import Results

SECTION = "trade"
HEADS = ("scene", "error asked", "cost of advise's pick / front", "pick; front")


def find(results: Results) -> Iterator[Table]:
    """One table, if any scene has a pick."""
    found = scenes(results)
    lines = tuple((scene.name, each.error, each.value, each.note) for scene in found for each in ratios(scene))
    if lines:
        title = "What advise picks, relative to the cheapest run of all contestants with the same error"
        yield Table("trade_advice", title, HEADS, lines, tuple(sentences(found)))


def sentences(found: Sequence[Scene]) -> Iterator[str]:
    """The range of the costs, the number of scenes within the limit, and every scene that is not."""
    of = {scene.name: ratios(scene) for scene in found}
    values = [each.value for own in of.values() for each in own]
    yield f"advise's pick costs {number(min(values))} to {number(max(values))} times the front."
    within = sum(bool(own) and all(each.value <= LIMIT for each in own) for own in of.values())
    where = f"{within} of {plural(len(of), 'scene')}"
    yield f"It is within {number(LIMIT)} times the front for all errors asked in {where}."
    over = [
        f"{name} ({number(each.value)} for an error of {number(each.error)})"
        for name, own in of.items()
        for each in own
        if each.value > LIMIT
    ]
    if over:
        yield f"Above it: {', '.join(over)}."
    for scene in found:
        if not of[scene.name] and (why := why_not_advised(scene)):
            yield f"No pick for {scene.name}: {why}"
