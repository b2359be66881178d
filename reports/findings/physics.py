"""Lumping rules and benchmarks."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from flexlink.common.wording import plural
from flexlink.pages.numbers import JOIN, number
from flexlink.pages.tables import Table
from reports.findings import finding
from reports.results import Results

GENERAL = ("paper", "midpoint", "gregory", "gauss", "legendre")  # rules for any joint and load, one column each
FREE, CLAMPED = "physics_pinned", "physics_clamped"  # cases
NEAR = 2.0  # a rule is sufficient if it needs at most this multiple of the fewest hinges


class Need(NamedTuple):
    """Hinges needed to meet a requirement, by rule; or, in `missed`, the largest number tried that was insufficient."""

    needed: dict[str, float]
    missed: dict[str, float]


@finding("physics")
def physics_choice(results: Results) -> Iterator[Table]:
    """Lumping rule and number of hinges for each requirement, and where the paper's own layout is sufficient.

    One table over all cases.
    """
    needs = _needs(results)
    if not needs:
        return
    heads = ("requirement", *GENERAL, "others")
    lines = tuple(
        (name.replace(" %", f"{JOIN}%"), *(_cell(need, rule) for rule in GENERAL), _others(need))
        for name, need in needs.items()
    )
    sentences = (*_winners(needs), *_steps(results, needs), *_paper(needs), *_orders(results), READ)
    yield Table("physics_choice", "Lumping rule and number of hinges for each requirement", heads, lines, sentences)


READ = "“> n” means that n hinges were insufficient and more were not tried; an empty cell: the rule was not tried."


def _needs(results: Results) -> dict[str, Need]:
    found: dict[str, Need] = {}
    for row in results.rows:
        if row.quantity in ("hinges needed", "hinges not enough") and row.value is not None:
            need = found.setdefault(str(row.varied["need"]), Need({}, {}))
            part = need.needed if row.quantity == "hinges needed" else need.missed
            part[str(row.varied["rule"])] = row.value
    return found


def _cell(need: Need, rule: str) -> str:
    if rule in need.needed:
        return number(need.needed[rule])
    return f"> {number(need.missed[rule])}" if rule in need.missed else ""


def _others(need: Need) -> str:
    return ", ".join(f"{rule} {_cell(need, rule)}" for rule in (*need.needed, *need.missed) if rule not in GENERAL)


def _winners(needs: Mapping[str, Need]) -> Iterator[str]:
    for rule in ("gauss", "legendre"):
        tried = [need for need in needs.values() if rule in need.needed or rule in need.missed]
        met = [need.needed[rule] for need in tried if rule in need.needed]
        if met:
            most = number(max(met))
            counts = f"{len(met)} of the {len(tried)} requirements on which it was tried"
            yield f"{rule} meets {counts}, with up to {most} hinges."


def _paper(needs: Mapping[str, Need]) -> Iterator[str]:
    enough = [
        f"{name} ({number(need.needed['paper'])})"
        for name, need in needs.items()
        if "paper" in need.needed and need.needed["paper"] <= NEAR * min(need.needed.values())
    ]
    missed = sum("paper" in need.missed for need in needs.values())
    if enough:
        yield (
            f"The paper’s own layout of hinges needs at most {number(NEAR)} times as many hinges as the best rule for "
            f"these requirements (number of hinges in brackets): {'; '.join(enough)}."
        )
    yield f"The paper’s own layout does not meet {missed} of all {len(needs)} requirements."


def _orders(results: Results) -> Iterator[str]:
    """Sentence on the order of the paper's layout, with ends free of torque and with clamped ends."""
    orders = {
        row.case: number(row.value, 2)
        for row in results.rows
        if row.quantity == "fitted order" and dict(row.varied) == {"rule": "paper", "measure": "mode 1"}
    }
    if FREE in orders and CLAMPED in orders:
        yield (
            f"The error of its first frequency has order {orders[FREE]} if both ends of the link are free of torque, "
            f"as in the paper’s figure 5. At a clamped, locked or driven joint it has order {orders[CLAMPED]}, "
            "because the half segment at the joint does not bend."
        )


def _steps(results: Results, needs: Mapping[str, Need]) -> Iterator[str]:
    found = [row for row in results.rows if row.quantity == "stable step of RK4" and row.value]
    steps = {row.varied["rule"]: row.value or 0.0 for row in found}
    if "gauss" in steps and "legendre" in steps:
        hinges, times = f"{found[0].varied['hinges']} hinges", number(steps["gauss"] / steps["legendre"], 2)
        fewest = sum(need.needed.get("legendre") == min(need.needed.values(), default=None) for need in needs.values())
        yield (
            f"legendre needs the fewest hinges for {fewest} of {len(needs)} requirements. But its short end segments "
            f"make RK4’s largest stable step {times} times smaller than with gauss, at {hinges} each. For modes and "
            "statics legendre is the better choice; for motion gauss, the default, is better."
        )


HEADS = ("rule", "largest stable RK4 step [s]", "relative to the longest of all rules", "hinges")


@finding("physics")
def physics_price(results: Results) -> Iterator[Table]:
    """Cost of a lumping rule for an explicit method: the largest stable step.

    One table: rules by stable step, with the same number of hinges each.
    """
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
            "The highest frequency of the chain, which depends on its shortest segments, limits the step of an "
            f"explicit method. With equal numbers of hinges (EI = ρA = L = 1), {first} allows the longest steps; "
            f"{last} needs {number(longest / shortest, 2)} times as many steps. Kelvin-Voigt damping shortens the "
            "stable step further, because the damping ratio of a mode increases with its frequency.",
        ),
    )


SHOWN = 4  # most lines per case here; the notes in the case's table list all values
DIGITS = 7


@finding("physics")
def physics_published(results: Results) -> Iterator[Table]:
    """Published values compared with flexlink's.

    One table: the first values of each case, and the largest difference if the case has more values.
    """
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
            "Published values compared with those of flexlink",
            heads,
            tuple(lines),
            (_published_sentence(compared, cases),),
            to_look_up=True,
        )


def _published_sentence(compared: int, cases: int) -> str:
    return (
        f"The study compares {plural(compared, 'value')} of {plural(cases, 'benchmark')}. The notes in the tables of "
        "the cases list all values, with the lumping rule and the number of hinges."
    )


def _percent(part: float) -> str:
    return f"{number(100 * part, 2)} %"


FILE = Path(__file__).parent.parent / "tried.toml"


@finding("physics")
def physics_tried(results: Results) -> Iterator[Table]:
    """Lumping rules that were tried, and the outcome of each, from reports/tried.toml.

    One table, if the study has a case of the physics chapter.
    """
    if any(results.of_kind("frequencies")):
        data = tomllib.loads(FILE.read_text(encoding="utf-8"))
        lines = tuple((entry["idea"], entry["outcome"]) for entry in data["tried"])
        yield Table("physics_tried", "Lumping rules that were tried", ("idea", "outcome"), lines, (data["text"],))


SHEET = "data sheet"


@finding("physics", SHEET)
def data_sheets(results: Results) -> Iterator[Table]:
    """Data sheets of the benchmarks, one table each: description, accepted error, accuracy, CPU time at three settings.

    One table per benchmark.
    """
    for case, series in results.showing(SHEET):
        title, _, about = series.title.partition(". ")
        lines = tuple(zip(*(column.tolist() for column in series.columns.values()), strict=True))
        yield Table(
            f"{case}.{series.part}", f"Data sheet: {title}", tuple(series.columns), lines, (about,), to_look_up=True
        )
