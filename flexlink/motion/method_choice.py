"""Choice by method = "auto": the method expected to meet the tolerance at the lowest cost, and the reason for it."""

import functools
from typing import Any

import numpy as np

from flexlink.common.memo import Memo
from flexlink.common.types import Array
from flexlink.data.documents import is_user_file
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.forces import damping_slope, has_potential, linearised
from flexlink.dynamics.vibration.extremes import fastest_of, scratch
from flexlink.motion.evaluation_cost import cost_of_a_step, counted, operation_costs
from flexlink.motion.inputs.drives import gains_at_zero
from flexlink.motion.inputs.tstops import acts_between_instants
from flexlink.results.record import Record

STIFF = 600.0
"""Fastest frequency (or decay rate) times duration above which a run does not start with Radau9.

The start excites fast vibration. Radau9 would need short steps to follow it; Radau5 damps it first.
"""

SMALL = 1e-5
"""Tolerance relative to the arm's size below which Radau9 is clearly cheaper than Radau5, as it needs fewer steps."""


def cheapest(record: Record, tolerance: float, slowest: float) -> tuple[str, str]:
    """Cheapest method for an error of `tolerance` [m], and the reason; `slowest`: lowest natural frequency [rad/s]."""
    costs, fastest = dict(guessed_costs(record, tolerance)), max(fastest_motion(record, record.q[0]))
    if not reads_rates(record) and (fastest * record.run.duration > STIFF or tolerance > SMALL * record.chain.size):
        del costs["Radau9"]
    name = min(costs, key=lambda name: costs[name])
    if name == "DOP853":
        return name, f"not stiff: fastest mode {fastest:.3g} rad/s"
    elastic = f", slowest elastic mode {slowest:.3g} rad/s" if slowest < np.inf else ""
    stiff = f"stiff: fastest eigenvalue {fastest:.3g} 1/s{elastic}"
    if name == "Radau9":
        return name, f"{stiff}; tolerance {tolerance / record.chain.size:.2g} of the {record.chain.size_name}"
    return name, stiff


def guessed_costs(record: Record, tolerance: float) -> dict[str, float]:
    """Cost of the complete run by each method [s], as estimated at the start.

    An explicit method takes somewhat more steps than stability requires for the fastest mode or damper. Gains of a
    drive are treated as springs and dampers, and dry friction as a damper with its steepest slope. The number of steps
    of an implicit method depends on none of these. It was measured on 80 random scenes: Radau5 attempts 12 steps with a
    tolerance of 1e-2 times the size, 19 with 1e-3, 30 with 1e-4 and 76 with 1e-6, within a factor of 1.7 for half of
    the scenes. Radau9 needs fewer steps, except where dry friction makes the motion nonsmooth.
    """
    return record.kept("guesses", (record.q[0].tobytes(), tolerance), lambda: _guessed_costs(record, tolerance))


def _guessed_costs(record: Record, tolerance: float) -> dict[str, float]:
    run, part = record.run, tolerance / record.chain.size
    fastest, strict = max(fastest_motion(record, record.q[0])), 1e-2 / part
    tries = {"Radau5": 12.0 * strict**0.2}
    short = fastest * run.duration <= STIFF
    tries["Radau9"] = 11.0 * strict**0.11 if short else 1.3 * part ** (1 / 12) * tries["Radau5"]
    # |h ω| = 6 is an upper bound of the stability limit of DOP853
    tries["DOP853"] = fastest * run.duration / 6.0 + 8.0 * strict**0.125
    if record.chain.hinges["coulomb"].any():
        tries["Radau9"] = max(tries["Radau9"], tries["Radau5"])
    drive = record.inputs.drive  # steps end at the instants of a sampled law, and where its torques begin to act
    fewest = dict.fromkeys(tries, drive.rate * run.duration * (2.0 if acts_between_instants(drive) else 1.0))
    if reads_rates(record):
        seen = 3e-4 / part * (200.0 / drive.rate) ** 2
        fewest["Radau5"] *= max(1.0, 10.0 * seen) ** 0.4
        fewest["Radau9"] *= max(1.0, seen) ** 0.2
    if record.tied:
        del tries["DOP853"]  # springs of ties may be stiff, and every explicit stage solves for the multipliers
    return {name: price_of_a_step(record, name) * max(fewest[name], tries[name]) for name in tries}


def reads_rates(record: Record) -> bool:
    """Whether a sampled law reads the rates of an arm that vibrates."""
    return record.inputs.drive.rate > 0 and bool((record.chain.stiffness > 0).any())


PRICES = Memo(64)  # cache of the costs of operations and steps, which arms of one layout and with like drives share


def prices(record: Record, *, explicit: bool) -> list[float]:
    """CPU time of each of the `OPERATIONS` on a record's chain [s]."""
    find = functools.partial(operation_costs, record.chain, explicit=explicit, drive=record.inputs.drive)
    return PRICES(record.chain.coordinates, (explicit, *_counted(record)), find)


def price_of_a_step(record: Record, name: str) -> float:
    """CPU time of one attempted step of a method on a record's chain [s]."""

    def find() -> float:
        rule = method(name)
        return cost_of_a_step(prices(record, explicit=rule.explicit), rule.stages, explicit=rule.explicit)

    return find() if is_user_file(name) else PRICES(record.chain.coordinates, (name, *_counted(record)), find)


def _counted(record: Record) -> tuple[Any, ...]:
    return record.kept("counted", None, lambda: counted(record.chain, record.inputs.drive))


def tumbles(record: Record) -> bool:
    """Whether rigid bodies tumble freely: there are no springs or fast dampers, so only the motion limits the step.

    Tumbling amplifies the errors of long steps. Explicit steps of such bodies therefore end at every sample, and are
    much more accurate than required.
    """
    if record.base is None:
        return False
    slow = 500.0  # a damper is slow if its decay rate times the duration of the run is at most this

    def nothing_holds() -> bool:
        frequency, decay = fastest_motion(record, record.q[0])
        return frequency == 0.0 and decay * record.run.duration <= slow

    return record.kept("tumbles", record.q[0].tobytes(), nothing_holds)


def fastest_motion(record: Record, q: Array) -> tuple[float, float]:
    """Fastest frequency [rad/s] and decay rate [1/s] of a chain under its drive in a configuration."""
    chain, kept = record.chain, record.kept

    def slopes() -> tuple[Array, Array]:
        kp, kd = gains_at_zero(record.inputs.drive, chain).diagonals()
        return linearised(chain, q).stiffness + kp, damping_slope(chain) + kd

    def find() -> tuple[float, float]:
        stiffness, damping = kept("slopes", q.tobytes() if has_potential(chain) else None, slopes)
        return fastest_of(chain, q, stiffness, damping, kept("posture", None, lambda: scratch(chain)))

    return kept("fastest", q.tobytes(), find)
