"""How far errors of angles and rates at the end of a step move bodies: what a tolerance in metres is about.

An error e_q of the angles moves them at once. One of the rates, e_v, goes on moving them, against the springs and
dampers, and gets in a time τ, by an implicit Euler step, as far as

    δ = τ (M + τ D + τ² K)⁻¹ M e_v

What counts is the largest δ of τ = 1/ω₁ (the lowest frequency), 1/(8 ω₁), … > h: of a swing with the frequency ω it
is 0.3 to 0.5 of e_v/ω, how far it goes, and of what is free to turn e_v/ω₁. Weighing all rates by 1/ω₁ is simpler, and
counts fast vibrations hundreds of times; weighing them by h lets any error of a slow one pass at small steps.
"""

import math
from typing import Any, NamedTuple

from flexlink.kernels.clock import SLOWEST
from flexlink.kernels.compiler import recursion
from flexlink.kernels.shifted import A, displacement, factor, solve

CLOSER = 1 / 8  # from one τ to the next


class Springs(NamedTuple):
    """What holds the joints of a chain beside their hinges, and scratch."""

    kp: Any  # (n,) a drive's gains, and so kd
    kd: Any
    factors: Any  # (n, 8)
    r: Any  # (n,), and so δ
    δ: Any


@recursion
def error_of(h, e_q, e_v, work):
    """Error [m] of a step of length h with errors of its angles and rates (n,); `work`: scratch of the method."""
    springs, longest = work.springs, max(h, work.clock[SLOWEST])
    at_once = displacement(e_q, work.posture)
    for k in range(len(e_v)):
        springs.δ[k] = longest * e_v[k]
    free = displacement(springs.δ, work.posture) / longest
    if longest * free <= at_once:
        return at_once
    if not free < math.inf:
        return math.nan
    τ, largest = longest, max(at_once, h * free)
    while τ * free > largest and τ > h:
        largest = max(largest, thrown(τ, e_v, work))
        τ *= CLOSER
    return largest


@recursion
def thrown(τ, e_v, work):
    """Largest displacement [m] in a time τ. Of dry friction nothing holds: its slope at rest would hide any rate."""
    kp, kd, factors, r, δ = work.springs
    for k in range(len(e_v)):
        hinge = work.chain.hinges[k]
        held = τ * (hinge.damping + kd[k] + τ * (hinge.stiffness + kp[k]))
        factors[k, A], r[k] = hinge.armature + held, -τ * held * e_v[k]
    factor(factors, work.posture)
    solve(factors, r, δ, work.posture)
    for k in range(len(e_v)):
        δ[k] += τ * e_v[k]
    return displacement(δ, work.posture)
