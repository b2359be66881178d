"""Order of every Runge-Kutta method: residuals of all its order conditions, and of the conditions of the next order."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.numbers import amount
from flexlink.pages.tables import Cell, Table
from reports.results import Results

SECTION = "integrators"
MET, NEXT = "residual", "residual one order above"


def find(results: Results) -> Iterator[Table]:
    """One table over all cases."""
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
        yield Table("order_conditions.methods", title, heads, lines, (_sentence(values),), to_look_up=True)


def _sentence(values: dict[str, dict[str, float | None]]) -> str:
    met = max(found.get(MET) or 0.0 for found in values.values())
    beyond = min((found[NEXT] or 0.0 for found in values.values() if NEXT in found), default=None)
    words = f"All order conditions of {len(values)} sets of coefficients are satisfied to {amount(met, '')}"
    if beyond is None:
        return f"{words}."
    return f"{words}. Conditions of the next order have residuals of {amount(beyond, '')} or more: no order is higher."
