"""Parameters as coordinates x of a search: logarithms of positive numbers, other numbers over a unit."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Sequence

import numpy as np

from flexlink.common.errors import SceneError
from flexlink.common.types import Array
from flexlink.describe.scene import Scene
from flexlink.describe.units import unit_of
from flexlink.describe.vary import number_in
from flexlink.identification.problem import FitParameter, FitProblem, FitRun


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """A parameter: value = e^x, or unit · x.

    Attributes
    ----------
    path
        Its path in the scene.
    run
        Name of the only run that has it; "" of one for all runs.
    start
        Value where the search begins.
    log
        Whether x is its logarithm.
    unit
        Size of a large change of one that is not.
    between
        Least and largest value.
    prior
        Value and standard deviation that are known already.
    measured_in
        Unit of the value; "" of a pure number.
    """

    path: str
    run: str
    start: float
    log: bool
    unit: float
    between: tuple[float, float]
    prior: tuple[float, float] | None
    measured_in: str = ""

    @property
    def name(self) -> str:
        """How messages call it."""
        return f"{self.path} of run {self.run!r}" if self.run else self.path

    def x(self, value: float) -> float:
        """The coordinate of a value."""
        if self.log:
            return math.log(value) if value > 0 else -math.inf
        return value / self.unit

    def value(self, x: float) -> float:
        """The value at a coordinate; inf where it is beyond float64, as ends of intervals may be."""
        if self.log:
            return math.exp(x) if x < math.log(sys.float_info.max) else math.inf
        return self.unit * x

    def size(self, value: float) -> float:
        """∂value/∂x there."""
        return value if self.log else self.unit

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and largest x."""
        low, high = self.between
        return self.x(low), self.x(high)


def coordinates_of(problem: FitProblem) -> tuple[Coordinate, ...]:
    """All parameters, those of single runs last.

    Raises
    ------
    SceneError
        A path leads nowhere, to several numbers that differ, or to none; or the start is out of bounds.
    """
    found = [coordinate_of(problem.scene, parameter) for parameter in problem.parameter]
    for run in problem.run:
        if run.use == "fit":
            found += own_coordinates(problem, run)
    return tuple(found)


def own_coordinates(problem: FitProblem, run: FitRun) -> list[Coordinate]:
    """Parameters of one run alone; errors as in `coordinates_of`."""
    scene = problem.scene.varied(run.set) if run.set else problem.scene
    return [coordinate_of(scene, parameter, run.name) for parameter in run.parameter]


def coordinate_of(scene: Scene, parameter: FitParameter, run: str = "") -> Coordinate:
    """A number of a scene; errors as in `coordinates_of`."""
    furthest = 1e3  # factor from the start that is tried at most of a logarithm
    value = _value(scene, parameter)
    log = parameter.scale == "log" or (
        parameter.scale == "auto" and value > 0 and not parameter.path.startswith("initial.")
    )
    low, high = parameter.between or (-math.inf, math.inf)
    if log and (value <= 0 or high <= 0):
        raise SceneError(
            f"parameter {parameter.path} = {value!r}: is not positive; give scale = 'linear'",
            id="parameter-not-positive",
        )
    if parameter.prior is not None and log and parameter.prior[0] <= 0:
        raise SceneError(
            f"parameter {parameter.path}: prior = {list(parameter.prior)}: is not positive", id="parameter-not-positive"
        )
    if not parameter.within(value):
        raise SceneError(
            f"parameter {parameter.path} = {value!r}: outside between = {[low, high]}; give start", id="parameter-start"
        )
    if value == 0 and parameter.between is None and not parameter.path.startswith("initial."):
        raise SceneError(
            f"parameter {parameter.path} = {value!r}: how large it may be is not known; give between, or a start",
            id="parameter-start",
        )
    width = (high - low) / 2
    unit = width if math.isfinite(width) else abs(value) or 1.0
    ends = (max(low, value / furthest), min(high, value * furthest)) if log else (low, high)
    said = unit_of(scene, parameter.path)
    return Coordinate(parameter.path, run, value, log, unit, ends, parameter.prior, said)


def _value(scene: Scene, parameter: FitParameter) -> float:
    values = scene.values_at(parameter.path)
    if parameter.start is not None:
        return parameter.start
    try:
        return number_in(values)
    except SceneError as error:
        raise SceneError(f"parameter {parameter.path} = {error}, or give start", id="parameter-start") from None


def prior_rows(coordinates: Sequence[Coordinate], x: Array) -> tuple[Array, Array]:
    """(x − prior) / deviation of those that have one, and its slopes, shape (priors, coordinates)."""
    known = [(k, one) for k, one in enumerate(coordinates) if one.prior is not None]
    residual, slopes = np.zeros(len(known)), np.zeros((len(known), len(coordinates)))
    for row, (k, one) in enumerate(known):
        mean, deviation = one.prior or (0.0, 1.0)
        weight = one.size(mean) / deviation
        residual[row], slopes[row, k] = (x[k] - one.x(mean)) * weight, weight
    return residual, slopes
