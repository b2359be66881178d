"""Ways to step, and what each costs and does to the tip: measured on one model, and taken to be so on others.

How many steps an implicit method takes by a tolerance, and what they do to the tip, depends on the motion and on which
of its vibrations the tolerance lets be damped away, but hardly on how many hinges there are.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexlink.advice.bench import Bench, Outcome, Stepping
from flexlink.advice.goal import Ruler
from flexlink.advice.model import Model
from flexlink.describe.catalogue import read_toml
from flexlink.describe.spec import Positive, Spec, decode

Array = NDArray[np.float64]
WAYS = Path(__file__).parent / "data" / "ways.toml"

FALL = 0.25
"""Power of the tolerance by which an implicit method of order 5 with an estimate of order 4 takes fewer steps."""


PROMISING = 1.3
"""Of what is allowed, up to which steps may do it to the tip, and looser ones are worth a thought: where a model is off
the other way, the two are less."""


class Way(Spec, frozen=True):
    """A method with its fixed steps, parts of the stable one, or its tolerances, over what is allowed."""

    method: str
    of_stable: tuple[Positive, ...] = ()
    tolerances: tuple[Positive, ...] = ()
    probed: tuple[Positive, ...] = ()  # of the tolerances, upwards


class _Ways(Spec, frozen=True):
    way: tuple[Way, ...]


@functools.cache
def ways() -> tuple[Way, ...]:
    """Those that are thought of."""
    return decode(read_toml(WAYS), _Ways).way


class Steps(NamedTuple):
    """What a way to step takes and does."""

    evaluations: float
    error: Array  # of the tip (samples, 3) [m]
    size: float  # of it [m]


class Probes:
    """Steps by (method, tolerance over what is allowed); `runs` are those that were taken to tell them.

    Tolerances are probed upwards, while steps get fewer and what they do to the tip may be allowed.

    Parameters
    ----------
    bench, ruler
        Of the scene.
    model, tip
        That is run, and its path with steps without error (samples, 3) [m].
    allowed, largest
        Error at the tip, and the largest tolerance that makes sense [m].
    """

    def __init__(self, bench: Bench, ruler: Ruler, model: Model, tip: Array, allowed: float, largest: float) -> None:
        self.steps: dict[tuple[str, float], Steps] = {}
        self.runs: list[Outcome] = []
        for way in ways():
            measured: dict[float, Steps] = {}
            for factor in way.probed:
                if measured and (factor * allowed > largest or measured[max(measured)].size > PROMISING * allowed):
                    break
                outcome = bench.run(model, Stepping(way.method, tolerance=factor * allowed))
                if not outcome.whole or outcome.run is None or outcome.run.steps is None:
                    break
                self.runs.append(outcome)
                count, error = outcome.run.steps.evaluations, outcome.tip - tip
                if measured and count >= measured[max(measured)].evaluations:
                    break
                measured[factor] = Steps(count, error, ruler(error))
            for factor in way.tolerances:
                if measured and factor <= max(measured):
                    self.steps[way.method, factor] = _between(measured, factor)


def _between(measured: dict[float, Steps], factor: float) -> Steps:
    """Of a tolerance up to the largest that was measured: by powers between those measured, then by orders."""
    if factor in measured:
        return measured[factor]
    coarse = measured[above := min(known for known in measured if known > factor)]
    if factor < min(measured):
        part = factor / above
        return Steps(coarse.evaluations * part**-FALL, part * coarse.error, part * coarse.size)
    fine = measured[below := max(known for known in measured if known < factor)]
    weight = np.log(factor / below) / np.log(above / below)
    count = fine.evaluations ** (1 - weight) * coarse.evaluations**weight
    size = fine.size ** (1 - weight) * coarse.size**weight
    return Steps(count, coarse.error * (size / coarse.size if coarse.size else 0.0), size)
