"""Order conditions: how well the coefficients of each method meet all of them, and how badly the next order's."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.pages.picture import Picture
from flexlink.pages.style import BLUE, INK, VERMILION, legend_above, stacked_axes
from reports.results import Results
from reports.tables import rows_csv

SECTION = "integrators"
TAKES: tuple[str, ...] = ()
CURVES = (("residual", "through the order", BLUE, "o"), ("residual one order above", "next order", VERMILION, "s"))
CAPTION = (
    "Largest residual of all order conditions up to each method's order, in multi-digit arithmetic from the exact "
    "coefficients (left edge: exactly zero), and of the conditions one order higher, which must not vanish."
)


def draw(results: Results) -> Iterator[Picture]:
    """One picture a case: residual through the order, and one order above."""
    for case, rows in results.of_kind("order_conditions"):
        methods = list(dict.fromkeys(str(row.varied["method"]) for row in rows))
        limits = [row.tolerance for row in rows if row.tolerance]
        shown = [row.value for row in rows if row.value and row.quantity in {name for name, *_ in CURVES}] + limits
        if not shown:
            continue
        left = min(shown) * 1e-5
        figure, (axes,) = stacked_axes(1, 1.5 + 0.5 * len(methods))
        for name, label, colour, marker in CURVES:
            found = [row for row in rows if row.quantity == name and row.value is not None]
            values = [max(row.value or 0.0, left) for row in found]
            axes.plot(
                values,
                [methods.index(str(row.varied["method"])) for row in found],
                marker,
                color=colour,
                label=label,
                clip_on=False,
            )
        for limit in limits[:1]:
            axes.axvline(limit, color=INK, label="limit")
        axes.set(xscale="log", yticks=range(len(methods)), xlabel="largest residual [1]")
        axes.set_yticklabels(methods)
        axes.set_xlim(left=left)
        axes.set_ylim(len(methods) - 0.5, -0.5)
        legend_above(figure, axes, 3)
        yield Picture(case, rows[0].title, figure, CAPTION, rows_csv(rows))
