"""How far a model can be trusted that is not good enough for all of the run, and how fast its errors grow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.goal import Ruler
from flexlink.advice.ladder import RefinementStudy
from flexlink.advice.model_runner import GROWN, NUDGE, ModelRunner

Array = NDArray[np.float64]

SENSITIVE = 30.0
"""Growth of an error from which it is what the motion does that makes it large."""


class Growth(NamedTuple):
    """How an error of the initial angles grows."""

    factor: float  # at the end, or where it has grown too large to tell
    e_fold: float  # time in which it grows by e, over the second half [s]; inf if it does not


def horizon(ladder: RefinementStudy, ruler: Ruler, known: Array) -> float:
    """Time [s] up to which the finest level is within the tolerance.

    Its error up to each sample is the difference to the limit, and what this is `known` to, shape (samples,) [m].
    """
    assert ladder.limit is not None
    finest = ladder.finest.outcome
    assert finest.run is not None
    beyond = np.flatnonzero(ruler.up_to(finest.tip - ladder.limit.tip) + known > ladder.tolerance)
    times = finest.run.t
    return float(times[-1] if not beyond.size else times[max(0, beyond[0] - 1)])


def growth(bench: ModelRunner, ladder: RefinementStudy, tolerance: float) -> Growth:
    """Of the finest level, by a twin that starts a little apart."""
    outcome, reach = ladder.finest.outcome, bench.chain(ladder.model).reach
    angle = min(NUDGE * (outcome.stepping.tolerance or 0.0), tolerance) / reach
    twin = bench.twin(ladder.model, outcome.stepping, angle)
    if twin is None or outcome.run is None:
        return Growth(1.0, np.inf)
    apart = np.linalg.norm(twin.tip - outcome.tip, axis=1)
    beyond = np.flatnonzero(~(apart <= GROWN * ladder.motion))
    apart = apart[: beyond[0]] if beyond.size else apart
    grown = np.maximum.accumulate(apart) / (angle * reach)
    factor = float(grown.max(initial=1.0))
    half = len(grown) // 2
    if factor < SENSITIVE or len(grown) - half < 3:
        return Growth(factor, np.inf)
    rate = np.polyfit(outcome.run.t[half : len(grown)], np.log(np.maximum(grown[half:], np.finfo(float).tiny)), 1)[0]
    return Growth(factor, float(1 / rate) if rate > 0 else np.inf)
