"""Which method goes on with a run: each that may be cheaper takes the same stretch of it, and evaluations are counted.

Nothing at the start tells how an arm will whip, and so what a method will cost. Counts are the same on every machine,
so that runs repeat to the bit.
"""

from __future__ import annotations

import math

from flexlink.describe.schemes.methods import method
from flexlink.kernels.stepping.adaptive import OUTCOME
from flexlink.motion.evaluation_cost import run_cost
from flexlink.motion.method_steps import MethodSteps


def go_on_with_the_cheapest(steps: MethodSteps) -> int:
    """Take a stretch of a run by its method and by each that may be cheaper; stay with the cheapest; an OUTCOME."""
    row, begin, end = steps.row, steps.time, steps.end
    start, first, before = steps.saved(row), steps.name, steps.evaluations
    how = steps.take(max(10, steps.tries // 16))
    if how != OUTCOME.goes_on or steps.time == begin:
        return how
    until, least, best, all_evaluations = steps.time, _cost(steps, before), steps.saved(row), steps.evaluations
    angle = (until - begin) * steps.fastest
    clearly = (
        0.7  # part of the cost with which another method must do: in the next stretch the first may be the cheaper
    )
    for name in ("Radau5", "Radau9", "DOP853"):
        if name == first or _least_cost(steps, name, angle) > clearly * least:
            continue
        steps.restore(start)
        steps.go_on_with(name, until)
        cost = _cost_up_to_the_end(steps, clearly * least)
        all_evaluations += steps.evaluations - before
        if cost < clearly * least:
            least, best = cost, steps.saved(row)
    steps.restore(best)
    steps.evaluations_besides += all_evaluations - steps.evaluations
    if steps.name != first:
        steps.aim(until, end)
    return how


def _cost_up_to_the_end(steps: MethodSteps, most: float) -> float:
    """Cost of going to the end of the piece [s]; infinite if it is more than `most`."""
    before, how = steps.evaluations, int(OUTCOME.goes_on)
    while how == OUTCOME.goes_on and _cost(steps, before) < most:
        # tries between which the cost of another method is looked at
        how = steps.take(4)
    return _cost(steps, before) if how == OUTCOME.ended else math.inf


def _cost(steps: MethodSteps, before: int) -> float:
    """Of the evaluations since there were so many [s]."""
    return run_cost(steps.record.chain, steps.name, steps.evaluations - before)


def _least_cost(steps: MethodSteps, name: str, angle: float) -> float:
    """What a method costs at least [s] in a time in which the fastest motion turns by an angle [rad]."""
    explicit = method(name).explicit
    # |h ω| of an explicit method up to which steps may be stable: that of DOP853 ends there, or before
    return run_cost(steps.record.chain, name, method(name).stages * angle / 6.0) if explicit else 0.0
