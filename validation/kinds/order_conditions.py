"""Order of the Runge-Kutta methods, proved: every order condition up to the order, and the first one that fails."""

from __future__ import annotations

from collections.abc import Iterator

from flexlink.describe import methods
from flexlink.describe.spec import Spec
from validation.case import Case, Measured
from validation.facts import Facts
from validation.oracles.rooted_trees import residuals


class Settings(Spec, frozen=True):
    """Names of the methods."""

    methods: tuple[str, ...]


def run(case: Case, settings: Settings) -> Iterator[Measured]:
    """Largest residual of all conditions through the order, their number, and the largest one order above."""
    for name in settings.methods:
        method = methods.method(name)
        found = [r for order in range(1, method.order + 1) for r in residuals(method, order)]
        facts: Facts = {"method": name, "order": method.order}
        yield Measured("residual", float(max(found)), varied=facts)
        yield Measured("conditions", len(found), varied=facts)
        yield Measured("residual one order above", float(max(residuals(method, method.order + 1))), varied=facts)
