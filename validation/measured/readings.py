"""A measured value with its uncertainty, and what is derived of two of them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple


class Reading(NamedTuple):
    """A measured value, its standard uncertainty, its unit, and the group of quantities that it is judged with."""

    value: float
    u: float
    unit: str
    group: str


class Derived(NamedTuple):
    """A quotient or a difference of two quantities, by their names: what they have in common falls out."""

    name: str
    group: str
    kind: str  # "ratio" or "difference"
    first: str
    second: str

    def of(self, values: Mapping[str, float]) -> float:
        """Its value."""
        a, b = values[self.first], values[self.second]
        return a / b if self.kind == "ratio" else a - b

    def reading(self, readings: Mapping[str, Reading]) -> Reading:
        """Of two readings whose errors have nothing to do with each other."""
        a, b = readings[self.first], readings[self.second]
        if self.kind == "difference":
            return Reading(a.value - b.value, math.hypot(a.u, b.u), a.unit, self.group)
        quotient = a.value / b.value
        return Reading(quotient, abs(quotient) * math.hypot(a.u / a.value, b.u / b.value), "1", self.group)
