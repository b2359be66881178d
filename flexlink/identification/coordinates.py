"""Parameters as search coordinates x: logarithms of positive parameters, others divided by a typical change."""

import dataclasses
import math
import sys
from collections.abc import Sequence
from typing import Literal

import numpy as np

from flexlink.common.errors import Diagnostic, FlexlinkError, SceneError
from flexlink.common.types import Array
from flexlink.data.csv_table import head_of
from flexlink.describe.plausibility.hints import hints
from flexlink.describe.plausibility.sizes import shown
from flexlink.describe.scene import FIELDS, Scene
from flexlink.describe.spec import bare_type, type_below, units_of
from flexlink.describe.vary import number_in, routes_to
from flexlink.identification.problem import FitParameter, FitProblem, FitRun

Timing = Literal["delay", "clock", "start"]  # unknowns of the times of a run's data
OF_TIMING: dict[Timing, tuple[float, float, str]] = {
    "delay": (0.01, 0.1, "s"), "clock": (0.02, 0.05, ""), "start": (0.01, 0.2, "s")
}  # fmt: skip
"""Typical large change of each of these unknowns, its bounds ±, and its unit."""


@dataclasses.dataclass(frozen=True)
class Coordinate:
    """A parameter as a search coordinate x: value = e^x, or value = unit · x."""

    path: str  # path in the scene
    run: str  # name of the run that the parameter belongs to; "" for a parameter of all runs
    start: float  # initial guess
    log: bool  # whether x is the logarithm of the value
    unit: float  # typical large change of the value, if x is not its logarithm
    between: tuple[float, float]  # lower and upper bound
    prior: tuple[float, float] | None  # mean and standard deviation of the prior, if there is one
    measured_in: str = ""  # unit of the value; "" for a dimensionless number
    # for the time of a run's data: "delay", "clock" or "start"; "" for a number of the scene
    timing: Timing | Literal[""] = ""
    column: str = ""  # column with the delay

    @property
    def name(self) -> str:
        """Name of the parameter in messages."""
        if self.timing:
            what = {"delay": f"delay of {self.column}", "clock": "clock rate error", "start": "start"}[self.timing]
            return f"{what} of {self.run!r}"
        return f"{self.path} of run {self.run!r}" if self.run else self.path

    def x(self, value: float) -> float:
        """Search coordinate x of a value of the parameter."""
        if self.log:
            return math.log(value) if value > 0 else -math.inf
        return value / self.unit

    def value(self, x: float) -> float:
        """Value at a coordinate; inf if it overflows float64, which can happen at the end of an interval."""
        if self.log:
            return math.exp(x) if x < math.log(sys.float_info.max) else math.inf
        return self.unit * x

    def size(self, value: float) -> float:
        """∂value/∂x at a value."""
        return value if self.log else self.unit

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of x."""
        low, high = self.between
        return self.x(low), self.x(high)


def coordinates_of(problem: FitProblem) -> tuple[Coordinate, ...]:
    """Coordinates of all parameters; parameters of single runs come last."""
    of_runs = (one for run in problem.run if run.use == "fit" for one in run_coordinates(problem, run))
    return *(coordinate_of(problem.scene, parameter) for parameter in problem.parameter), *of_runs


def guess_of(coordinates: Sequence[Coordinate]) -> Array:
    """Initial guess, shape (coordinates,)."""
    return np.array([one.x(one.start) for one in coordinates])


def run_coordinates(problem: FitProblem, run: FitRun) -> list[Coordinate]:
    """Coordinates of the parameters of one run; those of its times come last."""
    scene = problem.scene.varied(run.set) if run.set else problem.scene
    return [*(coordinate_of(scene, parameter, run.name) for parameter in run.parameter), *timings(run)]


def timings(run: FitRun) -> list[Coordinate]:
    """Coordinates of the unknown delays, clock rate error and start of a run."""
    unknown: list[tuple[Timing, str]] = [("delay", head) for head in run.delay]
    unknown += [("clock", "")] if run.clock else []
    unknown += [("start", "")] if run.start == "unknown" else []
    return [timing_of(kind, run.name, column) for kind, column in unknown]


def timing_of(kind: Timing, run: str, column: str = "") -> Coordinate:
    """Coordinate of an unknown delay of a column, clock rate error or start of a run."""
    change, far, unit = OF_TIMING[kind]
    return Coordinate("", run, 0.0, False, change, (-far, far), None, unit, kind, column)


def shifted(t: Array, begin: float, column: str, timing: Sequence[tuple[Coordinate, float]]) -> Array:
    """Times begin + (t − begin − start) / (1 + clock) − delay of the scene that a column shows at t, shape (n,) [s]."""
    if not timing:
        return t
    of_column = {"", head_of(column)[0]}
    by = {one.timing: one.value(x) for one, x in timing if head_of(one.column)[0] in of_column}
    return begin + (t - begin - by.get("start", 0.0)) / (1 + by.get("clock", 0.0)) - by.get("delay", 0.0)


def coordinate_of(scene: Scene, parameter: FitParameter, run: str = "") -> Coordinate:
    """Coordinate of one parameter of a scene."""
    furthest = 1e3  # default bounds of a logarithmic parameter: this factor below and above the initial guess
    value, initial = _value(scene, parameter), parameter.path.startswith("initial.")
    given = f"parameter {parameter.path} = {value!r}"
    log = parameter.scale == "log" or (parameter.scale == "auto" and value > 0 and not initial)
    low, high = parameter.between or (-math.inf, math.inf)
    if log and (value <= 0 or high <= 0):
        text = f"{given}: must be > 0 on a logarithmic scale; set scale = 'linear'"
        raise SceneError(text, id="parameter-not-positive")
    if parameter.prior is not None and log and parameter.prior[0] <= 0:
        text = f"parameter {parameter.path}: prior = {list(parameter.prior)}: must be > 0"
        raise SceneError(text, id="parameter-not-positive")
    if not parameter.within(value):
        raise SceneError(f"{given}: outside between = {[low, high]}; set start", id="parameter-start")
    if value == 0 and parameter.between is None and not initial:
        raise SceneError(f"{given}: its order of magnitude is unknown; set between or start", id="parameter-start")
    width = (high - low) / 2
    unit = width if math.isfinite(width) else abs(value) or 1.0
    ends = (max(low, value / furthest), min(high, value * furthest)) if log else (low, high)
    return Coordinate(parameter.path, run, value, log, unit, ends, parameter.prior, unit_of(scene, parameter.path))


def hints_on_bounds(problem: FitProblem) -> tuple[Diagnostic, ...]:
    """Hints on parameters whose bounds were both likely given in another unit, one for each parameter."""
    found = []
    for one in problem.parameter:
        several = [_hint_at(problem.scene, one.path, bound) for bound in one.between or ()]
        if several and all(several):
            text = f"parameter {one.path}: between = {shown(one.between or ())}: {several[0]}"
            found.append(Diagnostic(text, "likely-unit"))
    return tuple(found)


def _hint_at(scene: Scene, path: str, value: float) -> str:
    """Hint on a parameter with this value; empty if there is none."""
    try:
        varied = scene.varied({path: value})
    except FlexlinkError:  # the error is reported where the parameter is set
        return ""
    before, key = hints(scene), path.rpartition(".")[2]
    new = (hint for hint in hints(varied) if hint not in before)
    return next((hint for hint in new if hint.partition(" = ")[0].endswith(f".{key}")), "")


def _value(scene: Scene, parameter: FitParameter) -> float:
    values = scene.values_at(parameter.path)
    if parameter.start is not None:
        return parameter.start
    try:
        return number_in(values)
    except SceneError as error:
        reason = f"{error}, or set start"
        if isinstance(values[0], str | bool):
            reason = f"{values[0]!r}: not a number; fit a number, such as material.NAME.young"
        raise SceneError(f"parameter {parameter.path} = {reason}", id="parameter-start") from None


def prior_rows(coordinates: Sequence[Coordinate], x: Array) -> tuple[Array, Array]:
    """Residuals (x − prior) / deviation of all priors, and their Jacobian, shape (priors, coordinates)."""
    known = [(k, one) for k, one in enumerate(coordinates) if one.prior is not None]
    residual, slopes = np.zeros(len(known)), np.zeros((len(known), len(coordinates)))
    for row, (k, one) in enumerate(known):
        mean, deviation = one.prior or (0.0, 1.0)
        weight = one.size(mean) / deviation
        residual[row], slopes[row, k] = (x[k] - one.x(mean)) * weight, weight
    return residual, slopes


def unit_of(scene: Scene, path: str) -> str:
    """Return the unit of the number at a path of `Scene.varied`; "" if it has no unit, or if the unit is ambiguous."""
    found = set()
    for keys, _ in routes_to(scene.document(), FIELDS, path):
        kind = FIELDS[keys[0]]
        units = units_of(kind)
        for key in keys[1:]:
            below = type_below(kind, str(key))
            units = units_of(below) if isinstance(bare_type(kind), type) else units
            kind = below
        if len(units) == 2 and keys[0] == "link" and keys[2] == "joint":  # rad or m
            units = (units[scene.arm.slides[keys[1]]],)
        if len(units) == 2 and keys[0] == "tie":
            tie = scene.tie[keys[1]]
            units = (units[not tie.on_joint or scene.arm.slides[scene.arm.number(tie.link or 0) - 1]],)
        found.add(units[0] if len(units) == 1 else "")
    return found.pop() if len(found) == 1 else ""
