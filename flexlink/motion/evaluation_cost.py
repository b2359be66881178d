"""CPU time of a run's steps: the number of operations of each kind, times the listed cost of one operation.

Methods are chosen by these costs, so the choice does not depend on the speed of the machine. Set-up and samples are not
included. The cost of an operation is a constant, plus an amount for each body (by its number of hinges), coupling,
joint with dry friction, driven joint, and driven joint whose control law evaluates a rigid model. An evaluation is a
stage of an explicit method, or a stage in one Newton iteration of an implicit one. The costs were measured on one
machine; `machine_factor` scales them to the present one.
"""

import functools
import math
import operator
import time
from pathlib import Path

import numpy as np

from flexlink.chain.chain import Chain
from flexlink.common.types import Array, Indices
from flexlink.data.documents import read_toml
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Spec, decode
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.inputs.laws import CASCADE_GRAVITY, COMPUTED_TORQUE, PD_GRAVITY, TABLE
from flexlink.kernels.inputs.record import Drive
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate

OPERATIONS = (
    "evaluation", "step", "beginning", "preparation", "weighing", "stage_matrix", "stage_solution", "answer",
    "multiplication",
)  # fmt: skip
"""Operations of a step.

In this order they are: evaluations; attempted steps; restarts at a knot; factorizations of a stage's linear systems
(implicit methods); weightings of the errors of rates; set-ups of the matrix of a single stage; solutions with such a
matrix; responses of a stage to friction at a joint; multiplications in the small system of these responses.
"""


class Rate(Spec, frozen=True):
    """Cost of an operation [µs]: `start` once, `body` per body with 0, 1, … hinges, and a cost for each other item."""

    start: NonNegative = 0.0
    body: tuple[NonNegative, ...] = ()
    coupling: NonNegative = 0.0
    dry: NonNegative = 0.0  # for each joint with dry friction
    driven: NonNegative = 0.0  # for each driven joint
    model: NonNegative = 0.0  # for each driven joint whose control law evaluates a rigid model

    @property
    def parts(self) -> list[float]:
        """Costs in the order of `parts_of`."""
        bodies = [*self.body, *[0.0] * (4 - len(self.body))]
        return [self.start, *bodies, self.coupling, self.dry, self.driven, self.model]


PER_HINGE_AND_SHAPE = 5e-9
"""Cost of an explicit evaluation for each pair of a hinge and a strain mode [s], beyond that of the chain, within 20 %
for 6 to 20 stations, in a plane and in space. Implicit evaluations cost as much as those of the chain, within 20 %."""

Rates = dict[str, dict[str, dict[str, dict[str, Rate]]]]
"""Cost rates by planar or spatial chain, plain or full loops, kind of method, and operation."""


@functools.cache
def rates() -> Rates:
    """Measured cost rates, by "plane" or "space", "plain" or "full", "explicit" or "implicit", and operation."""
    return decode(read_toml(Path(__file__).parent / "data" / "evaluation_costs.toml"), Rates)


@functools.cache
def listed(place: str, has: str, kind: str) -> list[list[float]]:
    """Rates of all `OPERATIONS` [µs], each as the list of its `parts`; read-only."""
    found = rates()[place][has][kind]
    return [found[name].parts if name in found else [0.0] * 9 for name in OPERATIONS]


def bodies_of(chain: Chain) -> Indices:
    """Numbers of bodies of a chain with 0, 1, 2 and 3 hinges; the tip frame is not counted."""
    return np.bincount(np.minimum(chain.bodies["stop"] - chain.bodies["first"], 3)[:-1], minlength=4)


def parts_of(chain: Chain, drive: Drive | None) -> Array:
    """Multipliers (9,) of the parts of an operation's cost: 1, bodies by hinges, couplings, joints by kind."""
    driven = 0 if drive is None or drive.law == TABLE else len(drive.joints)
    model = driven if drive is not None and drive.law in {PD_GRAVITY, COMPUTED_TORQUE, CASCADE_GRAVITY} else 0
    dry = np.count_nonzero(chain.hinges["coulomb"])
    return np.array([1.0, *bodies_of(chain), len(chain.couplings), dry, driven, model])


