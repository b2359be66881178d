"""Injected faults: which functions return wrong results, and how results of each type get a relative error."""

import contextlib
import dataclasses
import functools
import importlib
import inspect
import sys
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any, NamedTuple

import msgspec
import numpy as np
import pytest

from flexlink.describe.schemes.methods import Method
from flexlink.dynamics.conserved import Energy
from flexlink.dynamics.equilibrium import Equilibrium
from flexlink.results.trajectory import Trajectory

Wrong = Callable[[Any, float], Any]
"""Function (value, relative error) → wrong value."""

CALLERS = "validation", "flexlink.diagnosis.native", "flexlink.diagnosis.comparison"
"""Modules that get the wrong function: the study, and the library as an engine. Other modules get the right one."""


def scaled(value: Any, size: float) -> Any:
    """Multiply every number by 1 + size."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(scaled(part, size) for part in value))
    if isinstance(value, Equilibrium):
        return dataclasses.replace(value, q=scaled(value.q, size))
    if hasattr(value, "eigenvalues"):
        return dataclasses.replace(value, eigenvalues=scaled(value.eigenvalues, size))
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        kept = {name: getattr(value, name) for name in names if isinstance(getattr(value, name), (float, np.ndarray))}
        return dataclasses.replace(value, **{name: scaled(part, size) for name, part in kept.items()})  # type: ignore[type-var]
    return value * (1 + size)


def one_sample(run: Trajectory, size: float, row: int | None = None) -> Trajectory:
    """Run with a wrong sample in the middle."""
    factor = np.ones((len(run.t), 1))
    factor[len(run.t) // 2 if row is None else row] += size
    energy = Energy(run.energy.kinetic, run.energy.gravity, run.energy.elastic * factor[:, 0])
    moved: dict[str, Any] = {"q": run.q * factor, "qd": run.qd * factor, "tip": run.tip * factor, "energy": energy}
    return dataclasses.replace(run, **moved)


def at_the_end(run: Trajectory, size: float) -> Trajectory:
    """Run with a wrong last sample."""
    return one_sample(run, size, -1)


def total_energy(run: Trajectory, size: float) -> Trajectory:
    """Run whose energy jumps halfway by a fraction of the largest kinetic energy."""
    jump = np.zeros(len(run.t))
    jump[len(run.t) // 2] = size * np.max(run.energy.kinetic)
    return dataclasses.replace(run, energy=dataclasses.replace(run.energy, elastic=run.energy.elastic + jump))


def decaying(run: Trajectory, size: float) -> Trajectory:
    """Run that decays faster towards its end."""
    return dataclasses.replace(run, tip=run.tip * np.exp(-size * run.t / run.t[-1])[:, None])


class OtherColumns:
    """Run with changed columns; everything else is right."""

    def __init__(self, run: Trajectory, change: Callable[[Any], Any]) -> None:
        self.run, self.columns = run, {name: change(column) for name, column in run.columns.items()}

    def __getattr__(self, name: str) -> Any:
        return getattr(self.run, name)


def sensors(run: Trajectory, size: float) -> Trajectory:
    """Run whose columns are wrong in the middle."""
    middle = np.arange(len(run.t)) == len(run.t) // 2
    return OtherColumns(run, lambda c: np.where(middle, c + size * np.abs(c).max(), c))  # type: ignore[return-value]


def columns(run: Trajectory, size: float) -> Trajectory:
    """Run whose columns are all scaled."""
    return OtherColumns(run, lambda c: c * (1 + size))  # type: ignore[return-value]


def floating(run: Trajectory, size: float) -> Trajectory:
    """Run with wrong attitude, angular rate and momentum of the free base."""
    parts = run.base.attitude, run.base.spin, run.base.momentum
    return dataclasses.replace(run, base=type(run.base)(*(scaled(part, size) for part in parts)))


def weights(method: Method, size: float) -> Method:
    """Runge-Kutta method with part of its second weight moved to the first."""
    moved = Fraction(size)
    first, second, *rest = map(Fraction, method.b or ())
    return msgspec.structs.replace(method, b=(str(first + moved), str(second - moved), *map(str, rest)))


def negative(value: Any, size: float) -> Any:
    """Matrix with the opposite sign."""
    return -size * value


class Function(NamedTuple):
    """Function or method of the library, "module:name" or "module:Class.name", and how its result is wrong."""

    path: str
    wrong: Wrong = scaled


RUN, TERMS, MODAL = "flexlink.motion.simulate:simulate", "flexlink.dynamics.terms", "flexlink.dynamics.vibration.modal"
LIES = {
    "M": Function(f"{TERMS}:mass_matrix"),
    "sign of M": Function(f"{TERMS}:mass_matrix", negative),
    "T_GC": Function(f"{TERMS}:bias_torque"),
    "T_G": Function(f"{TERMS}:gravity_torque"),
    "T_FL": Function(f"{TERMS}:elastic_torque"),
    "T_FR": Function(f"{TERMS}:friction_torque"),
    "ID": Function(f"{TERMS}:inverse_dynamics"),
    "energies": Function("flexlink.dynamics.conserved:energy"),
    "q̈": Function("flexlink.dynamics.accelerations:forward_dynamics"),
    "∂q̈": Function("flexlink.dynamics.derivatives:forward_dynamics_derivatives"),
    "drag": Function("flexlink.dynamics.forces:drag_torque"),
    "loads": Function("flexlink.dynamics.loads:internal_loads"),
    "strain": Function("flexlink.dynamics.strain:beam_strain"),
    "momentum": Function("flexlink.dynamics.conserved:momentum"),
    "overshoot": Function("flexlink.results.trajectory:Trajectory.overshoot"),
    "settling": Function("flexlink.results.trajectory:Trajectory.settling_time"),
    "frames": Function("flexlink.dynamics.placement:frames"),
    "statics": Function("flexlink.dynamics.equilibrium:solve_static"),
    "steady motion": Function("flexlink.dynamics.vibration.steady:equilibrium_in_motion"),
    "buckling": Function("flexlink.dynamics.equilibrium:buckling_loads"),
    "modes": Function(f"{MODAL}:modes"),
    "frequencies": Function(f"{MODAL}:natural_frequencies"),
    "stable step": Function("flexlink.dynamics.vibration.stability:stable_step"),
    "motion": Function(RUN, one_sample),
    "end of motion": Function(RUN, at_the_end),
    "end of run": Function("flexlink.motion.simulate:SingleRun.result", at_the_end),
    "energy of motion": Function(RUN, total_energy),
    "decay of motion": Function(RUN, decaying),
    "sensors": Function(RUN, sensors),
    "columns": Function(RUN, columns),
    "floating base": Function(RUN, floating),
    "run": Function("flexlink.motion.simulate:SingleRun.result", one_sample),
    "weights": Function("flexlink.describe.schemes.methods:method", weights),
}
"""All results that can be made wrong."""


@contextlib.contextmanager
def replaced(function: Function, by: Callable[[Callable[..., Any]], Callable[..., Any]]) -> Iterator[None]:
    """Replace a function in all modules of `CALLERS` that import it."""
    module = importlib.import_module(function.path.partition(":")[0])
    owner, _, name = function.path.partition(":")[2].rpartition(".")
    holder = getattr(module, owner) if owner else module
    honest = inspect.unwrap(getattr(holder, name))
    liar = by(honest)
    public = {"flexlink", *(f"flexlink.{each}" for each in ("details", "fits", "small_motion", "strength"))}
    for each in map(importlib.import_module, public):
        for lazily in each.__all__:  # import now; a lazy import during the fault would cache the wrong function
            getattr(each, lazily)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(holder, name, liar)
        for other in [m for key, m in sys.modules.items() if key in public or key.startswith(CALLERS)]:
            for alias, value in list(vars(other).items()):
                if inspect.isfunction(value) and inspect.unwrap(value) is honest:  # a check of calls may wrap it
                    patch.setattr(other, alias, liar)
        yield


@contextlib.contextmanager
def injected(name: str, size: float, at: int | None) -> Iterator[list[int]]:
    """Inject a fault into call number `at`, or into every call if None; yields the counter of calls."""
    function, calls = LIES[name], [0]

    def by(honest: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(honest)
        def liar(*arguments: Any, **named: Any) -> Any:
            value, number = honest(*arguments, **named), calls[0]
            calls[0] += 1
            return function.wrong(value, size) if size and at in (None, number) else value

        return liar

    with replaced(function, by):
        yield calls
