"""method = "auto": the integration method that is likely to reach the tolerance at the lowest cost, and why."""

from __future__ import annotations

import functools

from flexlink.common.types import Array
from flexlink.describe.schemes.methods import method
from flexlink.dynamics.springs import damping_slope
from flexlink.dynamics.vibration.extremes import fastest_of
from flexlink.motion.evaluation_cost import cost_of_a_step, operation_costs
from flexlink.motion.inputs.drives import gains_at_zero
from flexlink.results.record import Record

STIFF = 600.0
"""Product of the fastest frequency, or decay, and the duration from which a run does not begin with Radau9: vibration
that its start excites asks for short steps, and Radau5 damps it first."""

SMALL = 1e-5
"""Part of the size: tolerances up to which Radau9 needs so many steps less than Radau5 that it is clearly cheaper."""


def cheapest(record: Record, tolerance: float, slowest: float) -> tuple[str, str]:
    """The method that is expected to be the cheapest for an error of `tolerance` [m] on a record's chain, and why.

    Its lowest frequency `slowest` [rad/s] is what the stiffness ratio is told by.
    """
    costs, fastest = guessed_costs(record, tolerance), max(fastest_motion(record, record.q[0]))
    if fastest * record.run.duration > STIFF or tolerance > SMALL * record.chain.size:
        del costs["Radau9"]
    name = min(costs, key=lambda name: costs[name])
    if name == "DOP853":
        return name, f"not stiff: fastest mode {fastest:.3g} rad/s"
    stiffness = f"stiffness ratio {fastest / slowest:.3g}"
    if name == "Radau9":
        return name, f"{stiffness}, tolerance {tolerance / record.chain.size:.2g} of the {record.chain.size_name}"
    return name, stiffness


def guessed_costs(record: Record, tolerance: float) -> dict[str, float]:
    """What each method costs in the whole run, as far as can be told at the start [s].

    An explicit method takes as many steps as the fastest mode or damper asks for, and some more: gains of a drive
    stiffen and brake, as springs and dampers do, and so does dry friction at rest, by its steepest slope. What an
    implicit one takes, whose steps do not depend on them, was measured on 80 random scenes: 12 tries at 1e-2 of the
    size, 19 at 1e-3, 30 at 1e-4, 76 at 1e-6 by Radau5, of which half are within a factor of 1.7; fewer by Radau9, as
    dry friction does not leave a motion smooth.
    """
    run, part = record.run, tolerance / record.chain.size
    fastest, strict = max(fastest_motion(record, record.q[0])), 1e-2 / part
    tries = {"Radau5": 12.0 * strict**0.2}
    short = fastest * run.duration <= STIFF
    tries["Radau9"] = 11.0 * strict**0.11 if short else 1.3 * part ** (1 / 12) * tries["Radau5"]
    # |h ω| up to which steps of DOP853 may be stable: it ends there, or before
    tries["DOP853"] = fastest * run.duration / 6.0 + 8.0 * strict**0.125
    if record.chain.hinges["coulomb"].any():
        tries["Radau9"] = max(tries["Radau9"], tries["Radau5"])
    fewest = record.inputs.drive.rate * run.duration  # at the instants of a sampled law
    return {name: price_of_a_step(record, name) * max(fewest, tries[name]) for name in tries}


def prices(record: Record, *, explicit: bool) -> list[float]:
    """CPU time of each of `OPERATIONS` on a record's chain [s]."""
    find = functools.partial(operation_costs, record.chain, explicit=explicit, drive=record.inputs.drive)
    found: list[float] = record.kept(("prices", explicit), None, find)
    return found


def price_of_a_step(record: Record, name: str) -> float:
    """CPU time of one try of a step of a method on a record's chain [s]."""
    rule = method(name)
    return cost_of_a_step(prices(record, explicit=rule.explicit), rule.stages, explicit=rule.explicit)


def tumbles(record: Record) -> bool:
    """Whether rigid bodies fly freely: nothing holds them, dampers are slow, and the motion alone limits a step.

    Bodies that turn over multiply what long steps are off by: those of an explicit method end at samples there, and
    are much more accurate than asked for.
    """
    if record.base is None:
        return False
    freely: bool = record.kept("tumbles", record.q[0].tobytes(), lambda: _nothing_holds(record))
    return freely


def _nothing_holds(record: Record) -> bool:
    slow = 500.0  # decay in the time of the run
    frequency, decay = fastest_motion(record, record.q[0])
    return frequency == 0.0 and decay * record.run.duration <= slow


def fastest_motion(record: Record, q: Array) -> tuple[float, float]:
    """The fastest frequency [rad/s] and decay [1/s] of a chain under its drive at a posture."""
    chain = record.chain
    kp, kd = gains_at_zero(record.inputs.drive, chain).diagonals()
    return fastest_of(chain, q, chain.stiffness + kp, damping_slope(chain) + kd)
