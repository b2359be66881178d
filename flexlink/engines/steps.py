"""Integrate the accelerations that an engine computes with the scene's Runge-Kutta method, in a plain loop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.floating_base import ANGLES, FAR
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.engines.base import (
    Samples,
    allocate_samples,
    divergence_error,
    drag_function,
    drive_function,
    wrench_function,
)
from flexlink.engines.coordinates import Coordinates
from flexlink.kernels.inputs.drive_torque import follow

Accelerations = Callable[..., Array]
"""Function of q, q̇, joint torques and tip wrench (6,) or None that returns accelerations (n,). Prescribed joints get
`prescribed`; the wrench is in axes of frame 0, or of the tip if it `follows`."""


def run_in_steps(
    engine: str, problem: InitialValueProblem, accelerations: Accelerations, theirs: Coordinates
) -> Samples:
    """Return the samples of a run with fixed steps; a floating base is described in its initial coordinates.

    After a large rotation the steps continue in new base coordinates, which the engine also receives, as in flexlink.
    """
    samples = t, q, qd = allocate_samples(problem)
    reference = theirs.reference
    try:
        _fill(engine, problem, accelerations, theirs, samples)
    finally:
        theirs.reference = reference
    return samples if problem.base is None else (t, *problem.base.from_the_start(q, qd)[:2])


def _fill(
    engine: str, problem: InitialValueProblem, accelerations: Accelerations, theirs: Coordinates, samples: Samples
) -> None:
    """Compute all samples except the first."""
    run, n, step = problem.run, problem.chain.n, _step_function(problem, accelerations)
    (t, q, qd), base, every = samples, problem.base, run.steps_per_sample
    first_step = round(problem.start / run.fixed_step)
    y = np.concatenate([q[0], qd[0]])
    with np.errstate(all="ignore"):  # divergence raises an error below
        for row in range(1, len(t)):
            for number in range((row - 1) * every, row * every):
                y = step(first_step + number, y)
                if number + 1 == row * every:
                    q[row], qd[row] = y[:n], y[n:]
                if base is not None and np.abs(y[ANGLES]).max() > FAR:
                    base.turn((number + 1) // every + 1, y[:n], y[n:])
                    theirs.reference = np.array(problem.chain.bodies["rotation"][1])
            if not np.isfinite(y).all():
                raise divergence_error(engine, problem, samples, row)


def _step_function(problem: InitialValueProblem, accelerations: Accelerations) -> Callable[[int, Array], Array]:
    """Return a function that advances the state (q, q̇) from number · h to (number + 1) h."""
    n, h, wrench = problem.chain.n, problem.run.fixed_step, wrench_function(problem)
    A, b, c = method(problem.run.method).arrays
    drive, drag, motion = drive_function(problem), drag_function(problem), problem.inputs.motion
    F, no_torque, prescribed = np.empty((len(c), 2 * n)), np.zeros(n), np.zeros(n)
    follows, led = wrench is not None and wrench.follows, bool(len(motion.joints))
    stages, whole = [(float(c[i]), h * A[i, :i], F[:i], F[i, :n], F[i, n:]) for i in range(len(c))], h * b

    def step(number: int, y: Array) -> Array:
        for function in (drive, wrench):
            if function is not None:
                function.begin(number, h, y[:n], y[n:])
        for at, weights, before, rates, changes in stages:
            t, x = (number + at) * h, y + weights @ before
            q, qd = x[:n], x[n:]
            if led:
                follow(motion, t, q, qd, prescribed)
            torque = no_torque if drive is None else drive(t, q, qd)
            if drag is not None:
                torque = torque - drag(q, qd)
            rates[:] = qd
            force = None if wrench is None else wrench(t)
            changes[:] = accelerations(q, qd, torque, force, follows=follows, prescribed=prescribed)
        y = y + whole @ F
        if led:
            follow(motion, (number + 1) * h, y[:n], y[n:], prescribed)
        return y

    return step
