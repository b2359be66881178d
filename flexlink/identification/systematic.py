"""Errors of a fit that more data do not reduce, in its intervals: grid error, and errors of recorded motions.

half-width = k √(σ² + u_num² + u_input²)        as in ASME V&V 20-2009, section 1
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.common.wording import Diagnostic
from flexlink.describe.scene import Scene
from flexlink.identification.coordinates import Coordinate
from flexlink.identification.estimate import Estimate
from flexlink.identification.grid import RICHARDSON, Grid, GridError, bends, grid_error, warnings_of_grid
from flexlink.identification.inner_gyroscopes import errors_of_inner_gyroscopes
from flexlink.identification.inputs import InputError, input_error, warnings_of_inputs
from flexlink.identification.likelihood import Likelihood
from flexlink.identification.problem import FitProblem
from flexlink.identification.solve import Found, Search


class Systematic(NamedTuple):
    """Grid error, and error of recorded motions; None if there is none.

    The grid error has a second part: changes of the coordinates by inner gyroscopes.
    """

    grid: GridError = GridError(np.empty(0))
    inputs: InputError | None = None
    gyroscopes: tuple[Array, ...] = ()

    def added(
        self, numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], x: Array, wide: float
    ) -> tuple[Estimate, ...]:
        """The estimates, with these errors in their intervals; `wide` is the half-width of one over its deviation."""
        found = with_error(numbers, coordinates, x, self.u_num, wide, "u_num")
        if self.inputs is not None:
            found = with_error(found, coordinates, x, self.inputs.errors, wide, "u_input")
        return found

    @property
    def u_num(self) -> Array:
        """Error of the coordinates, gains, biases and drifts by the number of segments."""
        errors = self.grid.errors
        return np.sqrt(errors**2 + sum(np.pad(one, (0, len(errors) - len(one))) ** 2 for one in self.gyroscopes))

    @property
    def shifts(self) -> list[Array]:
        """Changes of the search coordinates, whose outer products add to their covariance."""
        return [
            RICHARDSON * self.grid.change,
            *self.gyroscopes,
            *(self.inputs.changes if self.inputs is not None else ()),
        ]

    def warnings(self, scene: Scene, numbers: Sequence[Estimate]) -> tuple[Diagnostic, ...]:
        """Warnings about errors that exceed half of an interval, or that are unknown."""
        return (*warnings_of_grid(scene, numbers, self.grid), *warnings_of_inputs(numbers, self.inputs))


def systematic_errors(
    search: Search, best: Found, at: Likelihood, problem: FitProblem, grid: Grid, report: Callable[[str], None]
) -> Systematic:
    """Errors at a solution with this likelihood."""
    coarse, gyroscopes = GridError(np.empty(0)), list[Array]()
    if grid != "ignore" and bends(problem.scene):
        report("grid error: fitting a model with twice the hinges")
        coarse = grid_error(search, best, at, problem.tolerance)
        try:
            gyroscopes = errors_of_inner_gyroscopes(search, best) if coarse.doubt is None else []
        except FlexlinkError as error:
            unknown = Diagnostic(f"grid error of gyroscopes not estimated: {error}", "grid-error-unknown")
            coarse = coarse._replace(doubt=unknown)
    return Systematic(coarse, input_error(search, best, problem), tuple(gyroscopes))


def with_error(
    numbers: Sequence[Estimate], coordinates: Sequence[Coordinate], x: Array, errors: Array, wide: float, name: str
) -> tuple[Estimate, ...]:
    """The estimates with a further error in their intervals, "u_num" or "u_input", in search coordinates.

    `errors` may be shorter than `numbers`; `wide` is the half-width of an interval over its deviation.
    """
    found = list(numbers)
    for k, (one, u) in enumerate(zip(numbers, errors.tolist(), strict=False)):
        by = coordinates[k] if k < len(coordinates) else None
        at = float(x[k]) if by is not None else one.value
        low, high = (end if by is None else by.x(end) for end in (one.low, one.high))
        low, high = at - math.hypot(at - low, wide * u), at + math.hypot(high - at, wide * u)
        size = 1.0 if by is None else by.size(one.value)
        ends = (low, high) if by is None else (by.value(low), by.value(high))
        statistical = min(one.half, one.statistical)
        deviation, of_kind = math.hypot(one.deviation, size * u), {name: size * u}
        found[k] = dataclasses.replace(
            one, low=ends[0], high=ends[1], deviation=deviation, statistical=statistical, **of_kind
        )
    return tuple(found)


def within_bounds(one: Estimate) -> Estimate:
    """The estimate, with a finite interval clipped to the bounds of the search."""
    low, high = one.between
    return dataclasses.replace(one, low=max(one.low, low), high=min(one.high, high)) if np.isfinite(one.half) else one


def covariance_of(coordinates: Sequence[Coordinate], x: Array, covariance: Array, shifts: Sequence[Array]) -> Array:
    """Covariance of the estimates in their units, with common shifts u of the coordinates: C + Σ u uᵀ."""
    sizes = [one.size(one.value(float(at))) for one, at in zip(coordinates, x, strict=True)]
    scale = np.append(sizes, np.ones(len(covariance) - len(sizes)))
    several = [np.pad(u, (0, len(scale) - len(u))) for u in shifts]
    return np.asarray(scale[:, None] * (covariance + sum(np.outer(u, u) for u in several)) * scale)
