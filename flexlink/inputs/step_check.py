"""A run's fixed step against the largest stable one, before the run starts."""

from __future__ import annotations

import numpy as np

from flexlink.common.errors import UnstableStepError
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.vibration.stability import eigenvalue_bound, fastest_eigenvalues, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.inputs.actuation import acting_at


def judge_step(problem: InitialValueProblem) -> tuple[str, ...]:
    """Check the fixed step against the largest stable one about the initial state; a warning where the run insists.

    Raises
    ------
    UnstableStepError
        The step is beyond it, and `run.unstable` does not allow it.
    """
    run = problem.run
    if run.duration == 0 or not problem.explicit:
        return ()
    about = problem.chain, problem.q, problem.qd
    acting = acting_at(problem.inputs, problem.chain, problem.start, problem.q, problem.qd)
    if run.step * eigenvalue_bound(*about, **acting) <= stable_half_disc(method(run.method)):
        return ()
    λ = fastest_eigenvalues(*about, **acting)
    largest = stable_step_of(λ, run.method)
    if run.step <= largest:
        return ()
    reason = (
        f"run.step = {run.step:g} s: more than {largest:.3g} s, the largest stable step of {run.method} at the start "
        f"of {problem.scene.name!r} (fastest eigenvalue {np.abs(λ).max():.4g} 1/s)"
    )
    if run.unstable == "refuse":
        raise UnstableStepError(
            f"{reason}; take a smaller step, or allow this one: unstable = 'allow' (--insist)", largest
        )
    return (f"{reason}; allowed by unstable = 'allow'",)
