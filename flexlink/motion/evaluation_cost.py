"""CPU time of a run's steps: number of evaluations times the cost of one, by a list of what each body of a chain adds.

Choices are made by it, so that they do not depend on how fast the machine is; set-up and samples are not in it.
An evaluation is a stage of an explicit method, or a stage in one pass of Newton's iteration of an implicit one. Costs
are those of the machine that the list was measured on; `machine_factor` scales them to this one.
"""

from __future__ import annotations

import functools
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.common.memo import keep_last
from flexlink.data.documents import read_toml
from flexlink.describe.schemes.methods import method
from flexlink.describe.spec import NonNegative, Spec, decode
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate

Bodies = NDArray[np.intp]
"""Number of bodies with 0, 1, 2, 3 hinges, shape (4,)."""


class Rate(Spec, frozen=True):
    """Cost of one evaluation [µs]: `start`, `body` for each body with 0, 1, … hinges, `coupling` for each of those."""

    start: NonNegative
    body: tuple[NonNegative, ...]
    coupling: NonNegative


@functools.cache
def rates() -> dict[str, dict[str, Rate]]:
    """The measured rates of `explicit` and `implicit` methods, for chains in a `plane` and in `space`."""
    return decode(read_toml(Path(__file__).parent / "data" / "evaluation_costs.toml"), dict[str, dict[str, Rate]])


def bodies_of(chain: Chain) -> Bodies:
    """How many bodies of a chain have 0, 1, 2, 3 hinges, the tip frame not counted."""
    hinges = (chain.bodies["stop"] - chain.bodies["first"])[:-1]
    return np.bincount(np.minimum(hinges, 3), minlength=4)


def evaluation_cost(chain: Chain, *, explicit: bool) -> float:
    """CPU time of one evaluation [s] of a chain."""
    return _listed(chain, explicit)


@keep_last(64)
def _listed(chain: Chain, explicit: bool) -> float:
    bodies, planar = bodies_of(chain), chain.is_planar
    rate = rates()["explicit" if explicit else "implicit"]["plane" if planar else "space"]
    of_bodies = float(np.dot(rate.body, bodies[: len(rate.body)]))
    return 1e-6 * (rate.start + of_bodies + rate.coupling * len(chain.couplings))


def run_cost(chain: Chain, name: str, evaluations: float) -> float:
    """CPU time [s] of so many evaluations by the method of this name."""
    return evaluations * evaluation_cost(chain, explicit=method(name).explicit)


def step_cost(chain: Chain, name: str) -> float:
    """CPU time of one step [s]; of an implicit method within about a factor of two."""
    rule = method(name)
    # Typical passes of Newton's iteration a step: a step costs 2.7 to 6.8 explicit evaluations a stage in a plane and
    # 4.9 to 15 in space, measured on the trade's 16 scenes with 7 tolerances; most where dry friction changes its
    # direction.
    passes = 1.0 if rule.explicit else 2.0 if chain.is_planar else 5.0
    return run_cost(chain, name, passes * rule.stages)


def machine_factor(problem: InitialValueProblem) -> float:
    """How many times the listed cost an evaluation takes on this machine, measured in about 5 ms."""
    return evaluation_time(problem) / run_cost(problem.chain, "RK4", 1)


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
