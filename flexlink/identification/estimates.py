"""Numbers that were found, with their intervals."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from flexlink.common.types import Array
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.data import Source
from flexlink.identification.fitted import Estimate
from flexlink.identification.interval import Spread
from flexlink.identification.residuals import Row
from flexlink.identification.stacking import linear_names


def without_ends(one: Estimate) -> Estimate:
    """A number whose interval nobody knows."""
    return dataclasses.replace(one, low=-math.inf, high=math.inf, deviation=math.inf)


def estimates(coordinates: Sequence[Coordinate], x: Array, spread: Spread) -> list[Estimate]:
    """Numbers of the scene."""
    found = []
    for k, one in enumerate(coordinates):
        at, σ = float(x[k]), float(spread.deviations[k])
        low, high = (one.value(at + far * spread.wide * σ) for far in (-1, 1))
        edge = 1e-6 * max(1.0, abs(at))
        bound = any(math.isfinite(end) and abs(at - end) < edge for end in one.bounds)
        found.append(
            Estimate(
                one.name,
                one.path,
                one.start,
                one.value(at),
                low,
                high,
                one.size(one.value(at)) * σ,
                bound,
                unit=one.measured_in,
            )
        )
    return found


def linear_estimates(
    sources: Sequence[Source], rows: Sequence[Sequence[Row]], spread: Spread, count: int
) -> list[Estimate]:
    """Gains and biases, which stand behind `count` numbers of the scene."""
    found = []
    values = [
        (row.gain, 1.0, "") if what == "gain" else (row.bias, 0.0, block.unit)
        for source, part in zip(sources, rows, strict=True)
        for block, row in zip(source.blocks, part, strict=True)
        for what in ("gain", "bias")
        if getattr(block, what)
    ]
    for k, (name, (value, start, unit)) in enumerate(zip(linear_names(sources), values, strict=True), count):
        σ = float(spread.deviations[k])
        ends = value - spread.wide * σ, value + spread.wide * σ
        found.append(Estimate(name, "", start, value, *ends, σ, unit=unit))
    return found
