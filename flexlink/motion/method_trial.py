"""Which method goes on with a run: the one by which the rest of it is likely to cost least.

Nothing at the start tells how an arm will whip, and so what a method will cost. What the present one costs are its
steps' operations, by the list, in a second of motion. Of another one it is what it was when it took its last steps, or
less, as the motion has become easier for the present one since; of one that has taken none it is guessed
(`method_choice`). Who promises to do the rest of the run for clearly less takes a few steps, which are steps of the run:
nothing is done twice. What is counted is the same on every machine, so that runs repeat to the bit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexlink.motion.method_choice import METHODS, price_of_a_step

if TYPE_CHECKING:
    from flexlink.motion.adaptive_steps import AdaptiveSteps


FEW = 8
"""Tries of steps: the first ones of a method, which begins anew, and those by which it is judged."""


def consider(steps: AdaptiveSteps) -> None:
    """Judge the steps since the last time, and go on with another method if the rest is likely to cost less by it."""
    switch = 1.5e-4  # CPU time of a change of methods, beside their steps [s]
    since, steps.judged = steps.judged, (steps.time, steps.cost)
    if since is None or steps.time <= since[0]:  # it has just begun, or did not get on
        steps.consider_at = steps.tries + FEW
        return
    rate, tried_for, steps.tried_for = (steps.cost - since[1]) / (steps.time - since[0]), steps.tried_for, None
    steps.rates = updated(steps, rate)
    steps.consider_at = 2 * steps.tries
    promises = {name: promised(steps, name) for name in METHODS if name != steps.name}
    name = min(promises, key=lambda other: promises[other])
    known = name in steps.rates
    clearly = 0.9 if known else 0.75  # part of the cost with which another method must do
    price = switch if known else 4.0 * (switch + FEW * price_of_a_step(steps.record, name))
    if promises[name] < clearly * rate and (rate - promises[name]) * steps.rest > price:
        back = tried_for if tried_for and tried_for[0] == name else None
        steps.tried_for = None if known else (steps.name, steps.why)
        steps.go_on_with(name, back[1] if back else "")
        steps.judged, steps.consider_at = None, steps.tries + FEW


def updated(steps: AdaptiveSteps, rate: float) -> dict[str, float]:
    """What methods cost in a second of motion [s/s], those of others as much less as the present one costs less."""
    before = steps.rates.get(steps.name, math.inf)
    easier = min(1.0, rate / before)
    easier = easier if before < math.inf else 1.0
    return {**{name: easier * cost for name, cost in steps.rates.items()}, steps.name: rate}


def promised(steps: AdaptiveSteps, name: str) -> float:
    """What a method may cost in a second of motion [s/s]."""
    guess = steps.guesses[name]
    if name in steps.rates:
        return max(steps.rates[name], guess) if name == "DOP853" else steps.rates[name]
    if name == "Radau9" and "Radau5" in steps.rates:
        return steps.rates["Radau5"] * guess / steps.guesses["Radau5"]
    return guess
