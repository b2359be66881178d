"""Check of a run's fixed step against the largest stable one, before the run starts."""

import contextlib
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexlink.common.errors import Diagnostic, FlexlinkError, UnstableStepError, or_error
from flexlink.describe.numbers import is_whole
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.initial_value_problem import InitialValueProblem
from flexlink.dynamics.vibration.stability import eigenvalue_bounds, fastest_eigenvalues, stable_step_of
from flexlink.dynamics.vibration.stability_function import stable_half_disc
from flexlink.motion.inputs.actuation import acting_at


def check_steps(problems: Sequence[InitialValueProblem]) -> list[tuple[Diagnostic, ...] | FlexlinkError]:
    """Warnings or the error from `check_step` for every problem; bounds computed for all at once decide most cases."""
    pairs = zip(problems, _within_bounds(problems), strict=True)
    return [() if known else or_error(_check_by_eigenvalues, problem) for problem, known in pairs]


def _within_bounds(problems: Sequence[InitialValueProblem]) -> list[bool]:
    """Whether a bound on the eigenvalues proves a problem's step stable; problems of one size are handled together."""
    within = [False] * len(problems)
    for n in {problem.chain.n for problem in problems}:
        these = [k for k, p in enumerate(problems) if p.chain.n == n and p.run.duration and p.explicit]
        with contextlib.suppress(FlexlinkError):  # raised again when the problem at fault is checked individually
            abouts = [(p.chain, p.q, p.qd) for p in map(problems.__getitem__, these)]
            for k, bound in zip(these, eigenvalue_bounds(abouts, _acting([problems[k] for k in these])), strict=True):
                run = problems[k].run
                within[k] = run.fixed_step * bound <= stable_half_disc(method(run.method))
    return within


def _acting(problems: Sequence[InitialValueProblem]) -> list[dict[str, Any]]:
    """Return `acting_at` the start of each problem; inputs independent of arm and time are evaluated only once."""
    found: list[dict[str, Any]] = []
    for k, problem in enumerate(problems):
        inputs = problem.inputs
        if found and inputs is problems[k - 1].inputs and inputs.changing is None and not len(inputs.drive.joints):
            found.append(found[-1])
        else:
            found.append(acting_at(inputs, problem.chain, problem.start, problem.q, problem.qd))
    return found


def check_step(problem: InitialValueProblem) -> tuple[Diagnostic, ...]:
    """Compare the fixed step with the largest stable step at the start; refuse a larger one, or warn if allowed."""
    return () if _within_bounds([problem])[0] else _check_by_eigenvalues(problem)


def _check_by_eigenvalues(problem: InitialValueProblem) -> tuple[Diagnostic, ...]:
    """Do `check_step` by eigenvalues, for a step that the bound does not prove stable."""
    run = problem.run
    if run.duration == 0 or not problem.explicit:
        return ()
    acting = acting_at(problem.inputs, problem.chain, problem.start, problem.q, problem.qd)
    λ = fastest_eigenvalues(problem.chain, problem.q, problem.qd, **acting)
    largest = stable_step_of(λ, run.method)
    if run.fixed_step <= largest:
        return ()
    start = f"at the start of {problem.scene.name!r} (fastest eigenvalue {np.abs(λ).max():.4g} 1/s)"
    why = f"more than {largest:.3g} s, the largest stable step of {run.method} {start}"
    reason = f"{run.label('step', 'run.')} = {run.fixed_step:g} s: {why}"
    if run.unstable == "refuse":
        adaptive = "relative_tolerance = 1e-3 (--method auto --relative-tolerance 1e-3), which works for any stiffness"
        shorter = f"step = {_divisor(run.sample or run.duration, largest)}"
        remedy = f"in place of step and method give {adaptive}; or {shorter}"
        text = f"{reason}; {remedy}; or override this check: unstable = 'allow' (--insist)"
        raise UnstableStepError(text, largest, id="unstable-step")
    return (Diagnostic(f"{reason}; allowed by unstable = 'allow'", "unstable-step"),)


def _divisor(time: float, largest: float) -> str:
    """A step of few digits below `largest` that divides `time`; if there is none, the longest step that divides it."""
    power = 10.0 ** math.floor(math.log10(largest))
    round_steps = (digits * power for digits in (8, 5, 4, 2.5, 2, 1, 0.5, 0.1))
    fitting = (step for step in round_steps if step < largest and is_whole(time / step))
    return f"{next(fitting, time / math.ceil(time / largest)):.9g}"
