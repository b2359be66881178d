"""CPU time of a run's steps: how often each of their operations was done, times its cost, by a list.

Choices are made by it, so that they do not depend on how fast the machine is; set-up and samples are not in it.
An operation costs a start, and so much for each body by its number of hinges, each coupling, joint with dry friction,
driven joint and body of the rigid model that a law asks. An evaluation is a stage of an explicit method, or a stage in
one pass of Newton's iteration of an implicit one. Costs are those of the machine that the list was measured on;
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
"""What steps are made of: evaluations; tries of steps; new beginnings at a knot; of an implicit method preparations of
the linear systems of a stage; times that the error of rates is weighed; matrices of single stages, solutions with them,
answers of a stage to friction at a joint, and multiplications in the small system of those."""


class Rate(Spec, frozen=True):
    """Cost of an operation [µs]: `start`, `body` for each body with 0, 1, … hinges, and for each of the others one."""

    start: NonNegative = 0.0
    body: tuple[NonNegative, ...] = ()
    coupling: NonNegative = 0.0
    dry: NonNegative = 0.0
    """Of a joint with dry friction."""
    driven: NonNegative = 0.0
    """Of a driven joint."""
    model: NonNegative = 0.0
    """Of a driven joint whose law asks a rigid model."""

    @property
    def parts(self) -> list[float]:
        """As `parts_of` a chain."""
        bodies = [*self.body, *[0.0] * (4 - len(self.body))]
        return [self.start, *bodies, self.coupling, self.dry, self.driven, self.model]


Rates = dict[str, dict[str, dict[str, dict[str, Rate]]]]
"""By where a chain moves, what it has, the kind of method, and the operation."""


@functools.cache
def rates() -> Rates:
    """Those of chains in a `plane` or in `space`, `plain` or `full`, by `explicit` or `implicit` methods, measured."""
    return decode(read_toml(Path(__file__).parent / "data" / "evaluation_costs.toml"), Rates)


@functools.cache
def listed(place: str, has: str, kind: str) -> list[list[float]]:
    """The rates of `OPERATIONS` [µs], each with its `parts`; not to be written to."""
    found = rates()[place][has][kind]
    return [found[name].parts if name in found else [0.0] * 9 for name in OPERATIONS]


def bodies_of(chain: Chain) -> Bodies:
    """How many bodies of a chain have 0, 1, 2, 3 hinges, the tip frame not counted."""
    hinges = (chain.bodies["stop"] - chain.bodies["first"])[:-1]
    return np.bincount(np.minimum(hinges, 3), minlength=4)


def parts_of(chain: Chain, drive: Drive | None) -> Array:
    """By what an operation on a chain costs, (9,): one start, bodies by their hinges, couplings, joints by their kind.

    A table of torques, such as those that are held from outside, costs next to nothing.
    """
    driven = 0 if drive is None or drive.law == TABLE else len(drive.joints)
    model = driven if drive is not None and drive.law >= PD_GRAVITY else 0
    dry = np.count_nonzero(chain.hinges["coulomb"])
    return np.array([1.0, *bodies_of(chain), len(chain.couplings), dry, driven, model])


def operation_costs(chain: Chain, *, explicit: bool, drive: Drive | None = None) -> list[float]:
    """CPU time of each of `OPERATIONS` [s] on a chain under a drive, if there is one.

    A law that is sampled is asked where steps begin anew, another one at every stage; a motor with a largest torque is
    looked at after each step.
    """
    has = "plain" if chain.arrays.rare is None else "full"
    costs = listed("plane" if chain.is_planar else "space", has, "explicit" if explicit else "implicit")
    parts = parts_of(chain, drive)
    asked = [True] * 9
    if drive is not None:
        limited = min(drive.effort.tolist(), default=np.inf) < np.inf and not drive.rate
        asked = [not drive.rate, limited, drive.rate > 0, *[False] * 6]
    all_parts = [*parts[:7].tolist(), 0.0, 0.0], parts.tolist()
    return [1e-6 * sum(map(operator.mul, row, all_parts[a])) for row, a in zip(costs, asked, strict=True)]


def evaluation_cost(chain: Chain, *, explicit: bool) -> float:
    """CPU time of one evaluation [s] of a chain; of an implicit method with its share of what else a step does."""
    return _evaluation_cost(chain, 0 if explicit else 3, explicit=explicit)


def run_cost(chain: Chain, name: str, evaluations: float) -> float:
    """CPU time [s] of so many evaluations by the method of this name, with what else its steps do."""
    rule = method(name)
    stages = rule.stages if rule.controlled or not rule.explicit else 0
    return evaluations * _evaluation_cost(chain, stages, explicit=rule.explicit)


def _evaluation_cost(chain: Chain, stages: int, *, explicit: bool) -> float:
    """One evaluation, with its share of a step of so many stages; 0: none."""
    costs = operation_costs(chain, explicit=explicit)
    if stages == 0:
        return costs[0]
    return cost_of_a_step(costs, stages, explicit=explicit) / (_passes(explicit) * stages)


def cost_of_a_step(costs: list[float], stages: int, *, explicit: bool) -> float:
    """CPU time of one try of a step [s] whose `OPERATIONS` cost so much: an error is weighed at three times.

    Of an explicit method each of two.
    """
    systems, weighed = (0, 6) if explicit else (stages, 3)
    often = [_passes(explicit) * stages, 1, 0, systems, weighed, 0, 0, 0, 0]
    return math.fsum(map(operator.mul, costs, often))


def _passes(explicit: bool) -> int:
    """Of Newton's iteration in a step."""
    return 1 if explicit else 2


def step_cost(chain: Chain, name: str) -> float:
    """CPU time of one step [s]; of an implicit method in two passes of Newton's iteration."""
    rule = method(name)
    return run_cost(chain, name, _passes(rule.explicit) * rule.stages)


def machine_factor(problem: InitialValueProblem) -> float:
    """How many times the listed cost an evaluation takes on this machine, measured in about 5 ms."""
    drive = problem.inputs.drive
    return evaluation_time(problem) / operation_costs(problem.chain, explicit=True, drive=drive)[0]


def evaluation_time(problem: InitialValueProblem) -> float:
    """Measured CPU time [s] of one stage of an explicit method in its compiled loop: the shortest of five times."""
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
