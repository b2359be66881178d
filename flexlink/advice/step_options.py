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

from flexlink.advice.goal import Ruler
from flexlink.advice.model import Model
from flexlink.advice.model_runner import ModelRunner, Outcome, Stepping
from flexlink.describe.data_files import read_toml
from flexlink.describe.spec import Positive, Spec, decode

Array = NDArray[np.float64]
WAYS = Path(__file__).parent / "data" / "ways.toml"

FALL = 0.25
"""Power of the tolerance by which an implicit method of order 5 with an estimate of order 4 takes fewer steps."""


PROMISING = 1.3
"""Of what is allowed, up to which steps may do it to the tip, and looser ones are worth a thought: where a model is off
the other way, the two are less."""


FURTHER = 3.0
"""Times the largest tolerance that was measured, up to which what steps do is told by orders."""


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


def fixed_ways() -> list[tuple[str, float]]:
    """Methods of fixed steps with their parts of the stable step, from the largest on."""
    return [(way.method, factor) for way in ways() for factor in way.of_stable]


class Steps(NamedTuple):
    """What a way to step takes and does."""

    evaluations: float
    size: float  # largest error of the tip [m]


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

    def __init__(
        self, bench: ModelRunner, ruler: Ruler, model: Model, tip: Array, allowed: float, largest: float
    ) -> None:
        self.steps: dict[tuple[str, float], Steps] = {}
        self.runs: list[Outcome] = []
        for way in ways():
            measured: dict[float, Steps] = {}
            for factor in way.probed:
                if measured and (factor * allowed > largest or measured[max(measured)].size > PROMISING * allowed):
                    break
                outcome = bench.run(model, Stepping(way.method, tolerance=factor * allowed))
                if not outcome.whole or outcome.run is None or outcome.run.steps is None:
                    continue
                self.runs.append(outcome)
                count = outcome.run.steps.evaluations
                if measured and count >= measured[max(measured)].evaluations:
                    break
                measured[factor] = Steps(count, ruler(outcome.tip - tip))
            for factor in way.tolerances:
                if measured and factor <= FURTHER * max(measured):
                    self.steps[way.method, factor] = _between(measured, factor)


def _between(measured: dict[float, Steps], factor: float) -> Steps:
    """Of a tolerance: by powers between those that were measured, by orders beyond them."""
    if factor in measured:
        return measured[factor]
    if not min(measured) < factor < max(measured):
        nearest = min(measured, key=lambda known: abs(np.log(known / factor)))
        part = factor / nearest
        return Steps(measured[nearest].evaluations * part**-FALL, part * measured[nearest].size)
    coarse = measured[above := min(known for known in measured if known > factor)]
    fine = measured[below := max(known for known in measured if known < factor)]
    weight = np.log(factor / below) / np.log(above / below)
    count, size = (a ** (1 - weight) * b**weight for a, b in zip(fine, coarse, strict=True))
    return Steps(count, size)
