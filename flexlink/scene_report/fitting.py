"""Fit a scene's parameters to a measurement, one at a time, to find which parameter best explains the difference.

    min over x of Σ r(x)²        r = (run − measured) / scale of the column, at all times

Each fit is fast and has one parameter; scales replace the unknown noise. Standard deviations allow for autocorrelation.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy

from flexlink.common.errors import FlexlinkError
from flexlink.common.types import Array
from flexlink.data.csv_table import Measured
from flexlink.describe.numbers import within
from flexlink.describe.scene import Scene
from flexlink.dynamics.rounding import EPS, ROUNDINGS
from flexlink.identification.fit import quick_estimates
from flexlink.identification.problem import FitParameter, FitProblem, FitRun
from flexlink.motion.simulate import simulate
from flexlink.results.trajectory import Trajectory


class Tried(NamedTuple):
    """A parameter that may be wrong: its path, a description, and its value in the scene."""

    path: str
    what: str
    value: float

    @property
    def is_angle(self) -> bool:
        """Whether it is an initial position [deg, m], which may be zero; all other parameters are positive."""
        return self.path.startswith("initial.joint_")

    @property
    def sign(self) -> str:
        """Unit of an initial position, to be appended to its value."""
        return " m" if self.path.startswith("initial.joint_m") else "°"


@dataclasses.dataclass(frozen=True)
class Fit:
    """The value of a parameter for which the run is closest to the measurement."""

    number: Tried
    value: float
    spread: float  # standard deviation, in the parameter's unit
    explained: float  # fraction of the mean square difference that this value removes
    off: dict[str, float]  # remaining root mean square difference of each column [SI]
    run: Trajectory  # with this value

    @property
    def factor(self) -> float | None:
        """Best value divided by the scene's value; None for an initial position."""
        return None if self.number.is_angle else self.value / self.number.value

    @property
    def remaining(self) -> float:
        """Root mean square difference after the fit, divided by the difference before the fit."""
        return math.sqrt(max(1.0 - self.explained, 0.0))


def numbers_of(scene: Scene) -> Iterator[Tried]:
    """Yield parameters that are seldom known well: stiffness, density, payload, damping, friction, initial position."""
    arm = scene.arm
    bending = [link.material for link in arm.links if link.flex != "rigid"]
    of_material = {"young": "stiffness", "density": "density", "loss_time": "damping"}
    of_rigidity = {"stiffness_factor": "stiffness", "mass_factor": "mass", "loss_time": "damping"}
    for kind, records, names, keys in (
        ("material", arm.materials, bending, of_material),
        ("rigidity", arm.rigidities, [link.rigidity for link in arm.links], of_rigidity),
    ):
        for name, (key, what) in itertools.product(dict.fromkeys(filter(None, names)), keys.items()):
            part = f'"{name}"' if "." in name else name
            if value := getattr(records[name], key):
                yield Tried(f"{kind}.{part}.{key}", f"{what} of {name}", value)
    if arm.tip.mass:
        yield Tried("tip.mass", "payload", arm.tip.mass)
    for number, (link, start) in enumerate(zip(arm.links, scene.starts, strict=True), 1):
        joint = link.joint
        for key, what in (("gear_stiffness", "gear's stiffness"), ("viscous", "friction"), ("armature", "rotor")):
            value = getattr(joint, key)
            if value and not (joint.locked and key != "gear_stiffness"):
                yield Tried(f"link.{number}.joint.{key}", f"{what} of {link.name}", value)
        for axis, (stiffness, _) in link.root_springs.items():
            what = f"stiffness of the root of {link.name} about {axis}"
            yield Tried(f"link.{number}.root_stiffness.{axis}", what, stiffness)
        led = any(motion.link in (number, link.name) for motion in scene.motion)
        if not joint.locked and scene.initial.q is None and not led:
            yield Tried(f"initial.joint_{joint.terms.unit}.{number}", f"start of {link.name}", start)


