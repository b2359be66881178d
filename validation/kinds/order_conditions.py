"""Prove the order of the Runge-Kutta methods: all conditions up to the order are met, one of the next order fails."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from mpmath import mp

from flexlink.describe.schemes.methods import Method
from flexlink.describe.schemes.methods import method as method_of
from validation.case import Case, Measured
from validation.facts import Facts
from validation.kinds import kind
from validation.oracles.collocation import collocation
from validation.oracles.rooted_trees import DIGITS, Coefficients, coefficients, residuals
from validation.oracles.rooted_trees import embedded as embedded_coefficients


@kind
def run(case: Case, methods: tuple[str, ...], embedded: dict[str, tuple[int, ...]] | None = None) -> Iterator[Measured]:
    """Yield residuals of the conditions; for Gauss and Radau IIA also the rounding of the float64 coefficients.

    `embedded` are the orders of a method's embedded methods, one per row of error weights.
    """
    for name in methods:
        method = method_of(name)
        yield from _conditions(name, method.order, coefficients(method))
        if method.family is not None:
            yield Measured("rounding", _rounding(method), varied={"method": name})
    for name, orders in (embedded or {}).items():
        for row, order in enumerate(orders):
            yield from _conditions(f"{name}, embedded {order}", order, embedded_coefficients(method_of(name), row))


def _conditions(name: str, order: int, exact: Coefficients) -> Iterator[Measured]:
    """Yield the largest residual of the conditions up to the order, their number, and the largest of the next order."""
    found = [r for k in range(1, order + 1) for r in residuals(exact, k)]
    facts: Facts = {"method": name, "order": order}
    yield Measured("residual", float(max(found)), varied=facts)
    yield Measured("conditions", len(found), varied=facts)
    yield Measured("residual one order above", float(max(residuals(exact, order + 1))), varied=facts)


def _rounding(method: Method) -> float:
    """Largest difference of A, b and c from independent values, in units in the last place of each number."""
    with mp.workdps(DIGITS):
        exact = collocation(str(method.family), method.stages)
        pairs = zip(
            (x for part in method.arrays for x in part.ravel()),
            (x for part in (*exact[0], *exact[1:]) for x in part),
            strict=True,
        )
        return max(float(abs(mine - theirs) / np.spacing(abs(mine))) for mine, theirs in pairs)
