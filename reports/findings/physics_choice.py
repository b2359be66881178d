"""Lumping rule and number of hinges for each requirement, and where the paper's own layout is sufficient."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from flexlink.pages.numbers import JOIN, number
from flexlink.pages.tables import Table
from reports.results import Results

SECTION = "physics"
GENERAL = ("paper", "midpoint", "gregory", "gauss", "legendre")  # rules for any joint and load, one column each
FREE, CLAMPED = "physics_pinned", "physics_clamped"  # cases
NEAR = 2.0  # a rule is sufficient if it needs at most this multiple of the fewest hinges


class Need(NamedTuple):
    """Hinges needed to meet a requirement, by rule; or, in `missed`, the largest number tried that was insufficient."""

    needed: dict[str, float]
    missed: dict[str, float]


def find(results: Results) -> Iterator[Table]:
    """One table over all cases."""
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


READ = "“> n”: n hinges were insufficient, and more were not tried. Empty: the rule was not tried."


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
            yield f"{rule} meets {len(met)} of the {len(tried)} requirements it was tried on, with up to {most} hinges."


def _paper(needs: Mapping[str, Need]) -> Iterator[str]:
    enough = [
        f"{name} ({number(need.needed['paper'])})"
        for name, need in needs.items()
        if "paper" in need.needed and need.needed["paper"] <= NEAR * min(need.needed.values())
    ]
    missed = sum("paper" in need.missed for need in needs.values())
    if enough:
        yield (
            f"The paper’s own layout is sufficient, with no more than {number(NEAR)} times the fewest hinges, for: "
            f"{'; '.join(enough)}."
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
            f"Its order for the first mode is {orders[FREE]} if both ends are free of torque, as in its figure 5, "
            f"and {orders[CLAMPED]} at a clamped, locked or driven joint, because the half segments there do not bend."
        )


def _steps(results: Results, needs: Mapping[str, Need]) -> Iterator[str]:
    found = [row for row in results.rows if row.quantity == "stable step of RK4" and row.value]
    steps = {row.varied["rule"]: row.value or 0.0 for row in found}
    if "gauss" in steps and "legendre" in steps:
        hinges, times = f"{found[0].varied['hinges']} hinges", number(steps["gauss"] / steps["legendre"], 2)
        fewest = sum(need.needed.get("legendre") == min(need.needed.values(), default=None) for need in needs.values())
        yield (
            f"legendre needs the fewest hinges for {fewest} of {len(needs)} requirements. But its short end "
            f"segments make RK4’s largest stable step {times} times smaller than gauss’s ({hinges}). legendre "
            "is the better choice for modes and statics; gauss, the default, is better for motion."
        )
