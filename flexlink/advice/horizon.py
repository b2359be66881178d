"""Horizon of a model, which is the time up to which the model meets the tolerance, and growth of its errors."""

from __future__ import annotations

import numpy as np

from flexlink.advice.goal import Thresholds, TipErrorNorm
from flexlink.advice.model_runner import ModelRunner
from flexlink.advice.refinement import RefinementStudy
from flexlink.common.types import Array


def horizon(refinement: RefinementStudy, norm: TipErrorNorm, known: Array) -> float:
    """Time [s] up to which the finest level is within the tolerance.

    The error of this level is its distance from the limit plus the error of the limit, `known` (samples,) [m].
    """
    assert refinement.limit is not None
    finest = refinement.finest.outcome
    assert finest.run is not None
    beyond = np.flatnonzero(norm.up_to(finest.tip - refinement.limit.tip) + known > refinement.tolerance)
    times = finest.run.t
    return float(times[-1] if not beyond.size else times[max(0, beyond[0] - 1)])


def growth(runner: ModelRunner, refinement: RefinementStudy, tolerance: float) -> tuple[float, float]:
    """Growth factor and e-folding time [s] of an error in the initial angles, for the finest level.

    The factor is taken at the end of the run, or when the error becomes too large to be proportional to the initial
    error. The e-folding time refers to the second half of this interval; it is inf if the error does not grow.
    """
    outcome, size = refinement.finest.outcome, runner.chain(refinement.model).size
    angle = min(Thresholds.perturbation * (outcome.stepping.tolerance or 0.0), tolerance) / size
    perturbed = runner.perturbed_run(refinement.model, outcome.stepping, angle)
    if perturbed is None or outcome.run is None:
        return 1.0, np.inf
    apart = np.linalg.norm(perturbed.tip - outcome.tip, axis=1)
    beyond = np.flatnonzero(~(apart <= Thresholds.proportional * refinement.travel))
    apart = apart[: beyond[0]] if beyond.size else apart
    grown = np.maximum.accumulate(apart) / (angle * size)
    factor = float(grown.max(initial=1.0))
    half = len(grown) // 2
    if factor < Thresholds.sensitive_growth or len(grown) - half < 3:
        return factor, np.inf
    rate = np.polyfit(outcome.run.t[half : len(grown)], np.log(np.maximum(grown[half:], np.finfo(float).tiny)), 1)[0]
    return factor, float(1 / rate) if rate > 0 else np.inf
