"""Run the ladder of settings of a formulation, and choose its cheapest run for an error.

Besides formulations of a bending link, other programs compute the chain exported by flexlink, and `advise` picks a
chain for each error.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from flexlink.common.errors import FlexlinkError
from validation.formulations.task import Outcome, Run, Setting, Task

REPEATS = 3
SHORT = 0.05  # s of CPU; a shorter run is timed several times, and the least time counts


class Formulation(NamedTuple):
    """The program, its package ("" if always installed), its module in this folder and the kind of element."""

    program: str
    package: str
    module: str
    element: str

    @property
    def installed(self) -> bool:
        """Whether its package is installed."""
        return not self.package or importlib.util.find_spec(self.package) is not None

    @property
    def is_exported_chain(self) -> bool:
        """Whether another program computes flexlink's chain."""
        return self.module.endswith("_chains")

    @property
    def run(self) -> Run:
        """Its function that computes a task."""
        found: Run = importlib.import_module(f"validation.formulations.{self.module}").run
        return found


FORMULATIONS: Mapping[str, Formulation] = {
    "chain, gauss": Formulation("native", "", "flexlink_links", "gauss"),
    "chain, lobatto4": Formulation("native", "", "flexlink_links", "lobatto4"),
    "strain modes": Formulation("native", "", "flexlink_links", "lobatto4 eigenmodes"),
    "strain polynomials": Formulation("native", "", "flexlink_links", "lobatto4 polynomials"),
    "Exudyn ANCF cable": Formulation("exudyn", "exudyn", "exudyn_elements", "ANCFCable2D"),
    "Exudyn geometrically exact": Formulation("exudyn", "exudyn", "exudyn_elements", "GeometricallyExact2D"),
    "Exudyn geometrically exact, 3D": Formulation("exudyn", "exudyn", "exudyn_elements", "GeometricallyExact"),
    "Exudyn FFRF": Formulation("exudyn", "exudyn", "exudyn_frames", ""),
    "MuJoCo flex, springs": Formulation("mujoco", "mujoco", "mujoco_flexes", "springs"),
    "MuJoCo flex, constraints": Formulation("mujoco", "mujoco", "mujoco_flexes", "constraints"),
    "PyElastica": Formulation("elastica", "elastica", "elastica_rods", ""),
    "MuJoCo chain, RK4": Formulation("mujoco", "mujoco", "exported_chains", "mujoco RK4"),
    "MuJoCo chain, implicit": Formulation("mujoco", "mujoco", "exported_chains", "mujoco implicit"),
    "MuJoCo chain, implicitfast": Formulation("mujoco", "mujoco", "exported_chains", "mujoco implicitfast"),
    "Pinocchio chain, DOP853": Formulation("pinocchio", "pinocchio", "exported_chains", "pinocchio DOP853"),
    "Pinocchio chain, Radau": Formulation("pinocchio", "pinocchio", "exported_chains", "pinocchio Radau"),
    "Drake chain, runge_kutta3": Formulation("drake", "pydrake", "exported_chains", "drake runge_kutta3"),
    "Drake chain, radau3": Formulation("drake", "pydrake", "exported_chains", "drake radau3"),
    "advise": Formulation("native", "", "flexlink_links", "advise"),
}
"""Name in cases and results → formulation."""

ADVISE = "advise"  # picks a chain and its steps: not a formulation that others are compared with


class Rung(NamedTuple):
    """A run: its settings, relative error of the tip (inf if it failed), CPU seconds, coordinates, a remark."""

    setting: Setting
    error: float
    seconds: float
    coordinates: int
    note: str = ""

    @property
    def words(self) -> str:
        """The settings in one line."""
        return ", ".join(f"{name} {value:.4g}" for name, value in self.setting.items())


def climb(task: Task, formulation: Formulation, ladder: Mapping[str, Sequence[float]]) -> list[Rung]:
    """Run all combinations of settings, one after the other, also on a slow machine: what they reach is checked."""
    run, element, names = formulation.run, formulation.element, [*ladder]
    return [
        _rung(task, run, element, dict(zip(names, values, strict=True)))
        for values in itertools.product(*ladder.values())
    ]


def _rung(task: Task, run: Run, element: str, setting: Setting) -> Rung:
    first = attempt(task, run, element, setting)
    if first is None or not math.isfinite(error := task.error(first.tip)):
        return Rung(
            setting, math.inf, 0.0 if first is None else first.seconds, 0 if first is None else first.coordinates
        )
    more = REPEATS - 1 if first.seconds < SHORT and not first.counted else 0
    again = (run(task, element, setting).seconds for _ in range(more))
    return Rung(setting, error, min((first.seconds, *again)), first.coordinates, first.note)


def attempt(task: Task, run: Run, element: str, setting: Setting) -> Outcome | None:
    """A run; None if the program gives up. Faults in adapters stay errors."""
    with contextlib.suppress(FlexlinkError, *_refusals()):
        return run(task, element, setting)
    return None


def _refusals() -> Iterator[type[Exception]]:
    """Exceptions by which other programs report that a run has failed."""
    if importlib.util.find_spec("exudyn"):
        yield importlib.import_module("exudyn").SolverError


def cheapest(rungs: Sequence[Rung], error: float) -> Rung | None:
    """The rung with the least CPU time among those that reach the error."""
    return min((rung for rung in rungs if rung.error <= error), key=lambda rung: rung.seconds, default=None)


def smallest(rungs: Sequence[Rung], error: float) -> Rung | None:
    """The rung with the fewest coordinates among those that reach the error; the cheaper of equal ones."""
    good = (rung for rung in rungs if rung.error <= error)
    return min(good, key=lambda rung: (rung.coordinates, rung.seconds), default=None)


def most_accurate(rungs: Sequence[Rung]) -> Rung | None:
    """The rung with the least error; None if all failed."""
    return min((rung for rung in rungs if math.isfinite(rung.error)), key=lambda rung: rung.error, default=None)
