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

from flexlink.describe.run_settings import AUTO
from flexlink.motion.method_choice import guessed_costs, price_of_a_step, tumbles
from flexlink.motion.method_steps import NEVER, MethodSteps
from flexlink.motion.tolerable import Thresholds


def begin(steps: MethodSteps) -> None:
    """What is known of methods before the first step."""
    steps.judged, steps.rates, steps.tried, steps.tried_for, steps.guesses = (steps.time, 0.0), {}, {}, None, {}
    record, run = steps.record, steps.run
    if run.method != AUTO or run.duration == 0.0 or tumbles(record):
        steps.consider_at = NEVER
        return
    about, tolerance = (record.q[0].tobytes(), record.qd[0].tobytes()), run.tolerance_within(record.chain.size)
    costs = record.kept("guesses", about, lambda: guessed_costs(record, tolerance))
    steps.guesses = {name: cost / run.duration for name, cost in costs.items()}
    steps.consider_at = few(steps)


def consider(steps: MethodSteps) -> None:
    """Judge the steps since the last time, and go on with another method if the rest is likely to cost less by it."""
    time, cost, since = steps.time, steps.cost, steps.judged
    if since is None or time <= since[0]:  # it has just begun, or did not get on
        steps.judged, steps.consider_at = (time, cost), steps.tries + few(steps)
        return
    rate, overall = (cost - since[1]) / (time - since[0]), cost / (time - steps.taken)
    steps.judged, steps.consider_at = (time, cost), 2 * steps.tries
    steps.rates = updated(steps, rate)
    if steps.tried_for and not stays(steps, rate, steps.rates[steps.tried_for[0]]):
        go_on_with(steps, *steps.tried_for)
    else:
        steps.tried_for = None
        look_around(steps, min(rate, overall))


def look_around(steps: MethodSteps, rate: float) -> None:
    """Go on with the method that promises most, or try one, where the present one costs so much in a second [s/s]."""
    if rate * rest_of(steps) < Thresholds.switch:
        return
    promises = {name: promised(steps, name) for name in steps.guesses if name != steps.name}
    name = min(promises, key=lambda other: promises[other])
    if is_cheaper(steps, name, promises[name], rate):
        trial = name not in steps.rates
    else:
        name, trial = next((other for other in promises if is_worth_a_trial(steps, other, rate)), ""), True
    if name:
        tried_for = (steps.name, steps.why) if trial else None
        go_on_with(steps, name)
        steps.tried_for = tried_for


def go_on_with(steps: MethodSteps, name: str, why: str = "") -> None:
    """Go on with another method, and note when it was the present one's turn."""
    spent = steps.spent + steps.cost
    steps.tried = {**steps.tried, steps.name: spent, name: spent}
    steps.go_on_with(name, why)
    steps.judged, steps.tried_for, steps.consider_at = None, None, steps.tries + few(steps)


def rest_of(steps: MethodSteps) -> float:
    """Time that a run has to go [s]; of one from outside that goes on and on, as long as it went."""
    start = float(steps.record.t[0])
    left = start + steps.run.duration - steps.time
    return left if left > 0.0 else steps.time - start


def stays(steps: MethodSteps, rate: float, before: float) -> bool:
    """Whether a method that is tried goes on, which costs so much in a second where the one before did [s/s]."""
    if steps.name == "Radau9":
        return is_cheaper(steps, steps.name, rate, before)
    return rate < 0.5 * before or is_cheaper(steps, steps.name, rate, before, patience=1 / 3)


def few(steps: MethodSteps) -> int:
    """Tries of steps up to the next time: of a run's first ones as many as cost twice as much as a change of methods.

    Later as many as cost a part of what the run has cost, so that what a method inherits from another one counts less.
    """
    time = Thresholds.trial / 2 * steps.spent if steps.tried else 2 * Thresholds.switch
    return max(Thresholds.few, math.ceil(time / price_of_a_step(steps.record, steps.name)))


def is_cheaper(steps: MethodSteps, name: str, promise: float, rate: float, patience: float = 1.0) -> bool:
    """Whether a method that promises to cost so much in a second does the rest of the run for clearly less [s/s]."""
    known, rest = name in steps.rates, rest_of(steps)
    clearly, price = (0.9, Thresholds.switch) if known else (0.75, 4.0 * trial(steps, name))
    gains = promise < clearly * rate and (rate - promise) * rest > price
    return gains and steps.spent + steps.cost > patience * Thresholds.patience[name] * promise * rest


def is_worth_a_trial(steps: MethodSteps, name: str, rate: float) -> bool:
    """Whether a run has cost so much since a method was last tried that it may be again, if it may cost less at all."""
    if steps.rates.get(name, 0.0) == math.inf:
        return False
    last, price, since = steps.tried.get(name, 0.0), trial(steps, name), steps.spent + steps.cost
    # stability bounds what DOP853 costs from below; guesses of implicit methods are hardly ever three times too much
    least = steps.guesses[name] / (1.0 if name == "DOP853" else 3.0)
    often, gain = max(last, 10.0 * price), (rate - least) * rest_of(steps)  # trials cost a tenth of the run at most
    return since - last > often and gain > 4.0 * price


def trial(steps: MethodSteps, name: str) -> float:
    """What it costs at least to try a method [s]."""
    return Thresholds.switch + 2 * Thresholds.few * price_of_a_step(steps.record, name)


def updated(steps: MethodSteps, rate: float) -> dict[str, float]:
    """What methods cost in a second of motion [s/s], those of others as much less as the present one costs less."""
    before = steps.rates.get(steps.name, math.inf)
    easier = min(1.0, rate / before) if before < math.inf else 1.0
    return {**{name: easier * cost for name, cost in steps.rates.items()}, steps.name: rate}


def promised(steps: MethodSteps, name: str) -> float:
    """What a method may cost in a second of motion [s/s]."""
    guess = steps.guesses[name]
    if name in steps.rates:
        return max(steps.rates[name], guess) if name == "DOP853" else steps.rates[name]
    if name == "Radau9" and "Radau5" in steps.rates:
        return steps.rates["Radau5"] * guess / steps.guesses["Radau5"]
    return guess