class Comparison:
    """Comparison of a scene's run with a measurement."""

    def __init__(self, scene: Scene, run: Trajectory, measured: Measured) -> None:
        inside = within(measured.t, run.t[0], run.t[-1])
        self.t, self.left_out = measured.t[inside], int((~inside).sum())
        columns = {name: column[inside] for name, column in measured.columns.items()}
        self.measured = {name: column for name, column in columns.items() if np.isfinite(column).any()}
        self.run, self.scene, spacing = run, scene, scene.run.spacing
        if self.t.size:
            last = min(math.ceil(float(self.t[-1] - run.t[0]) / spacing) * spacing, scene.run.duration)
            self.scene = scene.varied({"run.duration": max(last, spacing)})

    def at_times(self, run: Trajectory) -> dict[str, Array]:
        """Return the measured columns of a run at the measured times, by cubic splines through its samples."""
        columns = run.columns
        return {name: scipy.interpolate.CubicSpline(run.t, columns[name])(self.t) for name in self.measured}

    def differences(self, run: Trajectory) -> dict[str, Array]:
        """Return run minus measurement for every column; nan at unmeasured times."""
        return {name: column - self.measured[name] for name, column in self.at_times(run).items()}

    def off(self, run: Trajectory) -> dict[str, float]:
        """Return the root mean square difference of every column."""
        return {name: float(np.sqrt(np.nanmean(column**2))) for name, column in self.differences(run).items()}

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Scale of the differences in each column: largest standard deviation of any column with the same unit."""
        unit = {name: name.rpartition("[")[2] for name in self.measured}
        spread = {name: float(np.nanstd(column) or np.nanmax(np.abs(column))) for name, column in self.measured.items()}
        return {name: max(spread[other] for other in unit if unit[other] == unit[name]) or 1.0 for name in unit}

    def residual(self, run: Trajectory) -> Array:
        """Return all differences, each divided by the scale of its column."""
        joined = np.concatenate([column / self.sizes[name] for name, column in self.differences(run).items()])
        return np.asarray(joined[np.isfinite(joined)])

    @property
    def differs(self) -> bool:
        """Whether a column differs by more than the rounding errors of a spline, 10 eps times the column's size."""
        size = {name: float(np.nanmax(np.abs(column))) for name, column in self.measured.items()}
        off = self.differences(self.run)
        return any(bool((np.abs(off[name]) > ROUNDINGS * EPS * size[name]).any()) for name in size)

    @cached_property
    def fits(self) -> tuple[Fit, ...]:
        """Fits of all parameters that explain part of the difference, best fit first."""
        before = self.residual(self.run)
        found = [self.fit(number, before) for number in numbers_of(self.scene)] if self.differs else []
        return tuple(sorted((fit for fit in found if fit is not None), key=lambda fit: -fit.explained))

    def fit(self, number: Tried, before: Array) -> Fit | None:
        """Fit one parameter; None if it explains almost nothing, or if no run with another value succeeds."""
        parameter = FitParameter(path=number.path)
        tolerance, worth = 1e-6, 0.02  # relative tolerance of adaptive steps; smallest useful explained fraction
        try:
            problem = FitProblem(
                scene=self.scene, parameter=(parameter,), run=(self._recorded,), noise="white", tolerance=tolerance
            )
            if not (found := quick_estimates(problem, worth)):
                return None
            run = simulate(self.scene.varied({number.path: found[0].value}))
        except FlexlinkError:
            return None
        left = self.residual(run)
        explained = 1.0 - float(left @ left) / float(before @ before)
        return Fit(number, found[0].value, found[0].deviation, explained, self.off(run), run)

    @cached_property
    def _recorded(self) -> FitRun:
        columns = {"t [s]": self.t} | self.measured
        return FitRun(name="measured", columns={k: tuple(v.tolist()) for k, v in columns.items()}, noise=self.sizes)
