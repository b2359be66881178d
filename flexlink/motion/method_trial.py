"""Choice of the method that continues a run: the one expected to complete it at the lowest cost.

At the start of a run it is unknown how violently the arm will move, and so what a method will cost. The present
method's cost per second of motion follows from the listed costs of its operations. For a method used earlier, the cost
of its last steps counts; it is reduced in proportion if the motion has since become easier for the present method. The
cost of an untried method is estimated (`method_choice`). A method that is expected to complete the run for clearly less
is tried for some steps. These are part of the run, so nothing is computed twice. Trials do not begin at once, since
steps after a start or a jump are short. A run switches only after it has cost a fraction of the expected remaining
cost, so a failed trial wastes no more than that fraction. Measured costs may be outdated and estimates wrong. A long
run therefore tries other methods again, for a fraction of the cost of the run. The listed costs are the same on every
machine, so runs repeat bit for bit.
"""

from __future__ import annotations

import math

from flexlink.describe.run_settings import AUTO
from flexlink.motion.method_choice import guessed_costs, price_of_a_step, tumbles
from flexlink.motion.method_steps import NEVER, MethodSteps
from flexlink.motion.tolerable import Thresholds


def begin(steps: MethodSteps) -> None:
    """Set up the costs of methods before the first step."""
    steps.rated_since, steps.rates, steps.tried, steps.tried_for, steps.guesses = (steps.time, 0.0), {}, {}, None, {}
    record, run = steps.record, steps.run
    if run.method != AUTO or run.duration == 0.0 or tumbles(record):
        steps.consider_at = NEVER
        return
    about, tolerance = (record.q[0].tobytes(), record.qd[0].tobytes()), run.tolerance_within(record.chain.size)
    costs = record.kept("guesses", about, lambda: guessed_costs(record, tolerance))
    steps.guesses = {name: cost / run.duration for name, cost in costs.items()}
    steps.consider_at = few(steps)


def consider(steps: MethodSteps) -> None:
    """Compute the cost since the last call, and switch to another method if it likely completes the run for less."""
    time, cost, since = steps.time, steps.cost, steps.rated_since
    if since is None or time <= since[0]:  # the method has just begun, or made no progress
        steps.rated_since, steps.consider_at = (time, cost), steps.tries + few(steps)
        return
    rate, overall = (cost - since[1]) / (time - since[0]), cost / (time - steps.taken)
    steps.rated_since, steps.consider_at = (time, cost), 2 * steps.tries
    steps.rates = updated(steps, rate)
    if steps.tried_for and not stays(steps, rate, steps.rates[steps.tried_for[0]]):
        go_on_with(steps, *steps.tried_for)
    else:
        steps.tried_for = None
        consider_others(steps, min(rate, overall))


def consider_others(steps: MethodSteps, rate: float) -> None:
    """Switch to the most promising method, or try one, if the present one costs `rate` per second of motion [s/s]."""
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
    """Switch to another method, and note the cost of the run so far."""
    spent = steps.spent + steps.cost
    steps.tried = {**steps.tried, steps.name: spent, name: spent}
    steps.go_on_with(name, why)
    steps.rated_since, steps.tried_for, steps.consider_at = None, None, steps.tries + few(steps)


def rest_of(steps: MethodSteps) -> float:
    """Remaining time of a run [s]; for a simulator stepped beyond `run.duration`, the time so far."""
    start = float(steps.record.t[0])
    left = start + steps.run.duration - steps.time
    return left if left > 0.0 else steps.time - start


def stays(steps: MethodSteps, rate: float, before: float) -> bool:
    """Whether the run stays with a method on trial that costs `rate`, while the previous one cost `before` [s/s]."""
    if steps.name == "Radau9":
        return is_cheaper(steps, steps.name, rate, before)
    return rate < 0.5 * before or is_cheaper(steps, steps.name, rate, before, patience=1 / 3)


def few(steps: MethodSteps) -> int:
    """Number of attempted steps until a switch is considered next.

    At the start of a run these steps cost twice as much as a switch. Later they cost a fraction of the run so far: with
    more steps, the vibration left by the previous method matters less.
    """
    time = Thresholds.trial / 2 * steps.spent if steps.tried else 2 * Thresholds.switch
    return max(Thresholds.few, math.ceil(time / price_of_a_step(steps.record, steps.name)))


def is_cheaper(steps: MethodSteps, name: str, promise: float, rate: float, patience: float = 1.0) -> bool:
    """Whether a method with the cost `promise` [s/s] completes the run for clearly less than `rate` [s/s]."""
    known, rest = name in steps.rates, rest_of(steps)
    clearly, price = (0.9, Thresholds.switch) if known else (0.75, 4.0 * trial(steps, name))
    gains = promise < clearly * rate and (rate - promise) * rest > price
    return gains and steps.spent + steps.cost > patience * Thresholds.patience[name] * promise * rest


def is_worth_a_trial(steps: MethodSteps, name: str, rate: float) -> bool:
    """Whether a method may cost less, and the run has cost enough since its last trial to try it again."""
    if steps.rates.get(name, 0.0) == math.inf:
        return False
    last, price, since = steps.tried.get(name, 0.0), trial(steps, name), steps.spent + steps.cost
    # a lower bound of the cost; for DOP853 it follows from stability; other estimates are rarely 3 times too high
    least = steps.guesses[name] / (1.0 if name == "DOP853" else 3.0)
    often, gain = max(last, 10.0 * price), (rate - least) * rest_of(steps)  # trials cost up to a tenth of the run
    return since - last > often and gain > 4.0 * price


def trial(steps: MethodSteps, name: str) -> float:
    """Minimum cost of trying a method [s]."""
    return Thresholds.switch + 2 * Thresholds.few * price_of_a_step(steps.record, name)


def updated(steps: MethodSteps, rate: float) -> dict[str, float]:
    """Updated cost of each method per second of motion [s/s]; all fall in proportion if the present one falls."""
    before = steps.rates.get(steps.name, math.inf)
    easier = min(1.0, rate / before) if before < math.inf else 1.0
    return {**{name: easier * cost for name, cost in steps.rates.items()}, steps.name: rate}


def promised(steps: MethodSteps, name: str) -> float:
    """Expected cost of a method per second of motion [s/s]."""
    guess = steps.guesses[name]
    if name in steps.rates:
        return max(steps.rates[name], guess) if name == "DOP853" else steps.rates[name]
    if name == "Radau9" and "Radau5" in steps.rates:
        return steps.rates["Radau5"] * guess / steps.guesses["Radau5"]
    return guess
