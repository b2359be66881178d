"""method = "auto": the integration method that reaches the tolerance at the lowest cost, and why."""

from __future__ import annotations

from flexlink.common.types import Array
from flexlink.dynamics.springs import damping_slope
from flexlink.dynamics.vibration.extremes import fastest_of
from flexlink.motion.inputs.drives import gains_at_zero
from flexlink.results.record import Record

STIFF = 500.0
"""Product of the fastest frequency, or decay, and the duration up to which a run is short for an explicit method: it
takes a few hundred steps, as an implicit one does. Measured on 104 random scenes with gains, dry friction and twist,
each with four tolerances: 200 and 2,000 are as good within 3 %."""

SMALL = 1e-5
"""Part of the size: tolerances up to which Radau9 needs so many steps less than Radau5 that it is cheaper."""


def cheapest(record: Record, tolerance: float, slowest: float) -> tuple[str, str]:
    """The method that is expected to be the cheapest for an error of `tolerance` [m] on a record's chain, and why.

    Its lowest frequency `slowest` [rad/s] is what the stiffness ratio is told by.

    Gains of a drive stiffen and brake, as springs and dampers do, and so does dry friction at rest: its steepest slope.
    Measured on the scenes of the trade study: an implicit method's steps do not depend on how fast the chain's fastest
    modes are, an explicit one's do; Radau9 wants smooth motion, which dry friction does not leave.
    """
    chain, fastest = record.chain, max(fastest_motion(record, record.q[0]))
    duration, part = record.run.duration, tolerance / chain.size
    if fastest * duration <= STIFF:
        return "DOP853", f"not stiff: fastest mode {fastest:.3g} rad/s"
    stiffness = f"stiffness ratio {fastest / slowest:.3g}"
    if part <= SMALL and not chain.hinges["coulomb"].any():
        return "Radau9", f"{stiffness}, tolerance {part:.2g} of the {chain.size_name}"
    return "Radau5", stiffness


def tumbles(record: Record) -> bool:
    """Whether rigid bodies fly freely: nothing holds them, dampers are slow, and the motion alone limits a step.

    An implicit method of lower order is cheaper there only because samples make the steps of an explicit one much more
    accurate than asked for, and bodies that turn over multiply the difference.
    """
    if record.base is None:
        return False
    freely: bool = record.kept("tumbles", record.q[0].tobytes(), lambda: _nothing_holds(record))
    return freely


def _nothing_holds(record: Record) -> bool:
    frequency, decay = fastest_motion(record, record.q[0])
    return frequency == 0.0 and decay * record.run.duration <= STIFF


def fastest_motion(record: Record, q: Array) -> tuple[float, float]:
    """The fastest frequency [rad/s] and decay [1/s] of a chain under its drive at a posture."""
    chain = record.chain
    kp, kd = gains_at_zero(record.inputs.drive, chain).diagonals()
    return fastest_of(chain, q, chain.stiffness + kp, damping_slope(chain) + kd)