def counted(chain: Chain, drive: Drive) -> tuple[float, ...]:
    """Everything on which the cost of an operation depends, besides the layout of the chain."""
    limited, dry = min(drive.effort.tolist(), default=np.inf) < np.inf, np.count_nonzero(chain.hinges["coulomb"])
    of_the_chain = chain.is_planar, chain.arrays.rare is None, len(chain.couplings), int(dry), chain.freedoms
    return *of_the_chain, drive.law, len(drive.joints), drive.rate > 0, limited


def operation_costs(chain: Chain, *, explicit: bool, drive: Drive | None = None) -> list[float]:
    """CPU time of each of the `OPERATIONS` [s] on a chain with its drive, if it has one.

    A sampled control law is evaluated at restarts, any other law at every stage. Torque limits of motors are checked
    after each step.
    """
    has = "plain" if chain.arrays.rare is None else "full"
    costs = listed("plane" if chain.is_planar else "space", has, "explicit" if explicit else "implicit")
    parts = parts_of(chain, drive)
    driven = [True] * 9  # for each operation, whether it includes the costs of driven joints
    if drive is not None:
        limited = min(drive.effort.tolist(), default=np.inf) < np.inf and not drive.rate
        driven = [not drive.rate, limited, drive.rate > 0, *[False] * 6]
    by_driven = [*parts[:7].tolist(), 0.0, 0.0], parts.tolist()  # without and with these costs
    found = [1e-6 * sum(map(operator.mul, row, by_driven[d])) for row, d in zip(costs, driven, strict=True)]
    if explicit and chain.shapes is not None:
        found[0] += PER_HINGE_AND_SHAPE * chain.n * (1 + chain.freedoms)
    return found


def evaluation_cost(chain: Chain, *, explicit: bool) -> float:
    """CPU time of one evaluation [s] on a chain; for implicit methods it includes its share of the other operations."""
    return _evaluation_cost(chain, 0 if explicit else 3, explicit=explicit)


def run_cost(chain: Chain, name: str, evaluations: float) -> float:
    """CPU time [s] of steps by the named method with this number of evaluations, including all other operations."""
    rule = method(name)
    stages = rule.stages if rule.controlled or not rule.explicit else 0
    return evaluations * _evaluation_cost(chain, stages, explicit=rule.explicit)


def _evaluation_cost(chain: Chain, stages: int, *, explicit: bool) -> float:
    """CPU time of one evaluation [s], including its share of the other operations of a step if `stages` is not 0."""
    costs = operation_costs(chain, explicit=explicit)
    return cost_of_a_step(costs, stages, explicit=explicit) / (_passes(explicit) * stages) if stages else costs[0]


def cost_of_a_step(costs: list[float], stages: int, *, explicit: bool) -> float:
    """CPU time of one attempted step [s] from the costs of `OPERATIONS`.

    Each error estimate is weighted three times, with different time constants. Explicit methods have two estimates,
    implicit methods one.
    """
    systems, weighed = (0, 6) if explicit else (stages, 3)
    often = [_passes(explicit) * stages, 1, 0, systems, weighed, 0, 0, 0, 0]
    return math.fsum(map(operator.mul, costs, often))


def _passes(explicit: bool) -> int:
    """Assumed number of Newton iterations in a step; 1 for an explicit method."""
    return 1 if explicit else 2


def step_cost(chain: Chain, name: str) -> float:
    """CPU time of one step [s], assuming two Newton iterations for an implicit method."""
    rule = method(name)
    return run_cost(chain, name, _passes(rule.explicit) * rule.stages)


def machine_factor(problem: InitialValueProblem) -> float:
    """Measured cost of an evaluation on this machine, relative to the listed cost; measuring takes about 5 ms."""
    return evaluation_time(problem) / operation_costs(problem.chain, explicit=True, drive=problem.inputs.drive)[0]


def evaluation_time(problem: InitialValueProblem) -> float:
    """Measured CPU time [s] of one stage of an explicit method in its compiled loop, the minimum of five timings."""
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
