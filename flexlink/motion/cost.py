"""What a second of motion costs, before the run: steps as large as they may be, times what an evaluation takes here."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.chain.chain import Chain
from flexlink.describe.scene import Scene
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.accelerations import solver_for
from flexlink.dynamics.vibration.stability import stable_step_of
from flexlink.inputs.actuation import input_arrays
from flexlink.inputs.initial_state import initial_state
from flexlink.kernels.stepping.runge_kutta import NEVER, integrate

Complex = NDArray[np.complex128]

LONG = 2e-3  # of a measurement [s]: a thousand times what the clock is good for

IMPLICIT_IN_PLANE, IMPLICIT_IN_SPACE = 4.0, 9.0
"""Evaluations that cost as much as a stage of an implicit step: measured on the trade's 16 scenes with 7 tolerances 2.7
to 6.8 in a plane, and 4.9 to 15 in space, most where dry friction turns round and takes many passes of Newton."""


class Cost(NamedTuple):
    """Of one method on a chain, about a state."""

    step: float  # the largest stable one [s], inf if all are
    seconds: float  # of CPU that a second of motion takes with it; nan if it may be any


def cost(name: str, λ: Complex, evaluation: float, *, planar: bool) -> Cost:
    """Cost of a method at its largest stable step.

    Parameters
    ----------
    name
        Name or file of the method.
    λ
        Eigenvalues of the chain about a state [1/s].
    evaluation
        `evaluation_time` of the chain [s].
    planar
        Whether it moves in a plane.
    """
    step = stable_step_of(λ, name)
    return Cost(step, step_time(name, evaluation, planar=planar) / step if np.isfinite(step) else np.nan)


def step_time(name: str, evaluation: float, *, planar: bool) -> float:
    """About what a step of a method costs [s of CPU], of an implicit one within a factor of two."""
    rule = method(name)
    stage = 1.0 if rule.explicit else IMPLICIT_IN_PLANE if planar else IMPLICIT_IN_SPACE
    return stage * rule.stages * evaluation


def evaluation_time(scene: Scene, chain: Chain) -> float:
    """CPU time [s] of one stage of an explicit method in its compiled loop, measured here and now, in about 30 ms."""
    repeats = 5  # of which the shortest counts: nothing makes a program faster than it is
    q, qd = initial_state(scene, chain)
    state, none = (q.copy(), qd.copy(), np.zeros(1)), (np.empty((0, chain.n)), np.empty((0, chain.n)), np.empty(0))
    work = solver_for(chain, scene.run.solver).workspace(chain.arrays)
    rule = method("RK2")
    steps_of_no_length = work, rule.arrays, input_arrays(scene, chain), 0.0

    def taken(steps: int) -> float:
        started = time.thread_time()
        integrate(*steps_of_no_length, 0, 0, steps, NEVER, state, none)
        return time.thread_time() - started

    taken(1)  # compiles
    steps = 1
    while taken(steps) < LONG:
        steps *= 2
    return min(taken(steps) for _ in range(repeats)) / (steps * rule.stages)
