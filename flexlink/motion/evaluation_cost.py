"""CPU time of a run's steps: number of each of their operations times its listed cost.

Methods are chosen by these costs, so the choice does not depend on the speed of the machine. Set-up and samples are not
included. An operation costs a constant, plus a part for each body (by its number of hinges), coupling, joint with dry
friction, driven joint, and body of the rigid model that a control law evaluates. An evaluation is a stage of an
explicit method, or a stage in one Newton iteration of an implicit one. The costs were measured on one machine;
`machine_factor` scales them to this one.
"""

from __future__ import annotations

import functools
import math
import operator
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.types import Array
from flexlink.data.documents import read_toml
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Spec, decode
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.inputs.laws import PD_GRAVITY, TABLE
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate

Bodies = NDArray[np.intp]
"""Number of bodies with 0, 1, 2, 3 hinges, shape (4,)."""

OPERATIONS = (
    "evaluation", "step", "beginning", "preparation", "weighing", "stage_matrix", "stage_solution", "answer",
    "multiplication",
)  # fmt: skip
"""Operations of a step.

Evaluations; attempted steps; restarts at a knot; factorizations of a stage's linear systems (implicit methods);
weightings of the error of the rates; matrices of single stages, and solutions with them; responses of a stage to
friction at a joint; multiplications in the small system of these responses.
"""


class Rate(Spec, frozen=True):
    """Cost of an operation [µs]: `start`, `body` for each body with 0, 1, … hinges, and one cost per other item."""

    start: NonNegative = 0.0
    body: tuple[NonNegative, ...] = ()
    coupling: NonNegative = 0.0
    dry: NonNegative = 0.0
    """For each joint with dry friction."""
    driven: NonNegative = 0.0
    """For each driven joint."""
    model: NonNegative = 0.0
    """For each driven joint whose control law evaluates a rigid model."""

    @property
    def parts(self) -> list[float]:
        """Costs in the order of `parts_of`."""
        bodies = [*self.body, *[0.0] * (4 - len(self.body))]
        return [self.start, *bodies, self.coupling, self.dry, self.driven, self.model]


Rates = dict[str, dict[str, dict[str, dict[str, Rate]]]]
"""Rates by plane or space, plain or full chain, kind of method, and operation."""


@functools.cache
def rates() -> Rates:
    """Measured rates of chains in a `plane` or in `space`, `plain` or `full`, by `explicit` or `implicit` methods."""
    return decode(read_toml(Path(__file__).parent / "data" / "evaluation_costs.toml"), Rates)


@functools.cache
def listed(place: str, has: str, kind: str) -> list[list[float]]:
    """Rates of `OPERATIONS` [µs], each with its `parts`; read-only."""
    found = rates()[place][has][kind]
    return [found[name].parts if name in found else [0.0] * 9 for name in OPERATIONS]


def bodies_of(chain: Chain) -> Bodies:
    """Number of bodies of a chain with 0, 1, 2, 3 hinges, without the tip frame."""
    hinges = (chain.bodies["stop"] - chain.bodies["first"])[:-1]
    return np.bincount(np.minimum(hinges, 3), minlength=4)


def parts_of(chain: Chain, drive: Drive | None) -> Array:
    """Multipliers of an operation's costs on a chain, (9,): 1, bodies by hinges, couplings, joints by kind.

    A torque table, such as torques held from outside, costs almost nothing.
    """
    driven = 0 if drive is None or drive.law == TABLE else len(drive.joints)
    model = driven if drive is not None and drive.law >= PD_GRAVITY else 0
    dry = np.count_nonzero(chain.hinges["coulomb"])
    return np.array([1.0, *bodies_of(chain), len(chain.couplings), dry, driven, model])


def operation_costs(chain: Chain, *, explicit: bool, drive: Drive | None = None) -> list[float]:
    """CPU time of each of `OPERATIONS` [s] on a chain under a drive, if there is one.

    A sampled control law is evaluated at restarts, any other at every stage. A motor with a torque limit is checked
    after each step.
    """
    has = "plain" if chain.arrays.rare is None else "full"
    costs = listed("plane" if chain.is_planar else "space", has, "explicit" if explicit else "implicit")
    parts = parts_of(chain, drive)
    counted = [True] * 9
    if drive is not None:
        limited = min(drive.effort.tolist(), default=np.inf) < np.inf and not drive.rate
        counted = [not drive.rate, limited, drive.rate > 0, *[False] * 6]
    all_parts = [*parts[:7].tolist(), 0.0, 0.0], parts.tolist()
    return [1e-6 * sum(map(operator.mul, row, all_parts[a])) for row, a in zip(costs, counted, strict=True)]


def evaluation_cost(chain: Chain, *, explicit: bool) -> float:
    """CPU time of one evaluation [s] on a chain; for an implicit method with its share of a step's other operations."""
    return _evaluation_cost(chain, 0 if explicit else 3, explicit=explicit)


def run_cost(chain: Chain, name: str, evaluations: float) -> float:
    """CPU time [s] of a number of evaluations by the named method, with the other operations of its steps."""
    rule = method(name)
    stages = rule.stages if rule.controlled or not rule.explicit else 0
    return evaluations * _evaluation_cost(chain, stages, explicit=rule.explicit)


def _evaluation_cost(chain: Chain, stages: int, *, explicit: bool) -> float:
    """CPU time of one evaluation [s], with its share of the other operations of a step of `stages` stages; 0: none."""
    costs = operation_costs(chain, explicit=explicit)
    if stages == 0:
        return costs[0]
    return cost_of_a_step(costs, stages, explicit=explicit) / (_passes(explicit) * stages)


def cost_of_a_step(costs: list[float], stages: int, *, explicit: bool) -> float:
    """CPU time of one attempted step [s] from the costs of `OPERATIONS`.

    Each error is weighted with three time constants; an explicit method has two errors, an implicit one has one.
    """
    systems, weighed = (0, 6) if explicit else (stages, 3)
    often = [_passes(explicit) * stages, 1, 0, systems, weighed, 0, 0, 0, 0]
    return math.fsum(map(operator.mul, costs, often))


def _passes(explicit: bool) -> int:
    """Newton iterations in a step; 1 for an explicit method."""
    return 1 if explicit else 2


def step_cost(chain: Chain, name: str) -> float:
    """CPU time of one step [s]; an implicit step takes two Newton iterations."""
    rule = method(name)
    return run_cost(chain, name, _passes(rule.explicit) * rule.stages)


def machine_factor(problem: InitialValueProblem) -> float:
    """Measured cost of an evaluation on this machine relative to the listed one; takes about 5 ms."""
    drive = problem.inputs.drive
    return evaluation_time(problem) / operation_costs(problem.chain, explicit=True, drive=drive)[0]


def evaluation_time(problem: InitialValueProblem) -> float:
    """Measured CPU time [s] of one stage of an explicit method in its compiled loop: the minimum of five."""
    state = problem.q.copy(), problem.qd.copy(), np.zeros(1)
    none = *np.empty((2, 0, problem.chain.n)), np.empty(0)
    rule = method("RK2")
    steps_of_no_length = problem.workspace(), rule.arrays, problem.inputs, 0.0

    def taken(steps: int) -> float:
        started = time.thread_time()
        integrate(*steps_of_no_length, 0, 0, steps, np.inf, NEVER, state, none)
        return time.thread_time() - started

    taken(1)  # compiles
    steps = 1
    while taken(steps) < 5e-4:  # [s], hundreds of times the resolution of any clock
        steps *= 2
    return min(taken(steps) for _ in range(5)) / (steps * rule.stages)
