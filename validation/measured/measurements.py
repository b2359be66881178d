"""Measurements by name; each is a file in this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

from flexlink.describe.scene import Scene
from validation.measured import pazy_wing, rotating_beam, steel_cantilever, strip_on_flange, two_link_ringing
from validation.measured.readings import Derived, FittedInputs, Reading
from validation.measured.trends import Trend


class Measurement(NamedTuple):
    """Measured values, quantities derived from them, and a chain's prediction of the same quantities.

    `trends` pools groups of derived quantities, for the readings and the prediction of the finest grid.
    `u_again` derives the uncertainties of the measured values a second way, for the prediction of the finest grid.
    `fitted` gives the inputs of the scene that were fitted to measurements, if there are any.
    """

    readings: Callable[[], dict[str, Reading]]
    predicted: Callable[[Scene], dict[str, float]]
    derived: Callable[[], Iterable[Derived]]
    trends: Callable[[Mapping[str, Reading], Mapping[str, float]], Iterable[Trend]]
    u_again: Callable[[Mapping[str, float]], dict[str, float]] | None
    fitted: Callable[[Scene], FittedInputs] | None

    def all_readings(self) -> dict[str, Reading]:
        """Measured values by name, derived ones last."""
        found = self.readings()
        return found | {each.name: each.reading(found) for each in self.derived()}

    def predict(self, scene: Scene) -> dict[str, float]:
        """Predicted values of a chain, by the same names."""
        found = self.predicted(scene)
        return found | {each.name: each.of(found) for each in self.derived()}


def _none(*_: object) -> tuple[()]:
    return ()


MEASUREMENTS = {
    module.__name__.rpartition(".")[2]: Measurement(
        module.readings, module.predicted, getattr(module, "derived", _none), getattr(module, "trends", _none),
        getattr(module, "u_again", None), getattr(module, "fitted", None),
    )
    for module in (pazy_wing, rotating_beam, steel_cantilever, strip_on_flange, two_link_ringing)
}  # fmt: skip
