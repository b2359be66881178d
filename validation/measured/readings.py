"""A measured value with its uncertainty, and quantities derived from two values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple


class Reading(NamedTuple):
    """A measured value, its standard uncertainty, its unit, and its group of quantities."""

    value: float
    u: float
    unit: str
    group: str


class Derived(NamedTuple):
    """A ratio or a difference of two named quantities, in which common errors cancel."""

    name: str
    group: str
    kind: str  # "ratio" or "difference"
    first: str
    second: str

    def of(self, values: Mapping[str, float]) -> float:
        """Value of the ratio or difference."""
        a, b = values[self.first], values[self.second]
        return a / b if self.kind == "ratio" else a - b

    def reading(self, readings: Mapping[str, Reading]) -> Reading:
        """Derived reading, computed from two readings with independent errors."""
        a, b = readings[self.first], readings[self.second]
        if self.kind == "difference":
            return Reading(a.value - b.value, math.hypot(a.u, b.u), a.unit, self.group)
        quotient = a.value / b.value
        return Reading(quotient, abs(quotient) * math.hypot(a.u / a.value, b.u / b.value), "1", self.group)
