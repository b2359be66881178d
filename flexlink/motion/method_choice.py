"""method = "auto": the integration method that reaches the tolerance at the lowest cost, and why."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexlink.dynamics.vibration.extremes import fastest_decay, fastest_frequency
from flexlink.results.record import Record

STIFF = 2e3
"""Product of the fastest frequency, or decay, and the duration up to which a run is short for an explicit method: it
takes a few hundred steps, as an implicit one does."""


SMALL = 1e-5
"""Part of the reach: tolerances up to which Radau9 needs so many steps less than Radau5 that it is cheaper."""


class Choice(NamedTuple):
    """A method, and why it was chosen."""

    method: str
    why: str


def cheapest(record: Record, tolerance: float, slowest: float) -> Choice:
    """The method that is expected to be the cheapest for an error of `tolerance` [m] on the chain of a record.

    Its lowest frequency `slowest` [rad/s] is what the stiffness ratio is told by.

    Measured on the scenes of the trade study: an implicit method's steps do not depend on how fast the chain's fastest
    modes are, an explicit one's do; Radau9 wants smooth motion, which dry friction does not leave.
    """
    twist = 1  # `Coordinate.axis` of a hinge that twists
    # A twisting arm is soft where gravity and rotation add more than 5 % to ω₁²; `STIFF` is then 1e4. A slender segment
    # has next to no inertia about its own axis: twist follows the bending moments at once, a stiffness that the Newton
    # matrix leaves out, and which keeps the steps of an implicit method short.
    soft, soft_stiff = 0.05, 1e4
    chain, q = record.chain, record.q[0]
    duration, part = record.run.duration, tolerance / chain.reach
    fastest = max(fastest_frequency(chain, q), fastest_decay(chain, q))
    if fastest * duration <= STIFF:
        return Choice("DOP853", f"not stiff: fastest mode {fastest:.3g} rad/s")
    softness = softened(record, slowest)
    if softness > soft and fastest * duration <= soft_stiff and any(c.axis == twist for c in chain.coordinates):
        return Choice("DOP853", f"soft: stiffness by gravity and rotation is {softness:.2g} of the elastic stiffness")
    stiffness = f"stiffness ratio {fastest / slowest:.3g}"
    if part <= SMALL and not chain.hinges["coulomb"].any():
        return Choice("Radau9", f"{stiffness}, tolerance {part:.2g} of the reach")
    return Choice("Radau5", stiffness)


def softened(record: Record, slowest: float) -> float:
    """Geometric stiffness of gravity and rotation over that of bending, (g/L + q̇²) / ω₁²."""
    gravity, fastest_turn = float(np.linalg.norm(record.chain.gravity)), float(np.abs(record.qd[0]).max(initial=0.0))
    return (gravity / record.chain.reach + fastest_turn**2) / slowest**2
