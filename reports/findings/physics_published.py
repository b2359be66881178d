"""Published values compared with flexlink's."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.common.wording import plural
from flexlink.pages.numbers import number
from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
SHOWN = 4  # most lines per case here; the notes in the case's table list all values
DIGITS = 7


def find(results: Results) -> Iterator[Table]:
    """One table: the first values of each case, and the largest difference if the case has more values."""
    lines: list[tuple[str | float | None, ...]] = []
    compared = cases = 0
    for case, series in results.showing("published"):
        columns = (series.columns[name].tolist() for name in ("what", "published", "ours"))
        pairs = list(zip(*columns, strict=True))
        compared, cases = compared + len(pairs), cases + 1
        name = results.cases[case][0].title
        lines += [
            (f"{name}: {what}", f"{theirs:.{DIGITS}g}", f"{ours:.{DIGITS}g}", _percent(ours / theirs - 1))
            for what, theirs, ours in pairs[:SHOWN]
        ]
        if len(pairs) > SHOWN:
            worst = max(abs(ours / theirs - 1) for _, theirs, ours in pairs)
            lines.append((f"{name}: {len(pairs) - SHOWN} more", "", "", f"at most {_percent(worst)}"))
    if lines:
        heads = ("benchmark", "published or exact", "flexlink", "difference")
        yield Table(
            "physics_published",
            "Published values and flexlink’s",
            heads,
            tuple(lines),
            (_sentence(compared, cases),),
            to_look_up=True,
        )


def _sentence(compared: int, cases: int) -> str:
    return (
        f"{plural(compared, 'value')} of {cases} benchmarks. The tables below list the lumping rule, the number of "
        "hinges, and all values in their notes."
    )


def _percent(part: float) -> str:
    return f"{number(100 * part, 2)} %"
