"""The paper's claims and conclusion, and orders of its methods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from flexlink.common.types import Array
from flexlink.common.wording import plural
from flexlink.pages.numbers import amount, number
from flexlink.pages.tables import Cell, Table
from reports.claims import CLAIM, CONFIRMED, IN_PART, REFUTED, judging, standing, words
from reports.curves import floats, groups
from reports.findings import finding
from reports.results import Results
from validation.store import Row


@finding("claims")
def paper_claims(results: Results) -> Iterator[Table]:
    """The paper's claims, one per line: verdict, limits, and what was measured.

    One table over all cases that check a claim.
    """
    claims = _once(judging(results.rows))
    if claims:
        heads = ("verdict", f"{CLAIM} of the paper", "limits", "measured")
        lines = tuple(
            (standing(row).word, f"“{words(row)}”", _limits(row), f"{amount(row.value, row.unit)}: {row.metric}")
            for row in claims
        )
        classes = tuple(standing(row).state for row in claims)
        title = "Claim by claim"
        yield Table("paper_claims", title, heads, lines, (_sentence(claims),), opened=True, classes=classes)


def _limits(row: Row) -> str:
    """Limits within which the claim is confirmed."""
    return row.note.removeprefix("holds").lstrip(" ;:")


def _once(rows: list[Row]) -> list[Row]:
    """Each claim once; if several cases check the same claim, the one with the most arms."""
    found: dict[str, Row] = {}
    for row in rows:
        other = found.get(words(row))
        if other is None or _arms(row) > _arms(other):
            found[words(row)] = row
    return list(found.values())


def _arms(row: Row) -> float:
    return float(row.varied.get("arms", 0))


def _sentence(claims: Sequence[Row]) -> str:
    found = [standing(row) for row in claims]
    counts = ", ".join(f"{found.count(each)} {each.word}" for each in (CONFIRMED, IN_PART, REFUTED))
    return f"Verdicts on {plural(len(claims), 'claim')}: {counts}."


ERROR, WORK = "error [rad]", "evaluations per simulated second"
TARGETS = tuple(float(f"1e-{k}") for k in range(1, 13))  # rad; one accuracy per decade

Costs = Mapping[str, float]  # method → evaluations per simulated second, for the methods that reach an accuracy


@finding("integrators")
def paper_conclusion(results: Results) -> Iterator[Table]:
    """Verdict on the paper's conclusion, "RK4 suffices, RK10 is not justified", for the paper's arm.

    One finding per scene of every comparison of methods.
    """
    for case, series in results.showing("comparison"):
        works = {
            method: (floats(series.columns[WORK][rows]), floats(series.columns[ERROR][rows]))
            for method, rows in groups(series)
        }
        yield conclusion(f"{case}.{series.name}.conclusion", series.scene, works)


def conclusion(name: str, scene: str, works: Mapping[str, tuple[Array, Array]]) -> Table:
    """Cheapest method at every accuracy that any method reaches, and the verdict on the paper's conclusion."""
    table = {}
    for target in TARGETS:
        needed = {method: evaluations(work, error, target) for method, (work, error) in works.items()}
        costs = {method: cost for method, cost in needed.items() if cost is not None}
        if costs:
            table[target] = costs
    best = {target: min(costs, key=costs.__getitem__) for target, costs in table.items()}
    lines = tuple((target, *(costs.get(method) for method in works), best[target]) for target, costs in table.items())
    heads = ("error [rad]", *works, "cheapest")
    return Table(name, f"The paper’s conclusion on {scene}", heads, lines, (*_sentences(table, best),))


def evaluations(work: Array, error: Array, target: float) -> float | None:
    """Fewest evaluations for an error of `target`, by log-log interpolation; None if no run reaches it."""
    order = np.argsort(work)
    order = order[np.isfinite(error[order])]
    x, y = np.log(work[order]), np.log(np.maximum(error[order], 1e-300))
    below = y <= np.log(target)
    if not below.any():
        return None
    first = int(np.argmax(below))
    if first == 0:  # the longest step tried is already accurate enough
        return float(np.exp(x[0]))
    part = (y[first - 1] - np.log(target)) / (y[first - 1] - y[first])
    return float(np.exp(x[first - 1] + part * (x[first] - x[first - 1])))


def _sentences(table: Mapping[float, Costs], best: Mapping[float, str]) -> Iterator[str]:
    holds = [target for target, method in best.items() if method == "RK4"]
    fails = [target for target, method in best.items() if method == "RK10"]
    claim = (
        "The paper concludes: “RK4 suffices, RK10 is not justified”. By the number of evaluations of q̈ that a "
        "method needs for a given error of the joint angles, this "
    )
    if not fails:
        yield claim + "is confirmed at every error tried."
    elif not holds:
        yield claim + "is refuted at every error tried: RK4 is never the cheapest."
    else:
        yield claim + f"is confirmed for errors of {_span(holds)} and refuted for errors of {_span(fails)}."
    for winner, loser, targets in (("RK4", "RK10", holds), ("RK10", "RK4", fails)):
        ratios = {t: table[t][loser] / table[t][winner] for t in targets if loser in table[t]}
        if ratios:
            most = max(ratios, key=lambda t: ratios[t])
            times = f"{number(ratios[most], 2)} times as many evaluations"
            yield f"Where {winner} is the cheapest, {loser} needs up to {times} (for an error of {_rad(most)})."
        alone = [t for t in targets if loser not in table[t]]
        if alone:
            yield f"{loser} does not reach errors of {_span(alone)} with the steps tried."
    second = [target for target, method in best.items() if method == "RK2"]
    yield f"RK2 is the cheapest for errors of {_span(second)}." if second else "RK2 is never the cheapest."
    yield (
        "The table lists evaluations per simulated second. If a method has the same number in several rows, its "
        "longest step is accurate enough for all of them, and longer steps are near or beyond the stability limit."
    )


def _span(targets: Sequence[float]) -> str:
    if len(targets) == 1:
        return _rad(targets[0])
    return f"{number(max(targets))} to {_rad(min(targets))}"


def _rad(target: float) -> str:
    return amount(target, "rad")


MET, NEXT = "residual", "residual one order above"


@finding("integrators")
def order_conditions(results: Results) -> Iterator[Table]:
    """Order of every Runge-Kutta method: residuals of its order conditions and of the next order.

    One table over all cases.
    """
    values: dict[str, dict[str, float | None]] = {}
    for _, rows in results.of_kind("order_conditions"):
        for row in rows:
            if row.quantity in (MET, NEXT):
                values.setdefault(str(row.varied["method"]), {})[row.quantity] = row.value
    if values:
        lines: tuple[tuple[Cell, ...], ...] = tuple(
            (name, *map(found.get, (MET, NEXT))) for name, found in values.items()
        )
        heads = ("method", "largest residual up to its order [1]", "largest residual one order above [1]")
        title = "Order conditions of the Runge-Kutta methods"
        yield Table("order_conditions.methods", title, heads, lines, (_orders_sentence(values),), to_look_up=True)


def _orders_sentence(values: dict[str, dict[str, float | None]]) -> str:
    met, beyond = ([v for found in values.values() if (v := found.get(name)) is not None] for name in (MET, NEXT))
    if not met:
        return "No order condition was measured."
    words = (
        f"The residuals of all order conditions of {len(met)} sets of coefficients are at most {amount(max(met), '')}"
    )
    if not beyond:
        return f"{words}."
    least = amount(min(beyond), "")
    return f"{words}. The largest residual of the next order is {least} or more in each set, so no order is higher."
