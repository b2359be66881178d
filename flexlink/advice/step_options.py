"""Options for the steps of a run, and what each costs and does to the tip: measured on one model, used for all.

The number of steps that an implicit method takes by a tolerance, and their error at the tip, depend on the motion and
on the vibrations that the tolerance lets be damped, but hardly on the number of hinges.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexlink.advice.goal import TipErrorNorm
from flexlink.advice.model import Model
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.common.types import Array
from flexlink.describe.data_files import read_toml
from flexlink.describe.spec import Positive, Spec, decode

STEPS_EXPONENT = 0.25
"""Steps of an implicit method of order 5 with an error estimate of order 4 are proportional to tolerance^-0.25."""

PROMISING_ERROR = 1.3
"""Error of steps over the allowed one up to which looser steps are tried: errors of model and steps may cancel."""

EXTRAPOLATED_TOLERANCE = 3.0
"""Largest tolerance over the largest measured one for which the effect of steps is extrapolated."""


class StepOption(Spec, frozen=True):
    """A method with its fixed steps over the stable step, or its tolerances over the allowed error."""

    method: str
    of_stable: tuple[Positive, ...] = ()
    tolerances: tuple[Positive, ...] = ()
    probed: tuple[Positive, ...] = ()  # tolerances that are measured, ascending


@functools.cache
def step_options() -> tuple[StepOption, ...]:
    """All options."""
    return decode(read_toml(Path(__file__).parent / "data" / "step_options.toml")["option"], tuple[StepOption, ...])


def fixed_step_options() -> list[tuple[str, float]]:
    """Methods of fixed steps with their steps over the stable one, largest first."""
    return [(option.method, factor) for option in step_options() for factor in option.of_stable]


class StepEffect(NamedTuple):
    """Cost and error of an option."""

    evaluations: float
    size: float  # largest error of the tip [m]


class MeasuredSteps:
    """Effect of steps by (method, tolerance over the allowed error), measured by `runs`.

    Tolerances are measured upwards while steps get fewer and their error may be allowed.

    Parameters
    ----------
    runner, norm
        Runs of the scene, and the norm of their tip errors.
    model, tip
        The model that is run, and its tip path with accurate steps (samples, 3) [m].
    allowed, largest
        Allowed error at the tip, and the largest tolerance that makes sense [m].
    """

    def __init__(
        self, runner: ModelRunner, norm: TipErrorNorm, model: Model, tip: Array, allowed: float, largest: float
    ) -> None:
        self.steps: dict[tuple[str, float], StepEffect] = {}
        self.runs: list[Outcome] = []
        for option in step_options():
            measured: dict[float, StepEffect] = {}
            for factor in option.probed:
                if measured and (
                    factor * allowed > largest or measured[max(measured)].size > PROMISING_ERROR * allowed
                ):
                    break
                outcome = runner.run(model, Stepping(option.method, tolerance=factor * allowed))
                if not outcome.completed or outcome.run is None or outcome.run.steps is None:
                    continue
                self.runs.append(outcome)
                count = outcome.run.steps.evaluations
                if measured and count >= measured[max(measured)].evaluations:
                    break
                measured[factor] = StepEffect(count, norm(outcome.tip - tip))
            for factor in option.tolerances:
                if measured and factor <= EXTRAPOLATED_TOLERANCE * max(measured):
                    self.steps[option.method, factor] = _between(measured, factor)


def _between(measured: dict[float, StepEffect], factor: float) -> StepEffect:
    """Effect of a tolerance: interpolated between measured ones by powers, extrapolated by the method's orders."""
    if factor in measured:
        return measured[factor]
    if not min(measured) < factor < max(measured):
        nearest = min(measured, key=lambda known: abs(np.log(known / factor)))
        part = factor / nearest
        return StepEffect(measured[nearest].evaluations * part**-STEPS_EXPONENT, part * measured[nearest].size)
    coarse = measured[above := min(known for known in measured if known > factor)]
    fine = measured[below := max(known for known in measured if known < factor)]
    weight = np.log(factor / below) / np.log(above / below)
    count, size = (a ** (1 - weight) * b**weight for a, b in zip(fine, coarse, strict=True))
    return StepEffect(count, size)
