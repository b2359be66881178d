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
"""Tries of steps: the first ones of a method, which begins anew, and those by which it is judged."""

SWITCH = 1e-4
"""CPU time of a change of methods, and back, beside their steps [s]."""

PATIENCE = 0.15
"""Part of what another method promises to cost in the rest of the run that a run must have cost before it is tried."""


def consider(steps: AdaptiveSteps) -> None:
    """Judge the steps since the last time, and go on with another method if the rest is likely to cost less by it."""
    time, cost, since = steps.time, steps.cost, steps.judged
    steps.judged = time, cost
    if since is None or time <= since[0]:  # it has just begun, or did not get on
        steps.consider_at = steps.tries + (FEW if steps.tried else few(steps))
        return
    rate, tried_for, steps.tried_for = (cost - since[1]) / (time - since[0]), steps.tried_for, None
    steps.rates = updated(steps, rate)
    steps.consider_at = 2 * steps.tries
    spent, rest = steps.spent + cost, steps.rest
    if rate * rest < SWITCH:
        return
    promises = {name: promised(steps, name) for name in METHODS if name != steps.name}
    name = min(promises, key=lambda other: promises[other])
    known = name in steps.rates
    if not is_cheaper(steps, name, promises[name], rate, spent):
        known = False
        name = next((other for other in promises if is_worth_a_trial(steps, other, rate, spent)), "")
    if name:
        back = tried_for if tried_for and tried_for[0] == name else None
        steps.tried_for = None if known else (steps.name, steps.why)
        steps.tried = {**steps.tried, steps.name: spent, name: spent}
        steps.go_on_with(name, back[1] if back else "")
        steps.judged, steps.consider_at = None, steps.tries + FEW


def few(steps: AdaptiveSteps) -> int:
    """Tries of steps that cost as much as a change of methods."""
    return max(FEW, math.ceil(SWITCH / price_of_a_step(steps.record, steps.name)))


def is_cheaper(steps: AdaptiveSteps, name: str, promise: float, rate: float, spent: float) -> bool:
    """Whether a method promises to do the rest for clearly less."""
    gain, rest = (rate - promise) * steps.rest, steps.rest
    if name in steps.rates:
        return promise < 0.9 * rate and gain > SWITCH
    return promise < 0.75 * rate and gain > 4.0 * trial(steps, name) and spent > PATIENCE * promise * rest


def is_worth_a_trial(steps: AdaptiveSteps, name: str, rate: float, spent: float) -> bool:
    """Whether a run has cost so much since a method was last tried that it may be again, if it may cost less at all."""
    if steps.rates.get(name, 0.0) == math.inf:
        return False
    last, price = steps.tried.get(name, 0.0), trial(steps, name)
    least = steps.guesses[name] / (1.0 if name == "DOP853" else 3.0)
    return spent - last > max(last, 10.0 * price) and (rate - least) * steps.rest > 4.0 * price


def trial(steps: AdaptiveSteps, name: str) -> float:
    """What it costs to try a method [s]."""
    return SWITCH + 2 * FEW * price_of_a_step(steps.record, name)


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
