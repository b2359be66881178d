"""Error against number of hinges for each rule: curves, fitted orders, and hinges needed for each requirement."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import msgspec
import numpy as np

from flexlink.common.errors import DataFileError
from flexlink.describe.spec import Positive, Spec
from validation.case import Measured
from validation.facts import Facts
from validation.physics.variant import Rule
from validation.store import Series, table

Errors = dict[int, float]
"""Number of hinges → magnitude of the error."""


class Need(Spec, frozen=True):
    """A user's requirement that these errors are within a limit."""

    name: str
    measures: tuple[str, ...]
    within: Positive


class Named(Spec, frozen=True):
    """The error of one chain, or its ratio to the error of another rule, as a separate quantity with its own limit."""

    quantity: str
    measure: str
    rule: str
    hinges: int
    over: str = ""  # another rule with the same number of hinges


class Sweep(Spec, frozen=True, kw_only=True):
    """Numbers of hinges by rule, requirements, and expected orders by measure and rule.

    The order is fitted to the `fitted` largest hinge counts with an error above the measure's `rounding`. `least`
    contains lower bounds for rules that approach their order from above or whose error changes sign; the fit then skips
    errors that a finer chain exceeds, since these are small by accident. `named` are errors of single chains.
    """

    rules: dict[str, tuple[int, ...]]
    needs: tuple[Need, ...] = ()
    orders: dict[str, dict[str, float]] = msgspec.field(default_factory=dict)
    least: dict[str, dict[str, float]] = msgspec.field(default_factory=dict)
    rounding: dict[str, Positive] = msgspec.field(default_factory=dict)
    fitted: int = 3
    named: tuple[Named, ...] = ()

    def last(self, measure: str, errors: Errors, *, lucky: bool = True) -> Errors:
        """Errors of a measure for the fit of its order; `lucky`: include errors that a finer chain exceeds."""
        least = self.rounding.get(measure, 0.0)
        valid = {n: e for n, e in sorted(errors.items()) if np.isfinite(e) and e >= least}
        if not lucky:
            valid = {n: e for n, e in valid.items() if all(e > valid[m] for m in valid if m > n)}
        return dict(list(valid.items())[-self.fitted :])


class Point(NamedTuple):
    """Errors of one chain by measure."""

    at: Rule
    errors: Mapping[str, float]


def by_rule(points: Sequence[Point], measure: str) -> dict[str, Errors]:
    """Lumping rule → errors of this measure by number of hinges."""
    found: dict[str, Errors] = {}
    for point in points:
        found.setdefault(point.at.rule, {})[point.at.hinges] = abs(point.errors[measure])
    return found


def report(
    sweep: Sweep, points: Sequence[Point], about: str, units: Mapping[str, str] = MappingProxyType({})
) -> Iterator[Measured | Series]:
    """Yield a series titled `about` per measure, and rows for fitted orders, requirements and named errors.

    `hinges needed` is the smallest number of hinges with which, and with all larger numbers tried, the error is within
    the limit. A rule without such a number has a row `hinges not enough` instead. `fewest hinges: NAME` is the minimum
    over all rules.
    """
    for measure in points[0].errors:
        errors = by_rule(points, measure)
        rows = [(rule, n, e) for rule, found in errors.items() for n, e in found.items()]
        columns = table(("rule", "hinges", "error"), rows)
        y_label = f"error of {measure} [{units.get(measure, 1)}]"
        labels = "hinges", "hinges a link", y_label
        yield Series("sweep", about, columns, *labels, "log", "log", group="rule", part=measure)
        for rule, found in errors.items():
            yield from _order(sweep, measure, rule, found)
    for need in sweep.needs:
        yield from _need(need, points)
    for named in sweep.named:
        facts: Facts = {"rule": named.rule, "hinges": named.hinges, "measure": named.measure}
        errors = by_rule(points, named.measure)
        unit = errors[named.over][named.hinges] if named.over else 1.0
        yield Measured(named.quantity, errors[named.rule][named.hinges] / unit, varied=facts)


def order(errors: Errors) -> float:
    """Negative slope of log error against log number of hinges."""
    n, error = np.array(list(errors)), np.maximum(np.abs(list(errors.values())), 1e-300)
    return float(-np.polyfit(np.log(n), np.log(error), 1)[0])


def _order(sweep: Sweep, measure: str, rule: str, errors: Errors) -> Iterator[Measured]:
    least = sweep.least.get(measure, {}).get(rule)
    last = sweep.last(measure, errors, lucky=least is None)
    if len(last) < 2:
        if least is not None:
            raise DataFileError(f"settings.least.{measure}.{rule}: fewer than two errors exceed the rounding error")
        return
    fitted = order(last)
    facts: Facts = {"rule": rule, "measure": measure}
    counts = ", ".join(map(str, last))
    yield Measured("fitted order", fitted, varied=facts, note=f"Fitted at {counts} hinges.")
    expected = sweep.orders.get(measure, {}).get(rule)
    if expected is not None:
        note = f"Fitted {fitted:.2f} at {counts} hinges, theory {expected:g}."
        yield Measured("|order − theory|", abs(fitted - expected), varied=facts, note=note)
    if least is not None:
        note = f"Fitted {fitted:.2f} at {counts} hinges, at least {least:g}."
        yield Measured("order − lower bound", fitted - least, varied=facts, note=note)


def _need(need: Need, points: Sequence[Point]) -> Iterator[Measured]:
    worst: dict[str, Errors] = {}
    for measure in need.measures:
        for rule, errors in by_rule(points, measure).items():
            kept = worst.setdefault(rule, {})
            for n, error in errors.items():
                kept[n] = max(kept.get(n, 0.0), error)
    needed: dict[str, int] = {}
    for rule, errors in worst.items():
        counts = sorted(errors, reverse=True)
        good = [n for k, n in enumerate(counts) if all(errors[m] <= need.within for m in counts[: k + 1])]
        if good:
            needed[rule] = min(good)
            yield Measured("hinges needed", needed[rule], varied={"rule": rule, "need": need.name})
        else:
            yield Measured("hinges not enough", max(errors), varied={"rule": rule, "need": need.name})
    if needed:
        fewest = min(needed.values())
        best = ", ".join(rule for rule, n in needed.items() if n == fewest)
        yield Measured(f"fewest hinges: {need.name}", fewest, note=f"With {best}.")


def published(pairs: Sequence[tuple[str, float, float]], title: str) -> Series:
    """Make the series `published`, a table of names, published numbers and ours, in one unit."""
    columns = table(("what", "published", "ours"), pairs)
    return Series("published", title, columns, "published", "published", "ours", group="what")
