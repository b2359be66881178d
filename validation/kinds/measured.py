"""Comparison with measurements: error of every quantity, its validation uncertainty (ASME V&V 20), and a verdict.

No parameters are fitted; the scene contains the values that the source of the measurement states.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

from flexlink.chain.arguments import require_one_of
from flexlink.describe.scene import Scene
from flexlink.describe.spec import Positive, Spec
from validation.case import Case, Measured
from validation.measured.measurements import MEASUREMENTS, Measurement
from validation.measured.readings import Reading
from validation.measured.uncertainty import COVERAGE, VERDICTS, Comparison, grid_convergence, standard
from validation.store import Series, table

GRIDS = (1, 2, 4)  # multiples of the number of hinges of a link


class Input(Spec, frozen=True, kw_only=True):
    """An input of the model with its tolerance, ± `relative` × value or ± `by`; `path` is its key in the scene."""

    path: str
    relative: float = 0.0
    by: float = 0.0
    reason: str


class Settings(Spec, frozen=True, kw_only=True):
    """The measurement, a file of `validation/measured/`; hinges of each link on the coarsest grid; inputs by name.

    `wanted` is the required accuracy |E| / |D| for each group of quantities, which a measurement must be able to
    resolve. `order` is the order of the lumping rule. `rounding` is the smallest relative error assumed for S.
    """

    measurement: str
    hinges: dict[str, int]
    order: float
    wanted: dict[str, Positive]
    input: dict[str, Input]
    rounding: Positive = 1e-9


class _Simulated(NamedTuple):
    """Simulated values by name, on each grid, and with each input at both limits of its tolerance."""

    grids: list[dict[str, float]]
    inputs: dict[str, tuple[dict[str, float], dict[str, float]]]

    def u_input(self, name: str) -> dict[str, float]:
        """Standard uncertainty of a simulated value due to each input."""
        return {which: standard(abs(high[name] - low[name]) / 2) for which, (low, high) in self.inputs.items()}


def run(case: Case, settings: Settings) -> Iterator[Measured | Series]:
    """Yield every quantity, then the groups, then the table."""
    measurement = require_one_of(f"{case.path}: settings.measurement", settings.measurement, MEASUREMENTS)
    readings = measurement.all_readings()
    simulated = _simulate(case, settings, measurement)
    rows = []
    groups: dict[str, list[Comparison]] = {}
    for name, reading in readings.items():
        require_one_of(f"{case.path}: settings.wanted", reading.group, settings.wanted)
        compared, inputs = _compared(name, reading, simulated, settings)
        groups.setdefault(reading.group, []).append(compared)
        yield from _measured(name, reading, compared, inputs)
        rows.append((name, reading.group, reading.unit, *_numbers(compared), compared.verdict))
    for group, found in groups.items():
        yield from _of_group(group, found)
    heads = (
        "quantity",
        "group",
        "unit",
        "S",
        "D",
        "E",
        "u_num",
        "GCI",
        "order",
        "u_input",
        "u_D",
        "u_val",
        "wanted",
        "verdict",
    )
    yield Series("measured", case.title, table(heads, rows), "quantity", "", "E", group="group")


def _simulate(case: Case, settings: Settings, measurement: Measurement) -> _Simulated:
    (scene,) = case.load_scenes()
    first = scene.varied({f"link.{link}.segments": n + 1 for link, n in settings.hinges.items()})
    finer = [{f"link.{link}.segments": times * n + 1 for link, n in settings.hinges.items()} for times in GRIDS[1:]]
    grids = [measurement.predict(each) for each in (first, *map(scene.varied, finer))]
    inputs = {name: _at_both_ends(first, each, measurement) for name, each in settings.input.items()}
    return _Simulated(grids, inputs)


def _at_both_ends(scene: Scene, varied: Input, measurement: Measurement) -> tuple[dict[str, float], dict[str, float]]:
    (value,) = scene.values_at(varied.path)
    off = varied.by + varied.relative * abs(value)
    low, high = (measurement.predict(scene.varied({varied.path: value + sign * off})) for sign in (-1, 1))
    return low, high


def _compared(
    name: str, reading: Reading, simulated: _Simulated, settings: Settings
) -> tuple[Comparison, dict[str, float]]:
    coarse, middle, fine = (values[name] for values in simulated.grids)
    convergence = grid_convergence(coarse, middle, fine, settings.order, settings.rounding * abs(fine))
    inputs = simulated.u_input(name)
    wanted = settings.wanted[reading.group] * abs(reading.value)
    return Comparison(fine, reading.value, convergence, math.hypot(*inputs.values()), reading.u, wanted), inputs


def _measured(name: str, reading: Reading, compared: Comparison, inputs: Mapping[str, float]) -> Iterator[Measured]:
    """Yield the error of a quantity relative to the measured value D, as a separate quantity if D is uncertain."""
    parts = ", ".join(f"{which} {u:.2g}" for which, u in sorted(inputs.items(), key=lambda item: -item[1])) or "nothing"
    precise = COVERAGE * compared.u_measured <= compared.wanted
    quantity = f"|E| / |D|, {reading.group}" + ("" if precise else ", read too coarsely")
    note = f"{compared.words(reading.unit)} Of u_input: {parts}."
    yield Measured(quantity, abs(compared.error / compared.measured), varied={"situation": name}, note=note)


def _of_group(group: str, found: list[Comparison]) -> Iterator[Measured]:
    relative = [c.error / c.measured for c in found]
    if len(found) > 1:
        yield Measured(f"root mean square of E / D, {group}", math.sqrt(sum(e * e for e in relative) / len(found)))
    for verdict in VERDICTS:
        yield Measured(verdict, sum(c.verdict == verdict for c in found), varied={"situation": group})


def _numbers(c: Comparison) -> tuple[float, ...]:
    order, index = c.convergence
    return (
        c.simulated,
        c.measured,
        c.error,
        c.convergence.u_num,
        index,
        order,
        c.u_input,
        c.u_measured,
        c.u_val,
        c.wanted,
    )
