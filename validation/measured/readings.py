"""A measured value with its uncertainty, and quantities derived from two values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.types import Array


class Reading(NamedTuple):
    """A measured value, its standard uncertainty, its unit, and its group of quantities."""

    value: float
    u: float
    unit: str
    group: str


class FittedInputs(NamedTuple):
    """Inputs of the model that were fitted to measurements: paths, values, and the covariance C of their errors.

    C is often so wide along combinations that the data do not determine that only derivatives at the values are used.
    """

    paths: Sequence[str]
    values: Array
    covariance: Array

    def effects(self, of: Callable[[Mapping[str, float]], Mapping[str, float]]) -> dict[str, dict[str, float]]:
        """Independent parts of the errors → effects on each quantity that `of` computes from values by path.

        The parts are the columns of V with V Vᵀ = C, and their effects J V, so that the root sum of squares is
        √(J C Jᵀ). J is found by central differences, with steps of `share` of the values, or of deviations if smaller.
        """
        share = 1e-3
        deviations = np.sqrt(np.diag(self.covariance))
        steps = share * np.diag(np.minimum(np.maximum(np.abs(self.values), share), deviations))
        ends = [(of(self.at(self.values - step)), of(self.at(self.values + step))) for step in steps]
        squares, axes = np.linalg.eigh(self.covariance / np.outer(deviations, deviations))
        parts = deviations[:, None] * axes * np.sqrt(np.maximum(squares, 0.0))
        found: dict[str, dict[str, float]] = {f"fit, part {k + 1}": {} for k in range(len(steps))}
        for name in ends[0][0]:
            J = np.array([high[name] - low[name] for low, high in ends]) / (2 * np.diag(steps))
            for part, effect in zip(found.values(), (J @ parts).tolist(), strict=True):
                part[name] = effect
        return found

    def drawn(self, draws: int, share: float, seed: int) -> list[dict[str, float]]:
        """Random values by path, whose errors are normal with the covariance share² C."""
        random = np.random.default_rng(seed)
        points = random.multivariate_normal(self.values, share**2 * self.covariance, size=draws, method="eigh")
        return [self.at(point) for point in points]

    def at(self, values: Array) -> dict[str, float]:
        """Values by path."""
        return dict(zip(self.paths, values.tolist(), strict=True))


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
