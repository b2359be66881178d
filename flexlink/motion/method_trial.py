"""Which method goes on with a run: the one by which the rest of it is likely to cost least.

Nothing at the start tells how an arm will whip, and so what a method will cost. What the present one costs are its
steps' operations, by the list, in a second of motion. Of another one it is what it was when it took its last steps, or
less, as the motion has become easier for the present one since; of one that has taken none it is guessed
(`method_choice`). Who promises to do the rest of the run for clearly less takes some steps, which are steps of the run:
nothing is done twice. Not at once: steps after a start or a jump are short, and a run that changes its method only when
it has cost a part of what is promised costs no more than that part in vain. What a method cost may be outdated, and a
guess wrong: as a run grows longer, others are tried again, for a part of what it cost. All is counted alike on every
machine, so that runs repeat to the bit.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from flexlink.motion.method_choice import METHODS, price_of_a_step

if TYPE_CHECKING:
    from flexlink.motion.adaptive_steps import AdaptiveSteps


FEW = 8
"""Tries of steps: the first ones of a method, which begins anew, and those by which it is judged, at least."""

SWITCH = 1e-4
"""CPU time of a change of methods, and back, beside their steps [s]."""

TRIAL = 0.03
"""Part of what a run has cost that a trial may cost, or 8 steps and 8."""

PATIENCE = 0.3
"""Part of what another method promises to cost in the rest of a run that the run must have cost before it goes on."""


def consider(steps: AdaptiveSteps) -> None:
    """Judge the steps since the last time, and go on with another method if the rest is likely to cost less by it."""
    time, cost, since = steps.time, steps.cost, steps.judged
    if since is None or time <= since[0]:  # it has just begun, or did not get on
        steps.judged, steps.consider_at = (time, cost), steps.tries + few(steps)
        return
    rate, overall = (cost - since[1]) / (time - since[0]), cost / (time - steps.taken)
    steps.judged, steps.consider_at = (time, cost), 2 * steps.tries
    steps.rates = updated(steps, rate)
    if steps.tried_for and not is_cheaper(steps, steps.name, rate, steps.rates[steps.tried_for[0]]):
        name, why = steps.tried_for
        go_on_with(steps, name, why)
    else:
        steps.tried_for = None
        look_around(steps, min(rate, overall))


def look_around(steps: AdaptiveSteps, rate: float) -> None:
    """Go on with the method that promises most, or try one, where the present one costs so much in a second [s/s]."""
    if rate * steps.rest < SWITCH:
        return
    promises = {name: promised(steps, name) for name in METHODS if name != steps.name}
    name = min(promises, key=lambda other: promises[other])
    if is_cheaper(steps, name, promises[name], rate):
        trial = name not in steps.rates
    else:
        name, trial = next((other for other in promises if is_worth_a_trial(steps, other, rate)), ""), True
    if name:
        tried_for = (steps.name, steps.why) if trial else None
        go_on_with(steps, name)
        steps.tried_for = tried_for


def go_on_with(steps: AdaptiveSteps, name: str, why: str = "") -> None:
    """Go on with another method, and note when it was the present one's turn."""
    spent = steps.spent + steps.cost
    steps.tried = {**steps.tried, steps.name: spent, name: spent}
    steps.go_on_with(name, why)
    steps.judged, steps.tried_for, steps.consider_at = None, None, steps.tries + few(steps)


def few(steps: AdaptiveSteps) -> int:
    """Tries of steps up to the next time: of a run's first ones as many as cost as much as a change of methods.

    Later as many as cost a part of what the run has cost, so that what a method inherits from another one counts less.
    """
    time = TRIAL / 2 * steps.spent if steps.tried else SWITCH
    return max(FEW, math.ceil(time / price_of_a_step(steps.record, steps.name)))


def is_cheaper(steps: AdaptiveSteps, name: str, promise: float, rate: float) -> bool:
    """Whether a method that promises to cost so much in a second does the rest of the run for clearly less [s/s]."""
    known, rest = name in steps.rates, steps.rest
    clearly, price = (0.9, SWITCH) if known else (0.75, 4.0 * trial(steps, name))
    gains = promise < clearly * rate and (rate - promise) * rest > price
    return gains and steps.spent + steps.cost > PATIENCE * promise * rest


def is_worth_a_trial(steps: AdaptiveSteps, name: str, rate: float) -> bool:
    """Whether a run has cost so much since a method was last tried that it may be again, if it may cost less at all."""
    if steps.rates.get(name, 0.0) == math.inf:
        return False
    last, price = steps.tried.get(name, 0.0), trial(steps, name)
    least = steps.guesses[name] / (1.0 if name == "DOP853" else 3.0)
    return steps.spent + steps.cost - last > max(last, 10.0 * price) and (rate - least) * steps.rest > 4.0 * price


def trial(steps: AdaptiveSteps, name: str) -> float:
    """What it costs at least to try a method [s]."""
    return SWITCH + 2 * FEW * price_of_a_step(steps.record, name)


def updated(steps: AdaptiveSteps, rate: float) -> dict[str, float]:
    """What methods cost in a second of motion [s/s], those of others as much less as the present one costs less."""
    before = steps.rates.get(steps.name, math.inf)
    easier = min(1.0, rate / before) if before < math.inf else 1.0
    return {**{name: easier * cost for name, cost in steps.rates.items()}, steps.name: rate}


def promised(steps: AdaptiveSteps, name: str) -> float:
    """What a method may cost in a second of motion [s/s]."""
    guess = steps.guesses[name]
    if name in steps.rates:
        return max(steps.rates[name], guess) if name == "DOP853" else steps.rates[name]
    if name == "Radau9" and "Radau5" in steps.rates:
        return steps.rates["Radau5"] * guess / steps.guesses["Radau5"]
    return guess
